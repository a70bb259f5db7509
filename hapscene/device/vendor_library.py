"""Find and load a vendor's library by ctypes, for drivers such as `openhaptics`.

hapscene does not include these libraries. The user installs them, and may name the path.
"""

import ctypes
from collections.abc import Mapping, Sequence
from ctypes.util import find_library
from functools import cache
from typing import Final

from hapscene.errors import DeviceError

__all__ = ["address_of", "load_library"]

_loaded: Final = cache(ctypes.CDLL)
"""Libraries by name. A device is opened again after each fault, and Python never frees the declarations."""


def load_library(
    driver: str, path: str | None, names: Sequence[str], functions: Mapping[str, tuple[type | None, ...]], remedy: str
) -> ctypes.CDLL:
    """Load the library at `path`, or by default the first of `names` that the system finds.

    Args:
        driver: name of the driver in messages.
        path: path of the library, as given by the user.
        names: names of the library, with and without prefix and suffix.
        functions: declarations of the used functions: result type, then argument types.
        remedy: remedy in messages.

    Raises:
        DeviceError: the library is not found, does not load, or lacks one of the functions.
    """
    library, reason = None, ""
    for name in [path] if path else names:
        found = path or find_library(name)
        try:
            library = _loaded(found or name)
            break
        except OSError as error:
            if found or not str(error).startswith(name):  # found, but damaged or with a missing dependency
                reason = f" ({error})"
    if library is None:
        tried = path or ", ".join(names)
        raise DeviceError(f"{driver}: the vendor's library cannot be loaded (tried {tried}){reason}; {remedy}")
    for function, (result, *arguments) in functions.items():
        try:
            entry = getattr(library, function)
        except AttributeError:
            raise DeviceError(
                f"{driver}: {library._name} has no function {function}: it is another library or too old; {remedy}"
            ) from None
        entry.restype, entry.argtypes = result, arguments
    return library


def address_of(function: "ctypes._FuncPointer") -> int:
    """Address of a function of a library, for calls from compiled code."""
    return int(ctypes.cast(function, ctypes.c_void_p).value or 0)
