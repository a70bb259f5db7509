"""Older ways to call what is public, kept until 1.0: arguments by other names, and more of them by their place."""

import functools
import warnings
from collections.abc import Callable
from typing import Any, TypeVar


def without_effect(function: str, name: str, value: object) -> None:
    """Warns of an argument that is still taken and does nothing any more; `value` None: it was not given.

    Warns:
        DeprecationWarning: it was given.
    """
    if value is not None:
        said = f"{function}: {name} has no effect any more, leave it out"
        warnings.warn(said, DeprecationWarning, stacklevel=4)  # past the caller's decorator


Function = TypeVar("Function", bound=Callable[..., Any])


def old_spellings(**renamed: str) -> Callable[[Function], Function]:
    """Decorator: what a function takes by name alone may also be given by its place, in the order of the signature.

    Args:
        renamed: new names of arguments by their old ones.

    Warns:
        DeprecationWarning: an old spelling was used; the text says the new one.
    """

    def decorate(function: Function) -> Function:
        code = function.__code__
        placed = code.co_argcount
        by_name = code.co_varnames[placed : placed + code.co_kwonlyargcount]

        @functools.wraps(function)
        def call(*given: Any, **named: Any) -> Any:
            most = placed + len(by_name)  # more is nobody's spelling: Python says so
            if placed < len(given) <= most or not renamed.keys().isdisjoint(named):
                modern = dict(zip(by_name, given[placed:], strict=False))
                old = {renamed[name]: named.pop(name) for name in renamed if name in named}
                if double := (modern.keys() & old.keys()) | ((modern.keys() | old.keys()) & named.keys()):
                    raise TypeError(f"{function.__qualname__}() got several values for {', '.join(sorted(double))}")
                modern |= old
                said = ", ".join(f"{name}=…" for name in modern)
                warnings.warn(f"{function.__qualname__}: say {said}", DeprecationWarning, stacklevel=2)
                given, named = given[:placed] + given[most:], {**named, **modern}
            return function(*given, **named)

        return call  # type: ignore[return-value]

    return decorate
