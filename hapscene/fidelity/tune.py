"""No more than a scene needs: the coarsest meshes and shortest filters that cannot be told from the scene as it is.

Each body is reduced by halves and each texture's order by bisection until a person would notice on paths drawn for
that. On other paths the choice is then checked, and taken back by a step where it does not hold; on others again its
error is measured.
"""

import math
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np

from hapscene import __version__
from hapscene.compiled.native import INTERPRETED
from hapscene.errors import HapsceneError, PathError
from hapscene.fidelity import trial
from hapscene.fidelity.apply import apply_level
from hapscene.fidelity.coarser_mesh import coarser_mesh
from hapscene.fidelity.fidelity import BodyFidelity, Fidelity, Level, SwatchFidelity
from hapscene.fidelity.trial import Array
from hapscene.motion.look_from_above import UNSEEN
from hapscene.perception import (
    band_edges_Hz,
    bands_jnd,
)
from hapscene.render.renderer import Renderer
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import swatches_of
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch

__all__ = ["WITHIN", "Tuned", "judge_swatch", "reach_m_s2", "tune"]

WITHIN: Final = 95.0
"""Share of the ticks in contact in which an error must keep to the JND [%]."""

CHECKS: Final = 3
"""Sets of paths on which a choice is checked at most [count]: where it is too much on the one to tell by, that becomes
one of them, and another is drawn to tell by."""

MARGINS: Final = (0.8, 0.6, 0.3, 0.0)
"""Shares of the JND that a body or swatch may use on the paths to choose by [1]; the next if it is more."""

HALVINGS: Final = 6
"""How often a mesh is halved at most [count]."""

BISECTIONS: Final = 3
"""How often it is looked between the last two [count]: to 9 % of the faces."""

FACES_MIN: Final = 500
"""Faces below which a mesh is not reduced [count]: nothing is won."""

ORDER_MIN: Final = 2
"""Lowest order that is tried [count]."""

PLACES: Final = 6
"""Forces and speeds at which a texture is judged [count] each."""

UPDATES: Final = (16, 8, 4)
"""Ticks between two updates of a texture's filter that are tried [count], the slowest first."""

FORCE_N, SPEED_M_S = 10.0, 0.5
"""Largest force and speed at which a texture is judged."""

LINES: Final = 4096
"""Lines of the spectrum by which a texture's models are compared [count]: of 1.2 Hz at 10 kHz."""


@dataclass(frozen=True)
class Choice:
    """What was chosen for a body or a swatch.

    Attributes:
        kind: "body" or "swatch".
        name: its own.
        what: from what to what, in words.
        error_jnd: within it in `WITHIN` % of its ticks in contact on unseen paths; None where it was not touched.
        why: in words, for --explain.
    """

    kind: str
    name: str
    what: str
    error_jnd: float | None
    why: str


@dataclass(frozen=True)
class Tuned:
    """What was found.

    Attributes:
        fidelity: to be saved.
        choices: body by body, swatch by swatch.
        before, after: what the scene costs as it is, and as it was chosen, by the names of `Level.told`.
        within_jnd, within_budget: whether what was asked for is held.
    """

    fidelity: Fidelity
    choices: list[Choice]
    before: Mapping[str, float]
    after: Mapping[str, float]
    within_jnd: bool
    within_budget: bool


class Tried(NamedTuple):
    """A number of faces, or an order, that was asked for; what was had; and its error."""

    asked: int
    had: int
    error_jnd: float


class Judged(NamedTuple):
    """What was tried of a body or swatch, the finest first; why nothing was."""

    tried: list[Tried]
    why_not: str

    def least(self, most_jnd: float) -> int | None:
        """The least of all that keeps to an error; None where it stays as it is."""
        return min((one.asked for one in self.tried if one.error_jnd <= most_jnd), default=None)

    def why(self, what: str, most_jnd: float) -> str:
        """Why it was chosen so, in words."""
        if not self.tried:
            return f"unchanged: {self.why_not}"
        errors = ", ".join(f"{one.had:,} {what}: {one.error_jnd:.2g} JND" for one in self.tried)
        return f"asked for {most_jnd:.2g} JND on the paths to choose by; {errors}"


