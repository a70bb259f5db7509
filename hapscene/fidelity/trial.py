"""Measures how far a simplified scene differs from the original: renders the same paths in both, and compares.

The paths are strokes and taps at random positions, forces and speeds, over the whole scene and over each body
separately, which is also turned so that its other sides are touched. One seed is used for the choice, others for its
verification.
"""

import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.constants import TICK_S
from hapscene.device.model import DeviceWarning, Limits, limits_of
from hapscene.motion.hand_path import HOVER_M, PathBuilder
from hapscene.motion.look_from_above import look_from_above, window_of
from hapscene.perception import band_edges_Hz, bands_jnd, force_jnd
from hapscene.render.renderer import EFFECTS, Renderer
from hapscene.scene.mesh import MeshWarning

if TYPE_CHECKING:
    from hapscene.render.recording import Recording
    from hapscene.scene.scene import Scene

__all__ = [
    "BODY_MAX",
    "REPEATS",
    "SEED_COUNT",
    "WORST",
    "Array",
    "Error",
    "Rendered",
    "band_power",
    "body_paths",
    "concatenated",
    "device_limits",
    "error_of",
    "force_error",
    "largest_bodies",
    "memory_B",
    "new_renderer",
    "render",
    "render_paths",
    "scene_paths",
    "shortest_time_s",
    "single_body_scene",
    "tick_us",
    "without_scene_warnings",
]

Array = NDArray[np.float64]

FORCE_N: Final = (0.2, 2.0)
"""Range of forces of strokes and taps [N]: people use 0.3 to 1 N to feel a texture. At most half of the device's
limit is used."""

SPEED_M_S: Final = (0.05, 0.3)
"""Range of mean speeds of strokes [m/s], from slow exploration to rubbing."""

BODY_PATHS: Final = 4
"""Paths over a body in its pose, and as many in each turned pose [count]."""

TURN_COUNT: Final = 2
"""Number of turned poses of a body [count]."""

SCENE_PATHS: Final = 20
"""Least number of paths over a scene [count]."""

BODY_MAX: Final = 8
"""Most bodies that are simplified [count], those with most faces. Limits the time of a search."""

SEED_COUNT: Final = 12
"""Runs with different random numbers over which vibrations are averaged [count]: with 12, the random error is 0.4
JND."""

WINDOW_S: Final = 0.2
"""Window in which vibrations are compared [s]; the lowest band is 8 Hz wide."""

REPEATS: Final = 5
"""Runs of which the shortest time of each tick counts [count], which excludes other activity of the machine."""

WORST: Final = 99.9
"""Percentile of the ticks in contact that counts as the longest tick [%]; times above are caused by the machine."""

EMBREE_B: Final = 90
"""Memory that Embree takes per face [bytes]: 88 to 103 measured for 20 k to 1.3 M faces."""


def random_paths(scene: "Scene", index: int, rng: np.random.Generator, limits: Limits, count: int) -> list[Array]:
    """Random paths (n, 3) [m], one row per tick, each with a tap and a stroke on a body; empty if it is not visible
    from above."""
    look, body = look_from_above(scene), scene.bodies[index]
    low, high = window_of(body.bounds_W_m)
    places = rng.uniform(low, high, (400, 2))
    seen = look(*places.T)
    on = seen.body == index
    if np.count_nonzero(on) < 3:
        return []
    places, z_m, swatch = places[on], seen.z_m[on], seen.swatch[on]
    size_m = float(np.min(high - low))
    hover_m = min(HOVER_M, 0.2 * size_m)

    def depth_m(at: int) -> float:
        force_N = min(float(np.exp(rng.uniform(*np.log(FORCE_N)))), 0.5 * limits.force_N)
        stiffness_N_m = min(scene.swatches[swatch[at]].stiffness_N_m, limits.stiffness_N_m)
        return float(min(force_N / max(stiffness_N_m, 1.0), 0.05 * size_m))

    made = []
    for _ in range(count):
        tap, start, end = rng.permutation(len(places))[:3].tolist()
        hand = PathBuilder((*places[tap], float(z_m[tap]) + hover_m), TICK_S, look, hover_m)
        hand.tap(float(places[tap, 0]), float(places[tap, 1]), depth_m(tap))
        speed_m_s = float(np.exp(rng.uniform(*np.log(SPEED_M_S))))
        hand.trace(hand.line(tuple(places[start]), tuple(places[end]), speed_m_s), depth_m(start))
        made.append(hand.p_WT_m)
    return made


