"""The tree and the buffers of a glTF file, each item looked up with care: files come from strangers."""

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import SceneError

_TYPES: Final = {5121: "<u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS: Final = {"SCALAR": 1, "VEC3": 3}
_PACKED: Final = ("KHR_draco_mesh_compression", "KHR_meshopt_compression", "EXT_meshopt_compression")


class Tree:
    """A glTF file's parts. What cannot be had of them is a `SceneError` that says why."""

    def __init__(self, path: Path, tree: dict[str, Any], blobs: list[bytes]) -> None:
        self.path, self.tree, self.blobs = path, tree, blobs

    def fail(self, problem: str) -> SceneError:
        return SceneError(f"{self.path}: {problem}")

    def item(self, kind: str, index: Any) -> dict[str, Any]:
        items = self.tree.get(kind, [])
        if type(index) is not int or not isinstance(items, list) or not 0 <= index < len(items):
            raise self.fail(f"no {kind}[{str(index)[:20]}]")
        if not isinstance(items[index], dict):
            raise self.fail(f"{kind}[{index}] must be an object")
        return dict(items[index])

    def numbers(self, value: Any, count: int, where: str) -> NDArray[np.float64]:
        fits = isinstance(value, list) and len(value) == count
        if not fits or not all(type(x) in (int, float) and -1e100 < x < 1e100 for x in value):
            raise self.fail(f"{where} must be {count} finite numbers")
        return np.array(value, np.float64)

    def check_packing(self, where: str, extensions: Any) -> None:
        """Refuse what cannot be read without a decoder; other extensions change no shape."""
        if not isinstance(extensions, dict):
            raise self.fail(f"{where}: extensions must be an object, each by its name")
        if packed := [name for name in _PACKED if name in extensions]:
            raise self.fail(f"{where} is compressed ({packed[0]}); export it without compression")

    def texts(self, key: str) -> list[str]:
        found = self.tree.get(key, [])
        if not isinstance(found, list) or not all(isinstance(text, str) for text in found):
            raise self.fail(f"{key} must be a list of names")
        return found

    def accessor(self, index: Any, kind: str, sort: str) -> NDArray[Any]:
        """Numbers (n,) or (n, 3) of a buffer, which must hold them."""
        accessor = self.item("accessors", index)
        where = f"accessors[{index}]"
        dtype = _TYPES.get(accessor.get("componentType", 0)) if _whole(accessor.get("componentType", 0)) else None
        if accessor.get("type") != kind or dtype is None or np.dtype(dtype).kind != sort or "sparse" in accessor:
            raise self.fail(
                f"{where} must be {kind} of {'float32' if sort == 'f' else 'unsigned whole numbers'}, dense"
            )
        view = self.item("bufferViews", accessor.get("bufferView"))
        self.check_packing(where, view.get("extensions", {}))
        width = _WIDTHS[kind] * np.dtype(dtype).itemsize
        layout: list[Any] = [accessor.get("count"), view.get("byteStride", width)]
        layout += [view.get("byteOffset", 0), accessor.get("byteOffset", 0)]
        if not all(_whole(n) for n in layout) or layout[0] == 0 or layout[1] < width:
            raise self.fail(f"{where} has a count or offset that is no whole number")
        count, stride, *start = (int(n) for n in layout)
        first = sum(start)
        end = first + (count - 1) * stride + width
        buffer = view.get("buffer", 0)
        if not _whole(buffer) or buffer >= len(self.blobs):
            raise self.fail(f"{where} is of a buffer that is not among the {len(self.blobs)} of the file")
        blob = self.blobs[buffer]
        if end > len(blob):
            raise self.fail(f"{where} reaches past the file's buffer of {len(blob):,} bytes: truncated?")
        if stride == width:
            rows = np.frombuffer(blob, dtype, count * _WIDTHS[kind], first)
        else:  # interleaved with other attributes
            rows = np.ndarray((count, _WIDTHS[kind]), dtype, blob, first, (stride, np.dtype(dtype).itemsize))
        return rows.reshape(count, 3) if kind == "VEC3" else rows.ravel()


def extras_of(item: dict[str, Any]) -> dict[str, Any]:
    """What hapscene wrote, or another program; nothing where that is no object."""
    extras = item.get("extras")
    return extras if isinstance(extras, dict) else {}


def _whole(value: Any) -> bool:
    return type(value) is int and 0 <= value < 1 << 40