def judge_body(scene: Scene, name: str, device: str, seed: int, most_jnd: float) -> Judged:
    """Errors of ever coarser meshes of a body, until the error is over `most_jnd`, and then between the last two."""
    body = scene.body(name)
    paths = trial.body_paths(scene, name, seed, device)
    tried: list[Tried] = []
    if not paths or len(body.mesh.faces) < FACES_MIN:
        return Judged([], "no path from above touches it" if not paths else "it has few faces")
    alone = trial.alone(scene, name)

    def felt(mesh: Mesh | None) -> Any:
        at = apply_level(alone, Level({name: BodyFidelity(mesh)}))
        return trial.forces(trial.ready(at, device, ("wall", "friction")), paths)

    true = felt(None)

    def error(halvings: float) -> float:
        count = round(len(body.mesh.faces) * 0.5**halvings)
        mesh = _reduced(scene, body, count)
        if mesh is None:
            return math.inf
        touched = any(r.touching.any() for r in true)
        error_jnd = float(np.percentile(trial.force_error(true, felt(mesh)), WITHIN)) if touched else 0.0
        tried.append(Tried(count, len(mesh.faces), error_jnd))
        return error_jnd

    good, bad = 0.0, HALVINGS + 1.0
    for k in range(1, HALVINGS + 1):
        if error(k) > most_jnd:
            bad = k
            break
        good = k
    for _ in range(BISECTIONS if bad <= HALVINGS else 0):
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if error(middle) <= most_jnd else (good, middle)
    return Judged(sorted(tried, reverse=True), "" if tried else "its faces are all at borders")


def judge_swatch(swatch: Swatch, device: str, reach: Array, most_jnd: float) -> Judged:
    """Errors of lower orders of a swatch's texture.

    A texture of lower order is compared with its own by the levels in bands, over the forces and speeds that the device
    and its models reach.
    """
    texture = swatch.texture
    if texture is None:
        return Judged([], "it has no texture")
    share = np.linspace(1 / PLACES, 1.0, PLACES)
    force_N = share * min(trial.limits_here(device).force_N, FORCE_N, texture.force_max_N)
    places = [np.ravel(grid) for grid in np.meshgrid(force_N, share * min(SPEED_M_S, texture.speed_max_m_s))]
    true = np.minimum(texture_rms(swatch, *places), reach)
    tried = []
    low, high = ORDER_MIN - 1, texture.order  # too low, high enough
    while high - low > 1:
        order = (low + high) // 2
        rms = np.minimum(texture_rms(replace(swatch, texture=texture.truncated(order)), *places), reach)
        error_jnd = float(np.percentile(bands_jnd(rms, true, band_edges_Hz()), WITHIN))
        tried.append(Tried(order, order, error_jnd))
        low, high = (low, order) if error_jnd <= most_jnd else (order, high)
    return Judged(sorted(tried, reverse=True), "" if tried else "its order is the lowest")


def _reduced(scene: Scene, body: Body, count: int) -> Mesh | None:
    return coarser_mesh(body, count, [swatch.name for swatch in scene.swatches])


def texture_rms(swatch: Swatch, force_N: Array, speed_m_s: Array) -> Array:
    """Root mean squares (n, k) in bands [m/s²] of a texture at places (n,)."""
    texture = swatch.texture
    assert texture is not None
    line_Hz = texture.rate_Hz / (2 * LINES)
    at_Hz = line_Hz * np.arange(LINES + 1)
    density = texture.density(force_N, speed_m_s, frequency_Hz=at_Hz)
    total = np.concatenate((np.zeros((len(density), 1)), np.cumsum(line_Hz * density, axis=1)), axis=1)
    lines = np.arange(total.shape[1]) - 0.5
    edges = band_edges_Hz() / line_Hz
    gain = swatch.parameter("lpc_texture", "texture_gain", 1.0)
    return np.asarray(gain * np.sqrt(np.diff([np.interp(edges, lines, row) for row in total], axis=1)))


# The choice.


@dataclass(frozen=True)
class _Plan:
    """What is chosen so far, by name: meshes of bodies, orders of textures, ticks between updates of their filters."""

    meshes: Mapping[str, Mesh]
    orders: Mapping[str, int]
    updates: Mapping[str, int] = field(default_factory=dict)

    def level(self, cost: Mapping[str, float] | None = None) -> Level:
        swatches = {
            name: SwatchFidelity(self.orders.get(name), self.updates.get(name, 1))
            for name in sorted({*self.orders, *self.updates})
        }
        return Level({name: BodyFidelity(mesh) for name, mesh in self.meshes.items()}, swatches, cost or {})


