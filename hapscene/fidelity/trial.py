"""What a coarser scene costs: the same paths through it and the scene as it is, and how far apart they feel.

Strokes, taps and presses at places, forces and speeds drawn at random, over the scene as it stands and over each body
by itself, turned, so that its other sides are felt too. One seed is for choosing, others are for telling.
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

from hapscene.constants import ACCELERATION_RATE_HZ, TICK_S
from hapscene.device.model import DeviceWarning, Limits, limits_of
from hapscene.motion.hand_path import HOVER_M, PathBuilder
from hapscene.motion.look_from_above import bounds_of, look_from_above, window_of
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
    "Felt",
    "alone",
    "band_power",
    "body_paths",
    "error_of",
    "feel",
    "felt_bodies",
    "force_error",
    "forces",
    "joined",
    "limits_here",
    "memory_B",
    "quietly",
    "ready",
    "scene_paths",
    "seconds",
    "tick_us",
]

Array = NDArray[np.float64]

FORCE_N: Final = (0.2, 2.0)
"""Forces of strokes and taps [N]: people feel a texture with 0.3 to 1 N. No more than half of what the device gives."""

SPEED_M_S: Final = (0.05, 0.3)
"""Mean speeds of strokes [m/s]: slow looking, and rubbing."""

BODY_PATHS: Final = 4
"""Paths over a body as it stands, and as many for each way it is turned [count]."""

TURN_COUNT: Final = 2
"""How often a body by itself is turned [count]."""

SCENE_PATHS: Final = 20
"""Paths over a scene at least [count]."""

BODY_MAX: Final = 8
"""Most bodies that are felt [count], those with most faces; others stay as they are. Bounds the time."""

SEED_COUNT: Final = 12
"""Runs with other random numbers whose vibrations are averaged [count]: of 12, chance is 0.4 JND."""

WINDOW_S: Final = 0.2
"""Over which vibrations are compared [s]: the lowest band is 8 Hz wide."""

REPEATS: Final = 5
"""Runs of which each tick's least time counts [count]: what else the machine did is left out, as in the benchmark."""

WORST: Final = 99.9
"""Share of the ticks in contact within the worst tick [%], as in the benchmark: what is over it is the machine's."""

EMBREE_B: Final = 90
"""What Embree takes for a face [bytes]: 88 to 103 by the memory of the process, at 20 k to 1.3 M faces."""


def random_paths(scene: "Scene", index: int, rng: np.random.Generator, limits: Limits, count: int) -> list[Array]:
    """Paths (n, 3) [m], a row a tick, each a tap and a stroke on a body as it stands; none where it is not seen."""
    look, body = look_from_above(scene), scene.bodies[index]
    low, high = window_of(bounds_of(body))
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


def reached(scene: "Scene", paths: Sequence[Array], device: str) -> list[Array]:
    """Those paths on which nothing is pressed harder than the device can: no hand gets into a wall by a centimetre."""
    renderer, most_N = ready(scene, device, ("wall",)), limits_here(device).force_N
    pressed = [float(felt.normal_force_N.max()) for felt in forces(renderer, paths)]
    return [path for path, force_N in zip(paths, pressed, strict=True) if 0.0 < force_N <= most_N]


def alone(scene: "Scene", name: str, R: Array | None = None) -> "Scene":
    """A scene of one body, at the origin of the world, turned."""
    made = scene.copy()
    X_WB = np.eye(4)
    X_WB[:3, :3] = np.eye(3) if R is None else R
    made.bodies = [replace(scene.body(name), X_WB=X_WB)]
    return made


def body_paths(scene: "Scene", name: str, seed: int, device: str) -> list[Array]:
    """Paths over a body in its own frame: as it stands, and turned."""
    rng, limits = np.random.default_rng([seed, *name.encode()]), limits_here(device)
    turns = [scene.body(name).X_WB[:3, :3], *scipy.spatial.transform.Rotation.random(TURN_COUNT, rng=rng).as_matrix()]
    drawn = [(R, random_paths(alone(scene, name, R), 0, rng, limits, BODY_PATHS)) for R in turns]
    return reached(alone(scene, name), [path @ R for R, paths in drawn for path in paths], device)


