"""How a body's painting stands in a scene file: runs to read and compare; packed, where they are too many."""

import base64
import binascii
import zlib
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

RUN_MAX: Final = 2000
"""Most runs that are written as such [count]. Painted by brush, a mesh of 330 k faces may have 260 k runs: 3 MB of
text that nobody reads, and seconds to write; packed it has 0.2 MB."""

_NUMBER: Final = np.dtype("<i2")


def written(face_swatch: NDArray[np.int16]) -> list[list[int]] | str:
    """A painting (M,): runs [swatch, faces]; or, where they are more than `RUN_MAX`, a text.

    The text is base64 of the zlib stream of a 16-bit number, low byte first, for each face.
    """
    start = np.flatnonzero(np.concatenate([[True], face_swatch[1:] != face_swatch[:-1]]))
    if len(start) > RUN_MAX:
        return base64.b64encode(zlib.compress(face_swatch.astype(_NUMBER).tobytes())).decode("ascii")
    length = np.diff(np.concatenate([start, [len(face_swatch)]]))
    return [[int(swatch), int(n)] for swatch, n in zip(face_swatch[start], length, strict=True)]


def read(paint: Any, face_count: int, swatch_count: int) -> NDArray[np.int16]:
    """The painting (face_count,) of a file, from anybody.

    Raises:
        ValueError: it is no painting of so many faces with so many swatches; the text goes on after "'paint'".
    """
    if isinstance(paint, str):
        return _unpack(paint, face_count, swatch_count)
    if not isinstance(paint, list):
        raise ValueError(f"must be a list of runs or a packed text, is {str(paint)[:60]!r}")
    for run in paint:
        if not (type(run) is list and len(run) == 2 and type(run[0]) is int and type(run[1]) is int and run[1] > 0):
            raise ValueError(f"must be a list of [swatch, number of faces], has {str(run)[:60]!r}")
        if not 0 <= run[0] < swatch_count:
            raise ValueError(f"names swatch {run[0]}; there are {swatch_count}, counted from 0")
    total = sum(run[1] for run in paint)  # before anything of that size is made
    if total != face_count:
        raise ValueError(f"covers {total:,} faces; the mesh has {face_count:,}")
    return np.repeat([run[0] for run in paint], [run[1] for run in paint]).astype(np.int16)


def _unpack(text: str, face_count: int, swatch_count: int) -> NDArray[np.int16]:
    size = face_count * _NUMBER.itemsize
    unpacker = zlib.decompressobj()
    try:
        content = unpacker.decompress(base64.b64decode(text, validate=True), size + 1)  # no more than there should be
    except (binascii.Error, ValueError, zlib.error) as error:
        raise ValueError(f"is packed, and damaged: {error}") from None
    if len(content) != size or not unpacker.eof:
        raise ValueError(f"is packed for another number of faces, or cut off; the mesh has {face_count:,}")
    painting = np.frombuffer(content, _NUMBER).astype(np.int16)
    if painting.min() < 0 or painting.max() >= swatch_count:
        bad = int(painting[(painting < 0) | (painting >= swatch_count)][0])
        raise ValueError(f"names swatch {bad}; there are {swatch_count}, counted from 0")
    return painting