_Set = tuple[list[Array], trial.Felt]
"""Paths, and what is felt along them of the scene as it is."""


class _Feeling:
    """A scene felt along drawn paths: as it is, and as a plan has it."""

    def __init__(self, scene: Scene, whole: Renderer, device: str, reach: Array, seed: int) -> None:
        self.scene, self._whole, self._device, self._reach, self._seed = scene, whole, device, reach, seed

    def drawn(self, k: int) -> _Set:
        """The k-th set."""
        paths = trial.scene_paths(self.scene, self._seed + k, self._device)
        return paths, trial.feel(self._whole, paths, self._seed, trial.SEED_COUNT)

    def error(self, sets: Sequence[_Set], plan: _Plan) -> trial.Error:
        """How far the plan is off the scene as it is."""
        renderer = trial.ready(apply_level(self.scene, plan.level()), self._device)
        felt = [(true, trial.feel(renderer, paths, self._seed, trial.SEED_COUNT)) for paths, true in sets]
        return trial.joined([trial.error_of(true, found, self._reach) for true, found in felt])


def _settled(
    feeling: _Feeling, judged: Mapping[str, Judged], jnd: float, say: Callable[[str], None]
) -> tuple[_Plan, dict[str, float], _Set, trial.Error]:
    """The plan that holds on paths that it was not chosen on; what each choice may differ by, those paths, the error.

    A choice that fails on them is made again with a smaller margin, and the paths join those that it is checked on.
    """
    from hapscene.touch import step

    scene, margins = feeling.scene, dict.fromkeys(judged, 0)
    with step(say, "feeling the scene as it is"):
        checks, unseen = [feeling.drawn(1)], feeling.drawn(2)
    most_jnd = {key: MARGINS[0] * jnd for key in judged}
    updates: dict[str, int] | None = None
    while True:
        with step(say, "checking the choice on other paths"):
            plan = _planned(scene, judged, most_jnd)
            if updates is None:
                updates = _slow_updates(scene, plan, partial(feeling.error, checks), most_jnd)
            plan = replace(plan, updates=dict(updates))
            checked = feeling.error(checks, plan)
            failed = _failed(scene, judged, checked, jnd)
            if not failed and np.percentile(checked.total_jnd, WITHIN) > jnd:
                failed = list(judged)
            failed = [key for key in failed if margins[key] + 1 < len(MARGINS)]
            for key in failed:
                margins[key] += 1
                most_jnd[key] = MARGINS[margins[key]] * jnd
                updates.pop(key.removeprefix("swatch "), None)
            if failed:
                continue
            final = feeling.error([unseen], plan)
            if np.percentile(final.total_jnd, WITHIN) <= jnd or len(checks) == CHECKS:
                return plan, most_jnd, unseen, final
            checks, unseen = [*checks, unseen], feeling.drawn(len(checks) + 2)


