"""A vendor's library: found, loaded by ctypes, its functions declared. For drivers, as `openhaptics`.

Nothing of the vendors' ships with hapscene: the user has the library, and may say where.
"""

import ctypes
from collections.abc import Mapping, Sequence
from ctypes.util import find_library
from typing import Any

from hapscene.errors import DeviceError

__all__ = ["address_of", "load_library"]


def load_library(
    driver: str, path: str | None, names: Sequence[str], functions: Mapping[str, tuple[Any, ...]], remedy: str
) -> Any:
    """The library at `path`; without, the first of `names` that the system finds.

    Args:
        driver: what messages begin with.
        path: of the file, as the user tells it.
        names: with and without a prefix, as systems spell them.
        functions: what is called, each with its result and its arguments.
        remedy: what helps where it is not there.

    Raises:
        DeviceError: none is there, it does not load, or it lacks one of the functions.
    """
    library, why = None, ""
    for name in [path] if path else names:
        found = path or find_library(name)
        try:
            library = ctypes.CDLL(found or name)
            break
        except OSError as error:
            if found or not str(error).startswith(name):  # it is there: it is broken, or lacks what it needs itself
                why = f" ({error})"
    if library is None:
        tried = path or ", ".join(names)
        raise DeviceError(f"{driver}: the vendor's library does not load, tried as {tried}{why}; {remedy}")
    for function, (result, *arguments) in functions.items():
        try:
            entry = getattr(library, function)
        except AttributeError:
            place = f"{library._name} has no function {function}"
            raise DeviceError(f"{driver}: {place}: another library, or too old; {remedy}") from None
        entry.restype, entry.argtypes = result, arguments
    return library


def address_of(function: Any) -> int:
    """Where a function of a library lies, for compiled code to call it."""
    return int(ctypes.cast(function, ctypes.c_void_p).value or 0)
