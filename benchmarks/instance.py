"""The way not taken for many bodies: Embree's instances under one top-level scene. Kept so that it can be measured.

Nothing else in hapscene uses it. A ray goes through all bodies at once; the price is a top-level structure that must be
built anew, outside of the tick, whenever a body moves.
"""

import ctypes
import time
import weakref
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.contact.embree import Search, _device, _embree

# from rtcore_geometry.h, rtcore_common.h and rtcore_scene.h of Embree 4
_INSTANCE: Final = 121
_FLOAT3X4_COLUMN_MAJOR: Final = 0x9234
_DYNAMIC: Final = 1
_BUILD_QUALITY_LOW: Final = 0


class InstanceScene:
    """Instances of one mesh at positions (n, 3) [m] under one top-level scene.

    Attributes:
        handle: address that `first_face` takes.
    """

    def __init__(self, search: Search, p_WB_m: NDArray[np.float64]) -> None:
        _bind()
        self._search = search  # owns what the instances point to
        self.handle = int(_embree.rtcNewScene(_device()))
        weakref.finalize(self, _embree.rtcReleaseScene, self.handle)
        _embree.rtcSetSceneFlags(self.handle, _DYNAMIC)
        _embree.rtcSetSceneBuildQuality(self.handle, _BUILD_QUALITY_LOW)
        self._geometries: list[int] = []
        for p in p_WB_m:
            geometry = _embree.rtcNewGeometry(_device(), _INSTANCE)
            _embree.rtcSetGeometryInstancedScene(geometry, search.handle)
            _embree.rtcAttachGeometry(self.handle, geometry)
            _embree.rtcReleaseGeometry(geometry)  # the scene keeps it
            self._geometries.append(int(geometry))
            self._place(int(geometry), p)
        _embree.rtcCommitScene(self.handle)

    def move(self, indices: NDArray[np.intp], p_WB_m: NDArray[np.float64]) -> tuple[float, float]:
        """Put the bodies `indices` (m,) at positions (m, 3) [m]. Returns the time of placing and of the commit [s]."""
        start_s = time.perf_counter()
        for i, p in zip(indices, p_WB_m, strict=True):
            self._place(self._geometries[i], p)
        placed_s = time.perf_counter()
        _embree.rtcCommitScene(self.handle)
        return placed_s - start_s, time.perf_counter() - placed_s

    def _place(self, geometry: int, p: NDArray[np.float64]) -> None:
        columns = (ctypes.c_float * 12)(1, 0, 0, 0, 1, 0, 0, 0, 1, *p)
        _embree.rtcSetGeometryTransform(geometry, 0, _FLOAT3X4_COLUMN_MAJOR, columns)
        _embree.rtcCommitGeometry(geometry)


def _bind() -> None:
    """Declare the functions that only this module calls."""
    pointer, number = ctypes.c_void_p, ctypes.c_uint
    signatures: dict[str, list[Any]] = {
        "rtcSetSceneFlags": [pointer, ctypes.c_int],
        "rtcSetSceneBuildQuality": [pointer, ctypes.c_int],
        "rtcSetGeometryInstancedScene": [pointer, pointer],
        "rtcSetGeometryTransform": [pointer, number, ctypes.c_int, pointer],
    }
    for name, arguments in signatures.items():
        function = getattr(_embree, name)
        function.restype, function.argtypes = None, arguments