def tune(
    scene: Scene,
    *,
    device: str = "omni",
    handle: str = "ideal",
    budget_us: float = 50.0,
    jnd: float = 1.0,
    seed: int = 0,
    say: Callable[[str], None] = lambda text: None,
) -> Tuned:
    """Measure a scene on this machine, and choose how finely to render it.

    Args:
        scene: the scene.
        device: a name of `hapscene.device.DEVICES`, whose limits hold.
        handle: what vibrates: "ideal", which gives all that is asked for; "none"; or a .handle file, identified.
        budget_us: most that the worst tick may take [µs]: `trial.WORST` % of the ticks in contact, each the least of
            `trial.REPEATS` runs, of three times as many where that is over it.
        jnd: most that the chosen scene may differ from the untuned one [JND], in `WITHIN` % of ticks in contact.
        seed: of the paths.
        say: called with lines of progress.

    Raises:
        PathError: nothing of the scene can be touched from above.
        HapsceneError: an unknown device or handle, or what reduces meshes is missing; under NUMBA_DISABLE_JIT=1, where
            times mean nothing.
    """
    from hapscene.touch import step

    if INTERPRETED:
        raise HapsceneError("tune times compiled code: run it without NUMBA_DISABLE_JIT")
    reach = reach_m_s2(handle)
    with step(say, "readying the scene"):
        whole = trial.ready(scene, device)
    with step(say, "drawing paths"):
        if not trial.scene_paths(scene, seed + 1, device):
            raise PathError(f"nothing of the scene is felt by this device: {UNSEEN}")
    judged = _judge(scene, device, reach, seed, jnd, say)
    felt = _Feeling(scene, whole, device, reach, seed)
    plan, most_jnd, unseen, final = _settled(felt, judged, jnd, say)
    paths = unseen[0]
    with step(say, "timing"):
        before = _cost(scene, Level(), device, paths)
        after = _cost(scene, plan.level(), device, paths, budget_us)
    choices = _choices(scene, plan, judged, final, most_jnd)
    level = plan.level({**_errors(final, jnd), **after})
    made = {
        "device": device, "handle": handle, "budget_us": budget_us, "jnd": jnd, "seed": seed,
        "machine": f"{platform.system()} {platform.machine()}, {platform.processor() or 'unknown processor'}",
        "hapscene": __version__, "python": platform.python_version(),
        **{f"untuned_{name}": value for name, value in before.items()},
    }  # fmt: skip
    within = level.told["error_jnd"] <= jnd
    return Tuned(Fidelity(level, made), choices, before, level.told, within, after["tick_worst_us"] <= budget_us)


def reach_m_s2(handle: str) -> Array:
    """The loudest vibration (k,) in each band that a handle gives, root mean square [m/s²].

    Raises:
        HapsceneError: no such handle.
    """
    edges = band_edges_Hz()
    if handle == "ideal":
        return np.full(len(edges) - 1, np.inf)
    if handle == "none":
        return np.zeros(len(edges) - 1)
    if not handle.endswith(".handle"):
        raise HapsceneError(f"no handle {handle!r}; there are: ideal, none, or an identified one's .handle file")
    from hapscene.handle.handle_file import load_handle

    plant = load_handle(handle).plant
    middle_Hz = np.sqrt(edges[1:] * edges[:-1])
    return np.asarray(np.abs(plant.response(middle_Hz)) * plant.force_limit_N / np.sqrt(2.0))


def _judge(
    scene: Scene, device: str, reach: Array, seed: int, jnd: float, say: Callable[[str], None]
) -> dict[str, Judged]:
    """What was found of each body and each painted swatch, by "body NAME" and "swatch NAME"."""
    most_jnd, found = MARGINS[0] * jnd, {}
    for name in trial.felt_bodies(scene):
        say(f"body {name}\n")
        found[f"body {name}"] = judge_body(scene, name, device, seed, most_jnd)
    for swatch in painted(scene):
        found[f"swatch {swatch.name}"] = judge_swatch(swatch, device, reach, most_jnd)
    return found


def painted(scene: Scene) -> list[Swatch]:
    """The swatches that the scene is painted with anywhere."""
    used = {int(index) for body in scene.bodies for index in swatches_of(body)}
    return [swatch for index, swatch in enumerate(scene.swatches) if index in used]


def _failed(scene: Scene, judged: Mapping[str, Judged], error: trial.Error, jnd: float) -> list[str]:
    """The bodies and swatches that differ by more, as keys of what was judged."""
    made = []
    for keys, index, off in (
        ([f"body {body.name}" for body in scene.bodies], error.body, error.force_jnd),
        ([f"swatch {swatch.name}" for swatch in scene.swatches], error.swatch, error.vibration_jnd),
    ):
        for i, key in enumerate(keys):
            if key in judged and (index == i).any() and np.percentile(off[index == i], WITHIN) > jnd:
                made.append(key)
    return made


def _planned(scene: Scene, judged: Mapping[str, Judged], most_jnd: Mapping[str, float]) -> _Plan:
    """The coarsest mesh of each body and the lowest order of each swatch whose errors keep to theirs."""
    meshes, orders = {}, {}
    for name in trial.felt_bodies(scene):
        count = judged[f"body {name}"].least(most_jnd[f"body {name}"])
        mesh = None if count is None else _reduced(scene, scene.body(name), count)
        if mesh is not None:
            meshes[name] = mesh
    for swatch in painted(scene):
        order = judged[f"swatch {swatch.name}"].least(most_jnd[f"swatch {swatch.name}"])
        if order is not None:
            orders[swatch.name] = order
    return _Plan(meshes, orders)


