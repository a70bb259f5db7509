"""Files of numbers from strangers: tables as text, and NumPy's archives, never larger in memory than was asked before.

What they raise is `FormatError`; `hapscene.io.files` has the rule.
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
"""Longest line of a table [characters]: a thousand columns and more."""

TOO_MUCH: Final = "cut it into shorter ones"
"""What is to be done with a file that would take too much memory."""


def lines_of(path: Path, file: IO[str], line_B: int) -> Iterator[str]:
    """The lines of a table, of which each becomes `line_B` bytes of numbers.

    Raises:
        FormatError: a line that is longer than `LINE_MAX`; so many that the numbers would take too much memory.
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
    check_memory((most + 1) * line_B, own_B, "its numbers", TOO_MUCH)


@contextmanager
def open_npz(path: Path, most_B: int, advice: str) -> "Iterator[Npz]":
    """An archive of arrays, as `numpy.savez` writes them, to be read within.

    Args:
        path: the file.
        most_B: most that it may unpack to [bytes].
        advice: what to do where it is more.

    Raises:
        FormatError: no such archive, or whatever else goes wrong within.
    """
    try:
        with path.open("rb") as file, open_zip(file, most_B, advice) as archive:
            yield Npz(archive)
    except (FormatError, MemoryError):
        raise
    except OSError as error:
        raise FormatError(error.strerror or str(error)) from None
    except Exception as error:  # zipfile, what unpacks for it, and NumPy have no common class
        raise FormatError(f"damaged: {error}"[:200]) from None


class Npz:
    """The arrays of an archive, each array's header checked before its numbers are read."""

    def __init__(self, archive: "zipfile.ZipFile") -> None:
        self._archive = archive
        self.names = [name.removesuffix(".npy") for name in archive.namelist() if name.endswith(".npy")]

    def header(self, name: str) -> "tuple[tuple[int, ...], np.dtype[Any]]":
        """Shape and type of an array.

        Raises:
            FormatError: no such array; packed as NumPy does not; it is said to be longer than the archive has.
        """
        import zipfile

        import numpy as np

        try:
            member = self._archive.getinfo(f"{name}.npy")
        except KeyError:
            raise FormatError(f"there is no array {name!r}") from None
        if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) or member.flag_bits & 1:
            raise FormatError(f"array {name!r} is packed in a way that NumPy does not write")
        with self._archive.open(member) as file:
            try:
                version = np.lib.format.read_magic(file)
                one = version == (1, 0)
                read = np.lib.format.read_array_header_1_0 if one else np.lib.format.read_array_header_2_0
                shape, _, dtype = read(file)
            except Exception:  # it is parsed as Python's source is: a deep one exhausts the parser
                raise FormatError(f"array {name!r} has no header that can be read") from None
        if min(shape, default=0) < 0 or dtype.itemsize * math.prod(shape) > member.file_size:
            raise FormatError(f"array {name} of shape {shape} is longer than the file: it is cut off or forged")
        return shape, dtype

    def read(self, name: str) -> "NDArray[Any]":
        """An array whose header was looked at."""
        import numpy as np

        with self._archive.open(f"{name}.npy") as file:
            array: NDArray[Any] = np.lib.format.read_array(file, allow_pickle=False)
        return array
