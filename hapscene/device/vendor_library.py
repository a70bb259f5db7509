"""A vendor's library: found, loaded by ctypes, its functions declared. For drivers, as `openhaptics`.

Nothing of the vendors' ships with hapscene: the user has the library, and may say where.
"""

import ctypes
from collections.abc import Mapping, Sequence
from ctypes.util import find_library
from typing import Any

from hapscene.errors import DeviceError


def load_library(path: str | None, names: Sequence[str], functions: Mapping[str, tuple[Any, ...]], remedy: str) -> Any:
    """The library at `path`; without, the first of `names` that the system finds.

    Args:
        path: of the file, as the user tells it.
        names: with and without a prefix, as systems spell them.
        functions: what is called, each with its result and its arguments.
        remedy: what helps where it is not there.

    Raises:
        DeviceError: none is there, it does not load, or it lacks one of the functions.
    """
    library, tried = None, []
    for name in [path] if path else names:
        place = name if path else find_library(name) or name
        try:
            library = ctypes.CDLL(place)
            break
        except OSError as error:
            tried.append(str(error))
    if library is None:
        raise DeviceError(f"the vendor's library does not load ({'; '.join(tried)}); {remedy}")
    for function, (result, *arguments) in functions.items():
        try:
            entry = getattr(library, function)
        except AttributeError:
            raise DeviceError(
                f"{library._name} has no function {function}: another library, or too old; {remedy}"
            ) from None
        entry.restype, entry.argtypes = result, arguments
    return library


def address_of(function: Any) -> int:
    """Where a function of a library lies, for compiled code to call it."""
    return int(ctypes.cast(function, ctypes.c_void_p).value or 0)
