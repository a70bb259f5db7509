"""Soft shadows of bodies on each other and on the ground below them, computed from pictures of their depth.

Two pictures of the bodies, seen from the sun and from the zenith, tell how much of the sun and of the sky each pixel
sees. A pixel takes few samples, at places that differ among the 4 × 4 pixels of a cell; the mean over a cell has the
quality of all of them (interleaved sampling, Keller & Heidrich 2001). The border of a shadow is wider the farther away
the body is that casts it (Fernando 2005, "Percentage-closer soft shadows"). Uses only NumPy, so that the result does
not depend on the GL platform.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.view.triangles import GAMMA

__all__ = ["SUN", "ZENITH", "DepthPicture", "Shadows"]

Array = NDArray[Any]  # of float32

SUN: Final = (-0.45, -0.35, 0.82)
"""Direction to the sun in the world frame: from the left, in front and above, as in an exported page."""

ZENITH: Final = (0.0, 0.0, 1.0)

SUN_RAD: Final = 0.35
"""Angle under which the sun is seen [rad]: the width of the border of a shadow over the distance of what casts it."""

BORDER: Final = (0.003, 0.05)
"""Range of the width of the border of a shadow, in diagonals of the scene [1]."""

SKY: Final = 0.14
"""Radius around a point in which bodies hide the sky, in diagonals of the scene [1]."""

SAMPLES: Final = 4
"""Samples per pixel [count]: 64 in a cell."""

CELL: Final = 4
"""Side of a cell [pixels]."""

COARSER: Final = 2
"""Side of the squares of pixels that are computed once [pixels]."""

NEAR: Final = 0.01
"""Largest difference in depth of neighbours that share their shadows, in diagonals of the scene [1]."""

DARK: Final = (0.55, 0.7)
"""How much darker a point is without the sun, and without the sky [1]."""

_ORDER: Final = np.array([0, 8, 2, 10, 12, 4, 14, 6, 3, 11, 1, 9, 15, 7, 13, 5], np.float32).reshape(CELL, CELL) / 16


class DepthPicture(NamedTuple):
    """Bodies as seen along parallel rays by a camera.

    Attributes:
        depth_m: distance of the nearest surface from the plane of the camera (h, w) [m]; infinite without a surface.
        X_SC: pose of the camera (4, 4), which looks along its −z axis.
        pixel_m: size of a pixel [m].
    """

    depth_m: Array
    X_SC: NDArray[np.float64]
    pixel_m: float

    def seen(self, p_S: Array) -> tuple[Array, Array, Array]:
        """Return columns and rows [pixels] and depth [m] of points (3, h, w)."""
        X_CS, (h, w) = np.linalg.inv(self.X_SC).astype(np.float32), self.depth_m.shape
        x, y, z = np.tensordot(X_CS[:3, :3], p_S, 1) + X_CS[:3, 3, None, None]
        return w / 2 + x / self.pixel_m, h / 2 - y / self.pixel_m, -z

    def at(self, column: Array, row: Array) -> Array:
        """Return the depth at a pixel; beyond the border, that of the nearest one."""
        h, w = self.depth_m.shape
        place = np.clip(row, 0, h - 1).astype(np.int32) * w + np.clip(column, 0, w - 1).astype(np.int32)
        return np.asarray(self.depth_m.ravel()[place])


@dataclass(frozen=True)
class Shadows:
    """Shadows of a scene whose lowest point is at the height `low_m`, and whose diagonal is `size_m`."""

    sun: DepthPicture
    sky: DepthPicture
    low_m: float
    size_m: float

    def cast(
        self, pixels: NDArray[np.uint8], depth_m: Array, X_SC: NDArray[np.float64], pixel_m: float
    ) -> NDArray[np.uint8]:
        """Return a picture with shadows.

        Args:
            pixels: picture without shadows (h, w, 3), sRGB.
            depth_m: its depth (h, w), as in `DepthPicture`. Pixels without a surface show the ground.
            X_SC: pose of its camera.
            pixel_m: size of a pixel [m].
        """
        depth_m = self._with_ground(depth_m, X_SC, pixel_m)
        small_m = depth_m[::COARSER, ::COARSER]
        dark = self._darkness(_points(small_m, X_SC, pixel_m * COARSER))
        light = _enlarged(1.0 - dark, small_m, depth_m, NEAR * self.size_m) ** (1 / GAMMA)
        return np.asarray(np.rint(pixels * light[..., None]), np.uint8)

    def _with_ground(self, depth_m: Array, X_SC: NDArray[np.float64], pixel_m: float) -> Array:
        """Return the depth of the ground at pixels without a surface."""
        x, y, _ = _points(np.zeros_like(depth_m), np.eye(4), pixel_m)
        right, up, back = X_SC[2, :3].astype(np.float32)
        ground_m = (np.float32(X_SC[2, 3] - self.low_m) + right * x + up * y) / max(back, np.float32(1e-3))
        return np.where(np.isinf(depth_m), ground_m, depth_m)

    def _darkness(self, p_S: Array) -> Array:
        """Return the missing share (h, w) of the light at points (3, h, w)."""
        h, w = p_S.shape[1:]
        turn = 2 * np.pi * np.tile(_ORDER, (-(-h // CELL), -(-w // CELL)))[:h, :w]
        normal = _normals(p_S)
        toward = np.tensordot(np.array(SUN, np.float32) / np.float32(np.linalg.norm(SUN)), normal, 1)
        shadow = self._hidden_sun(p_S, normal, turn) * np.clip(3.0 * toward, 0.0, 1.0)  # else it is dark anyway
        sun, sky = (np.clip(_mean(part), 0.0, 1.0) for part in (shadow, self._hidden_sky(p_S, turn)))
        return np.asarray(1.0 - (1.0 - DARK[0] * sun) * (1.0 - DARK[1] * sky))

    def _hidden_sun(self, p_S: Array, normal: Array, turn: Array) -> Array:
        """Return the hidden share of the sun, with a border whose width depends on the distance of the bodies."""
        sun, pixel_m = self.sun, self.sun.pixel_m
        column, row, depth_m = sun.seen(p_S)
        x, y, z = np.tensordot(sun.X_SC[:3, :3].T.astype(np.float32), normal, 1)
        steep = pixel_m / np.maximum(z, 0.2)  # the depth of the surface changes by this times (x, −y) per pixel
        least_m = 2.0 * pixel_m + 1e-3 * self.size_m

        def gaps(wide_px: Array | float) -> Iterator[Array]:
            for u, v in _disc(turn):
                u, v = wide_px * u, wide_px * v
                gap_m = depth_m + steep * (x * u - y * v) - sun.at(column + u, row + v)
                yield np.where(gap_m > least_m, gap_m, 0.0)

        low, high = (border * self.size_m for border in BORDER)
        found = list(gaps(high / pixel_m))
        count = _mean(np.float32(SAMPLES) * _share(found))
        gap_m = _mean(np.asarray(sum(found))) / np.maximum(count, 1e-6)
        return _share(gaps(np.clip(SUN_RAD * gap_m, low, high) / pixel_m))

    def _hidden_sky(self, p_S: Array, turn: Array) -> Array:
        """Return the hidden share of the sky: the mean over directions of the squared sine of the horizon."""
        sky, wide_m = self.sky, SKY * self.size_m
        column, row, depth_m = sky.seen(p_S)
        total = np.zeros_like(depth_m)
        for u, v in _disc(turn):
            far2 = u * u + v * v
            far = np.sqrt(far2) * (wide_m / sky.pixel_m)  # nearer samples are denser
            over_m = depth_m - sky.at(column + far * u, row + far * v) - np.float32(4e-3 * self.size_m)
            over_m = np.maximum(over_m, 0.0)
            total += over_m**2 / (over_m**2 + (wide_m * far2) ** 2 + np.float32(1e-12))
        return total / SAMPLES


def _share(gaps: Iterable[Array]) -> Array:
    """Return the share of samples with a gap."""
    return np.asarray(sum((gap > 0).astype(np.float32) for gap in gaps) / np.float32(SAMPLES))


def _points(depth_m: Array, X_SC: NDArray[np.floating], pixel_m: float) -> Array:
    """Return the points (3, h, w) at a depth in the centres of the pixels of a camera."""
    h, w = depth_m.shape
    x, y = (np.arange(w) + 0.5 - w / 2) * pixel_m, (h / 2 - np.arange(h) - 0.5) * pixel_m
    p_C = np.stack([*np.broadcast_arrays(x[None, :], y[:, None]), -depth_m]).astype(np.float32)
    X = X_SC.astype(np.float32)
    return np.asarray(np.tensordot(X[:3, :3], p_C, 1) + X[:3, 3, None, None])


def _disc(turn: Array) -> Iterator[tuple[Array, Array]]:
    """Yield the samples of each pixel in a unit disc, turned by an angle per pixel: a spiral of equal areas."""
    part = turn / np.float32(2 * np.pi)
    for i in range(SAMPLES):
        angle, far = turn + np.float32(2.39996 * i), np.sqrt((i + part) / SAMPLES)
        yield far * np.cos(angle), far * np.sin(angle)


def _normals(p_S: Array) -> Array:
    """Return unit normals (3, h, w) from the differences to the nearer neighbours."""
    steps = []
    for axis in (2, 1):
        step = np.diff(p_S, axis=axis)
        ahead = np.concatenate([step, np.take(step, [-1], axis)], axis)
        back = np.concatenate([np.take(step, [0], axis), step], axis)
        steps.append(np.where((ahead**2).sum(axis=0) < (back**2).sum(axis=0), ahead, back))
    normal = np.cross(steps[0], -steps[1], axis=0)
    return np.asarray(normal / np.maximum(np.linalg.norm(normal, axis=0), 1e-30), np.float32)


def _mean(values: Array) -> Array:
    """Return means over the cell around each pixel of (h, w); its opposite borders count half each."""
    for axis, size in enumerate(values.shape):
        padded = np.pad(values, [(2, 2) if axis == k else (0, 0) for k in (0, 1)], mode="edge")
        share = (0.125, 0.25, 0.25, 0.25, 0.125)
        values = np.asarray(sum(np.float32(share[k]) * np.take(padded, range(k, k + size), axis) for k in range(5)))
    return values


def _enlarged(values: Array, small_m: Array, depth_m: Array, near_m: float) -> Array:
    """Enlarge values by `COARSER` to the pixels of a picture: means of the neighbours at a similar depth."""
    h, w = depth_m.shape
    rows, columns = np.arange(h), np.arange(w)
    total, weight = np.zeros_like(depth_m), np.full_like(depth_m, 1e-6)
    for down in (0, 1):
        for right in (0, 1):
            i = np.minimum((rows + down) // COARSER, len(small_m) - 1)[:, None]
            j = np.minimum((columns + right) // COARSER, small_m.shape[1] - 1)
            share = np.maximum(1.0 - np.abs(small_m[i, j] - depth_m) / near_m, 1e-3)
            total += share * values[i, j]
            weight += share
    return np.asarray(total / weight)