def feasible_paths(scene: "Scene", paths: Sequence[Array], device: str) -> list[Array]:
    """The paths on which the force does not exceed the limit of the device: a hand does not penetrate a wall by a
    centimetre."""
    renderer, most_N = new_renderer(scene, device, ("wall",)), device_limits(device).force_N
    pressed = [float(rendered.normal_force_N.max()) for rendered in render_paths(renderer, paths)]
    return [path for path, force_N in zip(paths, pressed, strict=True) if 0.0 < force_N <= most_N]


def single_body_scene(scene: "Scene", name: str, R: Array | None = None) -> "Scene":
    """A scene of one body at the origin of the world, with rotation R."""
    made = scene.copy()
    X_WB = np.eye(4)
    X_WB[:3, :3] = np.eye(3) if R is None else R
    made.bodies = [replace(scene.body(name), X_WB=X_WB)]
    return made


def body_paths(scene: "Scene", name: str, seed: int, device: str) -> list[Array]:
    """Paths over a body in its own frame, for its pose and for turned poses."""
    rng, limits = np.random.default_rng([seed, *name.encode()]), device_limits(device)
    turns = [scene.body(name).X_WB[:3, :3], *scipy.spatial.transform.Rotation.random(TURN_COUNT, rng=rng).as_matrix()]
    drawn = [(R, random_paths(single_body_scene(scene, name, R), 0, rng, limits, BODY_PATHS)) for R in turns]
    return feasible_paths(single_body_scene(scene, name), [path @ R for R, paths in drawn for path in paths], device)


