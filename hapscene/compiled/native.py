"""Compiled functions: numba with the options of this project, compiled once and cached on disk.

Compiled code links a `native` function as a *part* of itself. Python calls it as a *whole*, which is compiled at the
first call (see `hapscene.compiled.pipeline`). With NUMBA_DISABLE_JIT=1 the same functions run in the interpreter.
"""

import functools
import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final, TypeVar

from numba import config, njit, types
from numba.core.compiler_lock import global_compiler_lock
from numba.core.typing.templates import Signature
from numba.extending import typeof_impl

from hapscene.compiled import cache, progress
from hapscene.compiled.digest import digest_of, function_below
from hapscene.compiled.pipeline import part_options, whole_options

__all__ = ["INTERPRETED", "CFunction", "compiling", "inlined", "native"]

_OPTIONS: Final = {"nogil": True, "error_model": "numpy", "_nrt": False}
INTERPRETED: Final = bool(vars(config)["DISABLE_JIT"])
"""True under NUMBA_DISABLE_JIT=1."""

Function = TypeVar("Function", bound=Callable[..., object])

_njit: Any = njit  # numba's stubs type the options by name, not as a dictionary
_Record: Any = types.Record

# Numba names the code for a record after the order in which the process met its type. In the cache, the codes of two
# processes could then have one name for two layouts, and a process that loads both would run one on the other's memory.
_Record.mangling_args = property(lambda self: ("Record", (hashlib.sha256(self.name.encode()).hexdigest()[:32],)))


class Native:
    """A function that compiled code and Python can call.

    Attributes:
        py_func: the Python function.
        inline: whether LLVM must inline it into its callers.
    """

    def __init__(self, function: Callable[..., object], inline: bool = False) -> None:
        self.py_func: Any = function
        self.inline = inline
        functools.update_wrapper(self, function)

    @functools.cached_property
    def part(self) -> Any:
        """Dispatcher of numba that other compiled functions link."""
        dispatcher = _njit(**_OPTIONS, **part_options, **({"forceinline": True} if self.inline else {}))(self.py_func)
        compiler = dispatcher._compiler
        compile_core = compiler._compile_core

        def counted(arguments: tuple[types.Type, ...], result: types.Type | None) -> object:
            compiled = compile_core(arguments, result)
            progress.advance()
            return compiled

        template = dispatcher.get_call_template

        def without_constants(arguments: tuple[types.Type, ...], named: dict[str, types.Type]) -> object:
            return template(tuple(map(types.unliteral, arguments)), named)

        compiler._compile_core = counted
        # numba would otherwise compile a function for each constant that it is called with
        dispatcher.get_call_template = without_constants
        return dispatcher

    @functools.cached_property
    def whole(self) -> Any:
        """Dispatcher of numba that Python calls."""
        return _cached(_njit(**_OPTIONS, **whole_options)(self.py_func))

    def __call__(self, *arguments: object) -> Any:
        return self.whole(*arguments)

    def __repr__(self) -> str:
        return f"<native {self.py_func.__qualname__}>"

    def compile(self, *arguments: object) -> Any:
        """Compile for the types of the arguments.

        The `entry_point` of the result is the fastest way to call the function: it accepts exactly these types and
        checks nothing.
        """
        signature = tuple(self.whole.typeof_pyval(argument) for argument in arguments)
        self.whole.compile(signature)
        return self.whole.overloads[signature]


@typeof_impl.register(Native)
def _type_of_native(value: Native, context: object) -> types.Type:
    return types.Dispatcher(value.part)


def native(function: Function) -> Function:
    """Decorate a function: compile it without the GIL, with division by zero as in NumPy, and cache it on disk."""
    compiled: Any = function if INTERPRETED else Native(function)
    return compiled  # type: ignore[no-any-return]


def inlined(function: Function) -> Function:
    """Decorate a function as `native` and inline it into its callers: for phases of the tick and for small geometry."""
    compiled: Any = function if INTERPRETED else Native(function, inline=True)
    return compiled  # type: ignore[no-any-return]


@contextmanager
def compiling(*functions: Callable[..., object]) -> Iterator[None]:
    """Report what is compiled in this context as one run: these functions, unless they are cached, and any other."""
    expected: dict[int, object] = {}
    for function in () if INTERPRETED else functions:
        plain = function_below(function)
        digest, below = digest_of(plain) if plain is not None else ("", [])
        if plain is not None and not cache.is_known(digest):
            expected |= {id(part): part for part in (function, *below) if not _is_typed(part)}
    with progress.compiling(len(expected)):
        yield


class CFunction:
    """A function compiled as a C function.

    Attributes:
        address: address of the C function, valid as long as this object exists.
    """

    def __init__(self, signature: Signature, function: Callable[..., object], uses_carray: bool = False) -> None:
        """Compile the Python function `function` for one signature.

        `uses_carray` is for functions that make arrays of C pointers.

        Raises:
            numba.core.errors.NumbaError: the function does not compile.
        """
        plain = getattr(function, "py_func", function)
        options = _OPTIONS | {"_nrt": uses_carray}
        dispatcher = _cached(_njit(**options, **whole_options)(plain))
        dispatcher.compile(signature)
        (self._result,) = dispatcher.overloads.values()
        self._call: Callable[..., Any] = self._result.entry_point
        name = self._result.fndesc.llvm_cfunc_wrapper_name
        self.address = int(self._result.library.get_pointer_to_function(name))

    def __call__(self, *arguments: object) -> Any:
        """Call the function from Python. Arguments must have exactly the types of its signature; nothing is checked."""
        return self._call(*arguments)


def _cached(dispatcher: Any) -> Any:
    """Make a dispatcher use the disk cache, report progress, and wait if another process compiles the same function."""
    digest, below = digest_of(dispatcher.py_func)
    disk = cache.DiskCache(dispatcher.py_func.__name__, digest)
    compile_ = dispatcher.compile

    def compile_once(signature: cache.Kinds) -> object:
        arguments = tuple(signature.args) if hasattr(signature, "args") else tuple(signature)
        if arguments in dispatcher.overloads:
            return dispatcher.overloads[arguments].entry_point
        if _load(dispatcher, disk, signature, arguments):
            return dispatcher.overloads[arguments].entry_point
        with progress.compiling(), cache.locked(disk.lock_path()):
            progress.begin(1 + sum(not _is_typed(part) for part in below))
            dispatcher._cache = disk  # numba looks in it again, because another process may have compiled meanwhile
            entry = compile_(signature)
            progress.advance()
            return entry

    dispatcher.compile = compile_once
    return dispatcher


def _load(dispatcher: Any, disk: cache.DiskCache, signature: cache.Kinds, arguments: tuple[types.Type, ...]) -> bool:
    """Load a function from the cache; return whether it was there."""
    with global_compiler_lock:  # other threads may compile or load meanwhile
        found = disk.load_overload(signature, dispatcher.targetctx)
        if found is None:
            return False
        dispatcher.targetctx.insert_user_function(found.entry_point, found.fndesc, [found.library])
        dispatcher.add_overload(found)
        dispatcher._cache_hits[signature] += 1
        return True


def _is_typed(part: object) -> bool:
    """Return whether a called function was compiled in this process already."""
    if isinstance(part, Native):
        return "part" in part.__dict__ and bool(part.part.overloads)
    return True
