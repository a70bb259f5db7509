"""Readers of untrusted tables and NumPy archives with a limit on memory.

They raise `FormatError`, see `hapscene.io.files`.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final

from hapscene.errors import FormatError
from hapscene.io.files import check_memory, memory_most_B, open_zip

if TYPE_CHECKING:
    import zipfile

    import numpy as np
    from numpy.typing import NDArray

__all__ = ["TOO_MUCH", "Npz", "lines_of", "open_npz"]

LINE_MAX: Final = 65_536
"""Maximum length of a line in a table [characters]: more than a thousand columns."""

TOO_MUCH: Final = "divide it into shorter files"
"""Advice for files that need too much memory."""


def lines_of(path: Path, file: IO[str], line_B: int) -> Iterator[str]:
    """Yield the lines of a table; each becomes `line_B` bytes of numbers.

    Raises:
        FormatError: a line is longer than `LINE_MAX`, or the numbers need too much memory.
    """
    own_B = path.stat().st_size
    most = memory_most_B(own_B) // line_B
    for number in range(1, most + 1):
        line = file.readline(LINE_MAX + 1)
        if not line:
            return
        if len(line) > LINE_MAX:
            raise FormatError(f"line {number} is longer than {LINE_MAX:,} characters")
        yield line
    check_memory((most + 1) * line_B, own_B, "the table", TOO_MUCH)


@contextmanager
def open_npz(path: Path, most_B: int, advice: str) -> "Iterator[Npz]":
    """Open an archive of arrays from `numpy.savez`; a context manager.

    Args:
        path: the file.
        most_B: maximum unpacked size [bytes].
        advice: what to do if it is larger.

    Raises:
        FormatError: the archive is missing or damaged; also for errors in the body of the context.
    """
    try:
        with path.open("rb") as file, open_zip(file, most_B, advice) as archive:
            yield Npz(archive)
    except (FormatError, MemoryError):
        raise
    except OSError as error:
        raise FormatError(error.strerror or str(error)) from None
    except Exception as error:  # zipfile, decompressors and NumPy have no common exception class
        raise FormatError(f"damaged: {error}"[:200]) from None


class Npz:
    """Arrays of an archive; the header of an array is checked before its numbers are read."""

    def __init__(self, archive: "zipfile.ZipFile") -> None:
        self._archive = archive
        self.names = [name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy")]

    def header(self, name: str) -> "tuple[tuple[int, ...], np.dtype[np.generic]]":
        """Return shape and type of an array.

        Raises:
            FormatError: no such array, an unsupported compression, or a size that exceeds the file.
        """
        import zipfile

        import numpy as np

        try:
            member = self._archive.getinfo(f"{name}.npy")
        except KeyError:
            raise FormatError(f"array {name!r} is missing") from None
        if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) or member.flag_bits & 1:
            raise FormatError(f"array {name!r} has a compression or encryption that NumPy does not write")
        with self._archive.open(member) as file:
            try:
                version = np.lib.format.read_magic(file)
                one = version == (1, 0)
                read = np.lib.format.read_array_header_1_0 if one else np.lib.format.read_array_header_2_0
                shape, _, dtype = read(file)
            except Exception:  # NumPy parses it as Python, and deep nesting exhausts the parser
                raise FormatError(f"array {name!r} has an invalid header") from None
        if min(shape, default=0) < 0 or dtype.itemsize * math.prod(shape) > member.file_size:
            raise FormatError(f"array {name!r} of shape {shape} exceeds the file, which is truncated or forged")
        return shape, dtype

    def read(self, name: str) -> "NDArray[Any]":
        """Return an array; call `header` first."""
        import numpy as np

        with self._archive.open(f"{name}.npy") as file:
            array: NDArray[Any] = np.lib.format.read_array(file, allow_pickle=False)
        return array
