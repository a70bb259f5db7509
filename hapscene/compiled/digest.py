"""A digest of everything that determines the code of a compiled function: its bytecode and that of all its callees.

The names of cache files contain the digest. A changed function is thus recompiled with all its callers, while a changed
comment, docstring or function that is not compiled has no effect.
"""

import enum
import hashlib
import inspect
import types
from pathlib import Path
from typing import Any, Final

import numpy as np

__all__ = ["digest_of", "function_below"]

_PLAIN: Final = (int, float, complex, bool, str, bytes, type(None), type(Ellipsis), np.generic, np.dtype)


def function_below(value: object) -> types.FunctionType | None:
    """Return the Python function that a value stands for in compiled code, or None.

    Plain functions, compiled functions and intrinsics have one.
    """
    for name in ("py_func", "_defn"):
        inner = getattr(value, name, None)
        if isinstance(inner, types.FunctionType):
            return inner
    return value if isinstance(value, types.FunctionType) else None


def digest_of(function: types.FunctionType) -> tuple[str, list[object]]:
    """Return the digest (32 hexadecimal digits) of a function with all its callees, and those that are compiled."""
    digest = hashlib.sha256()
    numbers: dict[int, int] = {id(function): 0}
    waiting, compiled = [function], list[object]()
    while waiting:
        one = waiting.pop(0)
        digest.update(f"{one.__module__}.{one.__qualname__}{one.__defaults__!r}".encode())
        _add_code(digest, one.__code__, one.__doc__)
        for name, value in _values_of(one):
            below = function_below(value)
            if below is None:
                digest.update(f"{name}={_text(value)};".encode())
                continue
            if id(below) not in numbers:
                numbers[id(below)] = len(numbers)
                waiting.append(below)
                if value is not below:
                    compiled.append(value)
            digest.update(f"{name}:{numbers[id(below)]}{getattr(value, 'inline', '')};".encode())
    return digest.hexdigest()[:32], compiled


def _add_code(digest: "hashlib._Hash", code: types.CodeType, doc: str | None) -> None:
    """Add bytecode and constants, without docstring and line numbers."""
    digest.update(code.co_code)
    digest.update(f"{code.co_names}{code.co_varnames}{code.co_argcount}{code.co_freevars}{code.co_flags}".encode())
    for k, constant in enumerate(code.co_consts):
        if isinstance(constant, types.CodeType):
            _add_code(digest, constant, None)
        elif not (k == 0 and doc is not None and constant == doc):
            digest.update(f"{type(constant).__name__}{constant!r},".encode())


def _values_of(function: types.FunctionType) -> list[tuple[str, object]]:
    """Return the values of the global and free names of a function, in a fixed order."""
    names: set[str] = set()
    codes = [function.__code__]
    while codes:
        code = codes.pop()
        names.update(code.co_names)
        codes += [constant for constant in code.co_consts if isinstance(constant, types.CodeType)]
    found = [(name, function.__globals__[name]) for name in sorted(names) if name in function.__globals__]
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        try:
            found.append((name, cell.cell_contents))
        except ValueError:  # not set yet
            continue
    return found


def _text(value: object) -> str:
    """Return a constant as text that is the same in every process."""
    if isinstance(value, enum.Enum):
        return f"{type(value).__qualname__}.{value.name}={value.value!r}"
    if isinstance(value, _PLAIN):
        return f"{type(value).__name__}{value!r}"
    if isinstance(value, tuple | list | frozenset):
        return f"({','.join(sorted(map(_text, value)) if isinstance(value, frozenset) else map(_text, value))})"
    if isinstance(value, np.ndarray):
        return f"array{value.dtype}{value.shape}{hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()}"
    if isinstance(value, types.ModuleType):
        return value.__name__ + (_file_digest(value.__file__ or "") if value.__name__.startswith("hapscene.") else "")
    if isinstance(value, type) or callable(value):
        return _source_text(value)
    return f"{type(value).__name__}{value!s}"


def _file_digest(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def _source_text(value: Any) -> str:
    """Return the name of a class or callable object, with a digest of its file if it is part of hapscene."""
    kind = value if hasattr(value, "__qualname__") else type(value)
    name = f"{kind.__module__}.{kind.__qualname__}"
    if not str(kind.__module__).startswith("hapscene"):
        return name + (repr(value.symbol) + str(value.sig) if hasattr(value, "symbol") else "")
    return name + _file_digest(inspect.getfile(kind))
