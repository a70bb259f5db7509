"""Embree: builds search structures and casts rays from compiled code. No other module uses Embree.

The library comes with the embreex wheel. Its build functions are called through ctypes. The ray query is called from
compiled code by its symbol, which keeps the callers cacheable on disk. Embree works in float32: it only identifies the
face that a ray meets; all geometry is then computed in float64 from the mesh itself.
"""

import ctypes
import importlib.util
import math
import mmap
import sys
import weakref
from functools import cache
from pathlib import Path
from typing import Any, Final

import llvmlite.binding as llvm
import numpy as np
from numba import carray, types  # type: ignore[attr-defined]  # numba's stubs do not export carray
from numpy.typing import NDArray

from hapscene.compiled.native import INTERPRETED, CFunction, native
from hapscene.constants import EDGE_OVERLAP
from hapscene.errors import HapsceneError
from hapscene.geometry import Vector, along, columns_of, cross, norm, row, sub, used_by

__all__ = ["MITRE", "RefittedSearch", "Search", "first_face", "fronts_only", "new_ray", "overlap_faces"]

# from rtcore_geometry.h and rtcore_common.h of Embree 4
_TRIANGLE, _INDEX_BUFFER, _VERTEX_BUFFER = 0, 0, 1
_UINT3, _FLOAT3 = 0x5003, 0x9003
_DYNAMIC, _FILTER_IN_ARGUMENTS = 1, 8
_LOW_QUALITY, _REFIT = 0, 3
_INVOKE_FILTER, _ALL_FEATURES = 2, 0xFFFFFFFF

MITRE: Final = 1.5
"""Largest distance that a corner of a face moves outwards in the search [edge overlaps]. With `EDGE_OVERLAP` it must
stay below one skin, or sharp corners would reach into the space where the proxy slides."""


def _library_path() -> Path:
    """Return the path of the Embree library in the embreex wheel, whose folder depends on the system."""
    spec = importlib.util.find_spec("embreex")
    if spec is None or not spec.submodule_search_locations:
        raise HapsceneError("the package embreex, which contains Embree, is not installed: run pip install embreex")
    package = Path(next(iter(spec.submodule_search_locations)))
    for folder in (package.parent / "embreex.libs", package / ".dylibs", package):
        for pattern in ("libembree4*", "embree4*.dll"):
            found = sorted(folder.glob(pattern))
            if found:
                return found[0]
    raise HapsceneError(f"no Embree 4 library next to {package}: run pip install --force-reinstall 'embreex>=4.4'")