def scene_paths(scene: "Scene", seed: int, device: str) -> list[Array]:
    """Paths over a scene as it stands, over each body that is seen as many; `SCENE_PATHS` or more in all."""
    rng, limits = np.random.default_rng([seed, 1]), limits_here(device)
    names = felt_bodies(scene)
    count = -(-SCENE_PATHS // len(names))
    felt = [i for i, body in enumerate(scene.bodies) if body.name in names]
    return reached(scene, [path for i in felt for path in random_paths(scene, i, rng, limits, count)], device)


def felt_bodies(scene: "Scene") -> list[str]:
    """The names of those bodies that are felt, of which there are `BODY_MAX` at most."""
    largest = sorted(scene.bodies, key=lambda body: -len(body.mesh.faces))[:BODY_MAX]
    return [body.name for body in scene.bodies if body in largest]


@contextmanager
def quietly() -> Iterator[None]:
    """What is warned of the scene was told when it was loaded."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeviceWarning)
        warnings.simplefilter("ignore", MeshWarning)
        yield


def ready(scene: "Scene", device: str, effects: Sequence[str] = EFFECTS) -> Renderer:
    """A renderer of a scene for a device by name."""
    with quietly():
        return Renderer(scene, effects, device=device)


def forces(renderer: Renderer, paths: Sequence[Array]) -> "list[Recording]":
    """What is felt along each path, each from rest."""
    made = []
    for path in paths:
        renderer.reset(path[0])
        made.append(renderer.run(path))
    return made


def force_error(true: "Sequence[Recording]", felt: "Sequence[Recording]") -> Array:
    """How far forces are from the true ones [JND], of all ticks of contact (n,)."""
    return np.concatenate(
        [force_jnd(b.f_W_N, a.f_W_N)[a.touching | b.touching] for a, b in zip(true, felt, strict=True)]
    )


@dataclass(frozen=True)
class Felt:
    """What is felt along paths: a recording of each, and its vibrations (windows, bands) [(m/s²)²], of many seeds."""

    recordings: "list[Recording]"
    power: list[Array]


def feel(renderer: Renderer, paths: Sequence[Array], seed: int, seed_count: int) -> Felt:
    """Feel paths, their vibrations with other random numbers again and again."""
    power: list[Array] = []
    recordings: list[Recording] = []
    for k in range(seed_count):
        renderer.seed = seed + k
        recordings = forces(renderer, paths)
        found = [band_power(r.a_m_s2.ravel(), r.a_rate_Hz) for r in recordings]
        power = found if not power else [a + b for a, b in zip(power, found, strict=True)]
    return Felt(recordings, [p / seed_count for p in power])


def band_power(a_m_s2: Array, rate_Hz: float) -> Array:
    """Mean squares (w, k) [(m/s²)²] in the bands of `perception.band_edges_Hz`, in windows that overlap by half."""
    size = round(WINDOW_S * rate_Hz)
    padded = np.pad(a_m_s2, (0, max(size - len(a_m_s2), 0)))
    windows = np.lib.stride_tricks.sliding_window_view(padded, size)[:: size // 2]
    shape = np.hanning(size)
    density = 2.0 * np.abs(np.fft.rfft(windows * shape, axis=1)) ** 2 / (size * np.sum(shape**2))
    total = np.concatenate((np.zeros((len(windows), 1)), np.cumsum(density, axis=1)), axis=1)
    edges = band_edges_Hz() / (rate_Hz / size) + 0.5  # a line stands for half a step to either side of it
    below = np.minimum(edges.astype(int), total.shape[1] - 2)
    at = total[:, below] + (edges - below) * (total[:, below + 1] - total[:, below])
    return np.asarray(np.diff(at, axis=1))


@dataclass(frozen=True)
class Error:
    """How far a scene is from the true one, in the ticks of contact (n,) [JND], and what was touched in them."""

    force_jnd: Array
    vibration_jnd: Array
    body: NDArray[np.int32]
    swatch: NDArray[np.int32]

    @property
    def total_jnd(self) -> Array:
        """The larger of the two."""
        return np.maximum(self.force_jnd, self.vibration_jnd)


def error_of(true: Felt, felt: Felt, reach_m_s2: Array) -> Error:
    """How far what is felt is from the true one; of vibrations, no more than `reach_m_s2` (k,) that a handle gives."""
    parts: list[tuple[Array, ...]] = []
    for a, b, one, two in zip(true.recordings, felt.recordings, true.power, felt.power, strict=True):
        window = bands_jnd(np.minimum(np.sqrt(two), reach_m_s2), np.minimum(np.sqrt(one), reach_m_s2), band_edges_Hz())
        middle = np.rint((np.arange(len(a)) * TICK_S - 0.5 * WINDOW_S) / (0.5 * WINDOW_S)).astype(int)
        vibration = window[np.clip(middle, 0, len(window) - 1)]
        on = a.touching | b.touching
        at = np.where(a.touching, a.body, b.body), np.where(a.touching, a.swatch, b.swatch)
        parts.append((force_jnd(b.f_W_N, a.f_W_N)[on], vibration[on], at[0][on], at[1][on]))
    return Error(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def joined(errors: Sequence[Error]) -> Error:
    """Errors of several sets of paths as one."""
    return Error(*(np.concatenate([vars(error)[name] for error in errors]) for name in vars(errors[0])))


def tick_us(renderer: Renderer, paths: Sequence[Array], budget_us: float) -> Array:
    """Times of the ticks in contact (n,) [µs], each the least of `REPEATS` runs.

    Of three times as many runs where the worst is over the budget otherwise: other programs only make it longer.
    """
    forces(renderer, paths)
    least = np.inf
    for _ in range(3):
        for _ in range(REPEATS):
            runs = forces(renderer, paths)
            on = np.concatenate([r.touching for r in runs])
            least = np.minimum(least, np.concatenate([r.tick_ns for r in runs])[on] * 1e-3)
        if np.percentile(least, WORST) <= budget_us:
            break
    return np.asarray(least)


def memory_B(renderer: Renderer) -> int:
    """What a renderer takes [bytes]: its arrays, and what Embree builds over each mesh, by `EMBREE_B`."""
    arrays = [value for part in (renderer.world, renderer.surface) for value in part if isinstance(value, np.ndarray)]
    faces = {id(body.mesh): len(body.mesh.faces) for body in renderer._bodies}
    return sum(array.nbytes for array in arrays) + EMBREE_B * sum(faces.values())


def seconds(work: Callable[[], object]) -> float:
    """The least time that something takes, of four [s]."""
    least = np.inf
    for _ in range(4):
        start_s = time.perf_counter()
        work()
        least = min(least, time.perf_counter() - start_s)
    return least


def limits_here(device: str) -> Limits:
    """Limits of a device at the renderer's own rate."""
    return limits_of(device, TICK_S)


RATE_HZ: Final = ACCELERATION_RATE_HZ
"""Rate at which vibrations are judged [Hz]."""