def _slow_updates(
    scene: Scene, plan: _Plan, error: Callable[[_Plan], trial.Error], most_jnd: Mapping[str, float]
) -> dict[str, int]:
    """After how many ticks each texture's filter may follow force and speed, so that nobody notices."""
    left, updates = {s.name for s in painted(scene) if s.texture is not None}, dict[str, int]()
    names = [s.name for s in scene.swatches]
    for ticks in UPDATES:
        if not left:
            break
        found = error(replace(plan, updates=updates | dict.fromkeys(left, ticks)))
        for name in sorted(left):
            on = found.swatch == names.index(name)
            if on.any() and np.percentile(found.vibration_jnd[on], WITHIN) <= most_jnd[f"swatch {name}"]:
                updates[name] = ticks
        left -= updates.keys()
    return updates


def _cost(scene: Scene, level: Level, device: str, paths: list[Array], budget_us: float = math.inf) -> dict[str, float]:
    """What a level costs on this machine, by the names of `Level.told`."""
    load_s = trial.seconds(lambda: trial.ready(apply_level(scene, level), device))
    renderer = trial.ready(apply_level(scene, level), device)
    times = trial.tick_us(renderer, paths, budget_us)
    median, p99, worst = (round(float(v), 3) for v in np.percentile(times, (50, 99, trial.WORST)))
    faces = sum(len(body.mesh.faces) for body in renderer._bodies)
    cost = {"tick_median_us": median, "tick_p99_us": p99, "tick_worst_us": worst, "load_s": round(load_s, 4)}
    return {**cost, "memory_B": trial.memory_B(renderer), "faces": faces}


def _errors(error: trial.Error, jnd: float) -> dict[str, float]:
    """Errors by the names of `Level.told`: the `WITHIN` % percentiles, and the share of ticks within the JND."""
    parts = {"error_jnd": error.total_jnd, "force_jnd": error.force_jnd, "vibration_jnd": error.vibration_jnd}
    told = {name: round(float(np.percentile(part, WITHIN)), 3) for name, part in parts.items()}
    return {**told, "share_within": round(float(np.mean(error.total_jnd <= jnd)), 4)}


def _choices(
    scene: Scene, plan: _Plan, judged: Mapping[str, Judged], final: trial.Error, most_jnd: Mapping[str, float]
) -> list[Choice]:
    """Each choice, with its error on unseen paths."""
    made = []
    for index, body in enumerate(scene.bodies):
        key, count = f"body {body.name}", len(body.mesh.faces)
        what = f"{count:,} faces, unchanged"
        if body.name in plan.meshes:
            what = f"{count:,} → {len(plan.meshes[body.name].faces):,} faces"
        why = f"unchanged: only the {trial.BODY_MAX} largest bodies are judged"
        if key in judged:
            why = judged[key].why("faces", most_jnd[key])
        made.append(Choice("body", body.name, what, _error_jnd(final.force_jnd[final.body == index]), why))
    for index, swatch in enumerate(scene.swatches):
        key = f"swatch {swatch.name}"
        if key in judged:
            why = judged[key].why("coefficients", most_jnd[key])
            error = _error_jnd(final.vibration_jnd[final.swatch == index])
            made.append(Choice("swatch", swatch.name, _what_swatch(swatch, plan), error, why))
    return made


def _error_jnd(error_jnd: Array) -> float | None:
    return round(float(np.percentile(error_jnd, WITHIN)), 3) if len(error_jnd) else None


def _what_swatch(swatch: Swatch, plan: _Plan) -> str:
    """What was chosen for a swatch."""
    if swatch.texture is None:
        return "unchanged"
    own, order = swatch.texture.order, plan.orders.get(swatch.name, swatch.texture.order)
    ticks = plan.updates.get(swatch.name, 1)
    said = f"order {own} → {order}" if order < own else f"order {own}"
    return said + (f", its filter follows every {ticks} ticks" if ticks > 1 else "")