def _load() -> ctypes.CDLL:
    path = _library_path()
    for tbb in sorted([*path.parent.glob("libtbb*"), *path.parent.glob("tbb*.dll")]):
        ctypes.CDLL(str(tbb), mode=ctypes.RTLD_GLOBAL)
    library = ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
    llvm.load_library_permanently(str(path))
    pointer, size, number = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_uint
    signatures: dict[str, tuple[type | None, list[type]]] = {
        "rtcNewDevice": (pointer, [ctypes.c_char_p]),
        "rtcGetDeviceError": (ctypes.c_int, [pointer]),
        "rtcNewScene": (pointer, [pointer]),
        "rtcReleaseScene": (None, [pointer]),
        "rtcSetSceneFlags": (None, [pointer, ctypes.c_int]),
        "rtcNewGeometry": (pointer, [pointer, ctypes.c_int]),
        "rtcSetNewGeometryBuffer": (pointer, [pointer, ctypes.c_int, number, ctypes.c_int, size, size]),
        "rtcCommitGeometry": (None, [pointer]),
        "rtcReleaseGeometry": (None, [pointer]),
        "rtcAttachGeometry": (number, [pointer, pointer]),
        "rtcCommitScene": (None, [pointer]),
        "rtcSetSceneBuildQuality": (None, [pointer, ctypes.c_int]),
        "rtcSetGeometryBuildQuality": (None, [pointer, ctypes.c_int]),
        "rtcUpdateGeometryBuffer": (None, [pointer, ctypes.c_int, number]),
        "rtcIntersect1": (None, [pointer, pointer, pointer]),
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


_embree = _load()

_intersect: Any
if INTERPRETED:
    _intersect = _embree.rtcIntersect1
else:
    _intersect = types.ExternalFunction("rtcIntersect1", types.void(types.uintp, types.uintp, types.uintp))

# RTCRayHit as 32-bit words: org 0–2, tnear 3, dir 4–6, time 7, tfar 8, mask 9, id 10, flags 11,
# Ng 12–14, u 15, v 16, primID 17, geomID 18, instID 19, instPrimID 20; 16-byte aligned
_RAY_WORDS = 24
_NO_HIT = 0xFFFFFFFF


def new_ray() -> NDArray[np.float32]:
    """Return an aligned ray buffer (24,) for `first_face`; each thread that casts needs its own."""
    raw = np.zeros(_RAY_WORDS + 4, np.float32)
    start = (-raw.ctypes.data // 4) % 4
    return raw[start : start + _RAY_WORDS]


def _let_backs_pass(arguments: Any) -> None:
    """Filter of Embree (RTCFilterFunctionNArguments: valid, user, context, ray, hit) that rejects back faces."""
    if INTERPRETED:  # ctypes pointers are indexed directly; numba's carray does not support nested pointers there
        pointers, ray, normal = arguments, arguments[3], arguments[4]
    else:
        pointers = carray(arguments, 5)
        ray, normal = carray(pointers[3], 7), carray(pointers[4], 3)
    if ray[4] * normal[0] + ray[5] * normal[1] + ray[6] * normal[2] >= 0.0:
        valid = pointers[0] if INTERPRETED else carray(pointers[0], 1)
        valid[0] = 0.0  # has the same bits as the int 0


@cache
def _filter() -> Any:
    """Return the filter as C code. The cache keeps it alive, because Embree only stores its address."""
    if INTERPRETED:
        floats = ctypes.POINTER(ctypes.c_float)
        return ctypes.CFUNCTYPE(None, ctypes.POINTER(floats))(_let_backs_pass)
    pointer: Any = types.CPointer
    return CFunction(types.void(pointer(pointer(types.float32))), _let_backs_pass, uses_carray=True)


def fronts_only() -> NDArray[np.uint64]:
    """Return RTCIntersectArguments of a ray that passes through back faces: flags, context, filter."""
    compiled = _filter()
    address = ctypes.cast(compiled, ctypes.c_void_p).value if INTERPRETED else compiled.address
    return np.array([_ALL_FEATURES << 32 | _INVOKE_FILTER, 0, address, 0, 0], np.uint64)


@native
def first_face(
    search: int,
    ray: NDArray[np.float32],
    origin: tuple[float, float, float],
    direction: tuple[float, float, float],
    far_m: float,
    arguments: int,
) -> int:
    """Return the first face along a ray, or −1; its distance [m] (float32) is left in `ray[8]`.

    Args:
        search: address of a search structure.
        ray: buffer of `new_ray`.
        origin: start of the ray in the centred frame of the search structure [m].
        direction: unit vector.
        far_m: length of the ray [m].
        arguments: address of `fronts_only()`, or 0 to meet faces from both sides, which is faster.
    """
    words = ray.view(np.uint32)
    for i in range(3):
        ray[i] = origin[i]
        ray[4 + i] = direction[i]
    ray[3] = 0.0
    ray[7] = 0.0
    ray[8] = far_m
    words[9] = _NO_HIT
    words[10] = 0
    words[11] = 0
    words[18] = _NO_HIT
    words[19] = _NO_HIT
    _intersect(int(search), ray.ctypes.data, int(arguments))
    if words[18] == _NO_HIT:
        return -1
    return int(words[17])


@cache
def _device(settings: bytes | None = None) -> int:
    device = _embree.rtcNewDevice(settings)
    if not device:
        raise HapsceneError(f"Embree found no usable device (Embree error {_embree.rtcGetDeviceError(None)})")
    return int(device)


class Search:
    """Search structure over one mesh, built once and shared by all bodies that use the mesh.

    Attributes:
        handle: address for `first_face`.
        center_m: (3,) centre of the bounding box. Rays are relative to it, which keeps the most float32 digits.
        radius_m: radius of the ball around `center_m` that contains the mesh.
    """

    def __init__(self, vertices_m: NDArray[np.float64], faces: NDArray[np.int32], skin_m: float) -> None:
        vertices_m = np.asarray(vertices_m, np.float64)
        self.center_m, self.radius_m = _ball(vertices_m, used_by(faces))
        self.handle = _build(vertices_m, faces, self.center_m, EDGE_OVERLAP * skin_m)
        weakref.finalize(self, _embree.rtcReleaseScene, self.handle)


class RefittedSearch:
    """Search structure over faces whose corners move: boxes are refitted, the tree is kept.

    The first refit builds it. A refit of many faces is about twenty times as fast as a build, and rays stay as fast as
    long as neighbouring faces stay neighbours. Embree uses one thread, so that refits can run beside the haptic loop.

    Attributes:
        handle: address for `first_face`.
    """

    def __init__(self, faces: NDArray[np.int32]) -> None:
        self._faces, self._used = faces, used_by(faces)
        device = self._device = _device(b"threads=1")
        self.handle = int(_embree.rtcNewScene(device))
        _embree.rtcSetSceneFlags(self.handle, _DYNAMIC | _FILTER_IN_ARGUMENTS)
        # gives each geometry a tree that can be refitted separately
        _embree.rtcSetSceneBuildQuality(self.handle, _LOW_QUALITY)
        self._geometry, self._corners, _ = _triangles(device, len(faces))
        _embree.rtcSetGeometryBuildQuality(self._geometry, _REFIT)
        _embree.rtcAttachGeometry(self.handle, self._geometry)
        weakref.finalize(self, _embree.rtcReleaseScene, self.handle)
        weakref.finalize(self, _embree.rtcReleaseGeometry, self._geometry)

    def refit(self, vertices_m: NDArray[np.float64], overlap_m: float) -> tuple[NDArray[np.float64], float]:
        """Set the vertices (N, 3) and refit; returns `center_m` and `radius_m` as in `Search`."""
        center_m, radius_m = _ball(vertices_m, self._used)
        overlap_faces(vertices_m, self._faces, center_m, overlap_m, self._corners)
        # collapse left-out faces to a point: Embree cannot refit NaN
        self._corners[np.isnan(self._corners[:, 0])] = 0.0
        _embree.rtcUpdateGeometryBuffer(self._geometry, _VERTEX_BUFFER, 0)
        _embree.rtcCommitGeometry(self._geometry)
        _embree.rtcCommitScene(self.handle)
        error = _embree.rtcGetDeviceError(self._device)
        if error:
            raise HapsceneError(f"Embree could not refit a search over {len(self._faces):,} faces (error {error})")
        return center_m, radius_m


def _ball(vertices_m: NDArray[np.float64], used: NDArray[np.bool_]) -> tuple[NDArray[np.float64], float]:
    """Return the centre (3,) of the bounding box of the used vertices, and the radius around it that holds them [m]."""
    columns = columns_of(vertices_m, used)
    low, high = (np.array([end(column) for column in columns]) for end in (np.min, np.max))
    center_m = (low + high) / 2
    square = sum((column - middle) ** 2 for column, middle in zip(columns, center_m, strict=True))
    return center_m, math.sqrt(np.max(square))


@native
def overlap_faces(
    vertices_m: NDArray[np.float64],
    faces: NDArray[np.int32],
    center_m: NDArray[np.float64],
    overlap_m: float,
    out: NDArray[np.float32],
) -> None:
    """Write the corners (3M, 3) of faces (M, 3) about `center_m`, grown by `overlap_m` [m] over their edges, to `out`.

    To offset all three edges of a triangle is to scale it about its incentre by 1 + overlap / inradius. Faces narrower
    than the overlap have no reliable normal; they are written as NaN, which Embree skips, and their neighbours cover
    them.
    """
    center = (center_m[0], center_m[1], center_m[2])
    for face in range(len(faces)):
        a = sub(row(vertices_m, faces[face, 0]), center)
        b = sub(row(vertices_m, faces[face, 1]), center)
        c = sub(row(vertices_m, faces[face, 2]), center)
        ab, bc, ca = sub(b, a), sub(c, b), sub(a, c)
        ab_m, bc_m, ca_m = norm(ab), norm(bc), norm(ca)
        perimeter_m = ab_m + bc_m + ca_m
        double_area = norm(cross(ab, bc))
        if double_area == 0.0 or double_area / max(ab_m, bc_m, ca_m) < overlap_m:
            out[3 * face : 3 * face + 3] = np.nan
            continue
        incentre = (
            (a[0] * bc_m + b[0] * ca_m + c[0] * ab_m) / perimeter_m,
            (a[1] * bc_m + b[1] * ca_m + c[1] * ab_m) / perimeter_m,
            (a[2] * bc_m + b[2] * ca_m + c[2] * ab_m) / perimeter_m,
        )
        growth = overlap_m / (double_area / perimeter_m)
        _grow(a, incentre, growth, MITRE * overlap_m, out[3 * face])
        _grow(b, incentre, growth, MITRE * overlap_m, out[3 * face + 1])
        _grow(c, incentre, growth, MITRE * overlap_m, out[3 * face + 2])


@native
def _grow(corner: Vector, incentre: Vector, growth: float, most_m: float, out: NDArray[np.float32]) -> None:
    """Write a corner, moved from the incentre by `growth` times its distance but at most `most_m`, to `out`."""
    spoke = sub(corner, incentre)
    out[0], out[1], out[2] = along(corner, np.minimum(growth, most_m / norm(spoke)), spoke)


def _build(
    vertices_m: NDArray[np.float64], faces: NDArray[np.int32], center_m: NDArray[np.float64], overlap_m: float
) -> int:
    """Build an Embree scene over overlapping faces that share no corners; return its address.

    Embree's robust mode, which closes gaps at shared edges, is off: the overlap closes them too, and rays are a fifth
    faster without it.
    """
    device = _device()
    scene = _embree.rtcNewScene(device)
    _embree.rtcSetSceneFlags(scene, _FILTER_IN_ARGUMENTS)
    geometry, corners, index = _triangles(device, len(faces))
    overlap_faces(vertices_m, faces, center_m, overlap_m, corners)
    _embree.rtcCommitGeometry(geometry)
    _embree.rtcAttachGeometry(scene, geometry)
    _embree.rtcReleaseGeometry(geometry)
    _embree.rtcCommitScene(scene)
    _release_pages(corners)
    _release_pages(index)
    error = _embree.rtcGetDeviceError(device)
    if error:
        raise HapsceneError(f"Embree could not build a search structure over {len(faces):,} faces (error {error})")
    return int(scene)


def _release_pages(buffer: NDArray[np.generic]) -> None:
    """Return the memory of a buffer that Embree does not read again to the system: 48 bytes per face.

    The leaves of Embree's tree hold copies. The buffer stays valid and reads as zeros. Has an effect on Linux only.
    """
    first, end = buffer.ctypes.data, buffer.ctypes.data + buffer.nbytes
    first, end = -(-first // mmap.PAGESIZE) * mmap.PAGESIZE, end // mmap.PAGESIZE * mmap.PAGESIZE
    if sys.platform == "linux" and end > first:
        _libc().madvise(ctypes.c_void_p(first), ctypes.c_size_t(end - first), mmap.MADV_DONTNEED)


@cache
def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None)


def _triangles(device: int, count: int) -> tuple[int, NDArray[np.float32], NDArray[np.uint32]]:
    """Create a geometry of triangles that share no corners; return it, its corners (3 count, 3) and its index."""
    geometry = _embree.rtcNewGeometry(device, _TRIANGLE)
    corners = _buffer(geometry, _VERTEX_BUFFER, _FLOAT3, 3 * count, ctypes.c_float)
    index = _buffer(geometry, _INDEX_BUFFER, _UINT3, count, ctypes.c_uint32)
    index[:] = np.arange(3 * count, dtype=np.uint32).reshape(-1, 3)
    return geometry, corners, index


def _buffer(geometry: int, kind: int, layout: int, count: int, number: type[Any]) -> NDArray[Any]:
    """Create a buffer of rows (count, 3) of 4-byte numbers that Embree allocates and owns."""
    address = _embree.rtcSetNewGeometryBuffer(geometry, kind, 0, layout, 12, count)
    return np.ctypeslib.as_array(ctypes.cast(address, ctypes.POINTER(number)), (count, 3))