def scene_paths(scene: "Scene", seed: int, device: str) -> list[Array]:
    """Paths over a scene, equally many for each body; `SCENE_PATHS` or more in total."""
    rng, limits = np.random.default_rng([seed, 1]), device_limits(device)
    names = largest_bodies(scene)
    count = -(-SCENE_PATHS // len(names))
    indices = [i for i, body in enumerate(scene.bodies) if body.name in names]
    return feasible_paths(scene, [path for i in indices for path in random_paths(scene, i, rng, limits, count)], device)


def largest_bodies(scene: "Scene") -> list[str]:
    """The names of the bodies that are simplified, at most `BODY_MAX`."""
    largest = sorted(scene.bodies, key=lambda body: -len(body.mesh.faces))[:BODY_MAX]
    return [body.name for body in scene.bodies if body in largest]


@contextmanager
def without_scene_warnings() -> Iterator[None]:
    """Suppress warnings about the scene, which were already issued when it was loaded."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeviceWarning)
        warnings.simplefilter("ignore", MeshWarning)
        yield


def new_renderer(scene: "Scene", device: str, effects: Sequence[str] = EFFECTS) -> Renderer:
    """A renderer of a scene for a device."""
    with without_scene_warnings():
        return Renderer(scene, effects, device=device)


def render_paths(renderer: Renderer, paths: Sequence[Array]) -> "list[Recording]":
    """Render each path from rest."""
    made = []
    for path in paths:
        renderer.reset(path[0])
        made.append(renderer.run(path))
    return made


def force_error(true: "Sequence[Recording]", rendered: "Sequence[Recording]") -> Array:
    """Difference of the forces [JND] in all ticks in contact (n,)."""
    return np.concatenate(
        [force_jnd(b.f_W_N, a.f_W_N)[a.touching | b.touching] for a, b in zip(true, rendered, strict=True)]
    )


@dataclass(frozen=True)
class Rendered:
    """Rendered paths: a recording of each, and its vibration power (windows, bands) [(m/s²)²], averaged over seeds."""

    recordings: "list[Recording]"
    power: list[Array]


def render(renderer: Renderer, paths: Sequence[Array], seed: int, seed_count: int) -> Rendered:
    """Render paths, and average their vibrations over random numbers."""
    power: list[Array] = []
    recordings: list[Recording] = []
    for k in range(seed_count):
        renderer.seed = seed + k
        recordings = render_paths(renderer, paths)
        found = [band_power(r.a_m_s2.ravel(), r.a_rate_Hz) for r in recordings]
        power = found if not power else [a + b for a, b in zip(power, found, strict=True)]
    return Rendered(recordings, [p / seed_count for p in power])


def band_power(a_m_s2: Array, rate_Hz: float) -> Array:
    """Mean squares (w, k) [(m/s²)²] in the bands of `perception.band_edges_Hz`, in windows that overlap by half."""
    size = round(WINDOW_S * rate_Hz)
    padded = np.pad(a_m_s2, (0, max(size - len(a_m_s2), 0)))
    windows = np.lib.stride_tricks.sliding_window_view(padded, size)[:: size // 2]
    shape = np.hanning(size)
    density = 2.0 * np.abs(np.fft.rfft(windows * shape, axis=1)) ** 2 / (size * np.sum(shape**2))
    total = np.concatenate((np.zeros((len(windows), 1)), np.cumsum(density, axis=1)), axis=1)
    edges = band_edges_Hz() / (rate_Hz / size) + 0.5  # a spectral line represents half a step to either side
    below = np.minimum(edges.astype(int), total.shape[1] - 2)
    at = total[:, below] + (edges - below) * (total[:, below + 1] - total[:, below])
    return np.asarray(np.diff(at, axis=1))


@dataclass(frozen=True)
class Error:
    """Difference between a scene and the original in the ticks in contact (n,) [JND], and the touched body and
    swatch."""

    force_jnd: Array
    vibration_jnd: Array
    body: NDArray[np.int32]
    swatch: NDArray[np.int32]

    @property
    def total_jnd(self) -> Array:
        """The larger of force and vibration difference."""
        return np.maximum(self.force_jnd, self.vibration_jnd)


def error_of(true: Rendered, rendered: Rendered) -> Error:
    """Difference of rendered paths."""
    parts: list[tuple[Array, ...]] = []
    for a, b, one, two in zip(true.recordings, rendered.recordings, true.power, rendered.power, strict=True):
        window = bands_jnd(np.sqrt(two), np.sqrt(one), band_edges_Hz())
        middle = np.rint((np.arange(len(a)) * TICK_S - 0.5 * WINDOW_S) / (0.5 * WINDOW_S)).astype(int)
        vibration = window[np.clip(middle, 0, len(window) - 1)]
        on = a.touching | b.touching
        at = np.where(a.touching, a.body, b.body), np.where(a.touching, a.swatch, b.swatch)
        parts.append((force_jnd(b.f_W_N, a.f_W_N)[on], vibration[on], at[0][on], at[1][on]))
    return Error(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def concatenated(errors: Sequence[Error]) -> Error:
    """Errors of several sets of paths as one."""
    return Error(*(np.concatenate([vars(error)[name] for error in errors]) for name in vars(errors[0])))


def tick_us(renderer: Renderer, paths: Sequence[Array]) -> Array:
    """Times of the ticks in contact (n,) [µs], each the minimum of `REPEATS` runs."""
    render_paths(renderer, paths)
    least = np.inf
    for _ in range(REPEATS):
        runs = render_paths(renderer, paths)
        on = np.concatenate([r.touching for r in runs])
        least = np.minimum(least, np.concatenate([r.tick_ns for r in runs])[on] * 1e-3)
    return np.asarray(least)


def memory_B(renderer: Renderer) -> int:
    """Memory of a renderer [bytes]: its arrays, and `EMBREE_B` for each face."""
    arrays = [value for part in (renderer.world, renderer.surface) for value in part if isinstance(value, np.ndarray)]
    faces = {id(body.mesh): len(body.mesh.faces) for body in renderer._bodies}
    return sum(array.nbytes for array in arrays) + EMBREE_B * sum(faces.values())


def shortest_time_s(work: Callable[[], object]) -> float:
    """The shortest time of four calls [s]."""
    least = np.inf
    for _ in range(4):
        start_s = time.perf_counter()
        work()
        least = min(least, time.perf_counter() - start_s)
    return least


def device_limits(device: str) -> Limits:
    """Limits of a device at the tick of the renderer."""
    return limits_of(device, TICK_S)
