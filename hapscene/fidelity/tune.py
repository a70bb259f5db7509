"""Search for the simplest level of detail that cannot be distinguished from the original scene.

The faces of each body are halved, and the order of each texture is bisected, until the difference on a set of paths
becomes perceptible. The choice is then verified on other paths, and made less aggressive where it fails; the
reported difference is measured on a third set.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np

from hapscene.compiled.native import INTERPRETED
from hapscene.errors import HapsceneError, PathError, SceneError
from hapscene.fidelity import trial
from hapscene.fidelity.coarser_mesh import coarser_mesh
from hapscene.fidelity.trial import Array
from hapscene.motion.look_from_above import UNSEEN
from hapscene.perception import band_edges_Hz, bands_jnd
from hapscene.render.renderer import Renderer
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import swatches_of
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch

__all__ = ["HALVINGS", "WITHIN", "Simplification", "Tuned", "evaluate_swatch", "painted", "simplified", "tune"]

WITHIN: Final = 95.0
"""Share of the ticks in contact in which the difference must not exceed the limit [%]."""

CHECKS: Final = 3
"""Most sets of paths for verification [count]. If the choice fails on the test set, that set joins them, and a new
test set is drawn."""

MARGINS: Final = (0.8, 0.6, 0.3, 0.0)
"""Fractions of the limit that a body or swatch may use in the search [1]; the next one is used if verification
fails."""

HALVINGS: Final = 6
"""Most halvings of the number of faces [count]."""

BISECTIONS: Final = 3
"""Bisections between the last two halvings [count], to 9 % of the faces."""

FACES_MIN: Final = 500
"""Number of faces below which a mesh is not reduced, since nothing is gained [count]."""

ORDER_MIN: Final = 2
"""Lowest texture order of the search [count]."""

PLACES: Final = 6
"""Number of forces and of speeds at which a texture is compared [count]."""

FORCE_N, SPEED_M_S = 10.0, 0.5
"""Largest force and speed at which a texture is compared."""

LINES: Final = 4096
"""Spectral lines by which the models of a texture are compared [count]; 1.2 Hz apart at 10 kHz."""


@dataclass(frozen=True)
class Choice:
    """The choice for a body or a swatch.

    Attributes:
        kind: "body" or "swatch".
        name: its name.
        what: description of the change, or the reason for no change.
        error_jnd: difference that `WITHIN` % of its ticks in contact do not exceed on test paths; None if it was not
            touched.
    """

    kind: str
    name: str
    what: str
    error_jnd: float | None


@dataclass(frozen=True)
class Tuned:
    """The result of `tune`.

    Attributes:
        scene: the simplified scene.
        choices: the choice for each body and swatch.
        before, after: cost of the original and of the simplified scene by name: time of a tick [µs], memory [bytes],
            loading time [s], faces; `after` also has the differences [JND].
        within_jnd: whether the limit is kept.
    """

    scene: Scene
    choices: list[Choice]
    before: Mapping[str, float]
    after: Mapping[str, float]
    within_jnd: bool


class Simplification(NamedTuple):
    """What is simplified in a scene. Bodies and swatches that are not named are unchanged.

    Attributes:
        meshes: coarser meshes by name of the body, whose groups are the swatches of the scene (`coarser_mesh`). A mesh
            without groups takes the swatch of a body that has only one.
        orders: orders of the texture models by name of the swatch.
    """

    meshes: Mapping[str, Mesh] = {}
    orders: Mapping[str, int] = {}


def simplified(scene: Scene, what: Simplification) -> Scene:
    """Return the simplified scene, with the same bodies and swatches in the same order and at the same poses.

    A texture of lower order uses the first reflection coefficients of each model (`Texture.truncated`).

    Raises:
        SceneError: a coarser mesh without painting.
        SwatchError: an order below 1.
    """
    made = scene.copy()
    names = tuple(swatch.name for swatch in scene.swatches)
    for body in made.bodies:
        mesh = what.meshes.get(body.name, body.mesh)
        if mesh is body.mesh:
            continue
        if mesh.group is not None and mesh.group_names == names:
            body.face_swatch = mesh.group.copy()
        elif np.all(body.face_swatch == body.face_swatch[0]):
            body.face_swatch = np.full(len(mesh.faces), body.face_swatch[0])
        else:
            raise SceneError(f"the coarser mesh of body {body.name!r} has no painting")
        body.mesh = mesh
    for index, name in enumerate(names):
        texture = scene.swatches[index].texture
        if name in what.orders and texture is not None:
            made.swatches[index] = replace(scene.swatches[index], texture=texture.truncated(what.orders[name]))
            made.swatch_source[index] = None
    return made


class Evaluation(NamedTuple):
    """What was tried for a body or swatch: numbers of faces or orders with their differences [JND], the finest first;
    or the reason for an empty list."""

    tried: list[tuple[int, float]]
    why_not: str

    def least(self, most_jnd: float) -> int | None:
        """The smallest candidate whose difference does not exceed a limit; or None."""
        return min((count for count, error_jnd in self.tried if error_jnd <= most_jnd), default=None)


def evaluate_body(scene: Scene, name: str, device: str, seed: int, most_jnd: float) -> Evaluation:
    """Measure the difference of coarser meshes of a body until it exceeds `most_jnd`, then bisect between the last
    two."""
    body = scene.body(name)
    paths = trial.body_paths(scene, name, seed, device)
    tried: list[tuple[int, float]] = []
    if not paths or len(body.mesh.faces) < FACES_MIN:
        return Evaluation([], "no path from above touches the body" if not paths else "the mesh has few faces")
    single_body_scene = trial.single_body_scene(scene, name)

    def rendered(mesh: Mesh) -> Any:
        at = simplified(single_body_scene, Simplification({name: mesh}))
        return trial.render_paths(trial.new_renderer(at, device, ("wall", "friction")), paths)

    true = rendered(body.mesh)

    def error(halvings: float) -> float:
        count = round(len(body.mesh.faces) * 0.5**halvings)
        mesh = _reduced(scene, body, count)
        if mesh is None:
            return math.inf
        touched = any(r.touching.any() for r in true)
        error_jnd = float(np.percentile(trial.force_error(true, rendered(mesh)), WITHIN)) if touched else 0.0
        tried.append((count, error_jnd))
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
    return Evaluation(sorted(tried, reverse=True), "" if tried else "its painting is as fine as its faces or finer")


def evaluate_swatch(swatch: Swatch, device: str, most_jnd: float) -> Evaluation:
    """Measure the difference of lower orders of a texture.

    Its levels in bands are compared with those of the original, over the forces and speeds that device and models
    reach.
    """
    texture = swatch.texture
    if texture is None:
        return Evaluation([], "the swatch has no texture")
    share = np.linspace(1 / PLACES, 1.0, PLACES)
    force_N = share * min(trial.device_limits(device).force_N, FORCE_N, texture.force_max_N)
    places = [np.ravel(grid) for grid in np.meshgrid(force_N, share * min(SPEED_M_S, texture.speed_max_m_s))]
    true = texture_rms(swatch, *places)
    tried = list[tuple[int, float]]()
    low, high = ORDER_MIN - 1, texture.order  # low is too low, high is sufficient
    while high - low > 1:
        order = (low + high) // 2
        rms = texture_rms(replace(swatch, texture=texture.truncated(order)), *places)
        error_jnd = float(np.percentile(bands_jnd(rms, true, band_edges_Hz()), WITHIN))
        tried.append((order, error_jnd))
        low, high = (low, order) if error_jnd <= most_jnd else (order, high)
    return Evaluation(sorted(tried, reverse=True), "" if tried else "the order is already the lowest")


def _reduced(scene: Scene, body: Body, count: int) -> Mesh | None:
    return coarser_mesh(body, count, [swatch.name for swatch in scene.swatches])


def texture_rms(swatch: Swatch, force_N: Array, speed_m_s: Array) -> Array:
    """Root mean squares (n, k) in bands [m/s²] of a texture at forces and speeds (n,)."""
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


_Set = tuple[list[Array], trial.Rendered]
"""Paths, and the original scene rendered along them."""


class _Comparison:
    """Renders a scene along random paths, in its original form and simplified."""

    def __init__(self, scene: Scene, original: Renderer, device: str, seed: int) -> None:
        self.scene, self._original, self._device, self._seed = scene, original, device, seed

    def drawn(self, k: int) -> _Set:
        """The k-th set of paths."""
        paths = trial.scene_paths(self.scene, self._seed + k, self._device)
        return paths, trial.render(self._original, paths, self._seed, trial.SEED_COUNT)

    def error(self, sets: Sequence[_Set], plan: Simplification) -> trial.Error:
        """Difference between the simplified and the original scene."""
        renderer = trial.new_renderer(simplified(self.scene, plan), self._device)
        pairs = [(true, trial.render(renderer, paths, self._seed, trial.SEED_COUNT)) for paths, true in sets]
        return trial.concatenated([trial.error_of(true, found) for true, found in pairs])


def _choose(
    comparison: _Comparison, judged: Mapping[str, Evaluation], jnd: float, say: Callable[[str], None]
) -> tuple[Simplification, _Set, trial.Error]:
    """Return the plan that passes verification, the test paths, and the difference on them.

    If a choice fails, it is repeated with a smaller margin, and the paths join those of the verification.
    """
    from hapscene.touch import step

    scene, margins = comparison.scene, dict.fromkeys(judged, 0)
    with step(say, "rendering the original scene"):
        checks, unseen = [comparison.drawn(1)], comparison.drawn(2)
    most_jnd = {key: MARGINS[0] * jnd for key in judged}
    while True:
        with step(say, "verifying the choice on other paths"):
            plan = _planned(scene, judged, most_jnd)
            checked = comparison.error(checks, plan)
            failed = _failed(scene, judged, checked, jnd)
            if not failed and np.percentile(checked.total_jnd, WITHIN) > jnd:
                failed = list(judged)
            failed = [key for key in failed if margins[key] + 1 < len(MARGINS)]
            for key in failed:
                margins[key] += 1
                most_jnd[key] = MARGINS[margins[key]] * jnd
            if failed:
                continue
            final = comparison.error([unseen], plan)
            if np.percentile(final.total_jnd, WITHIN) <= jnd or len(checks) == CHECKS:
                return plan, unseen, final
            checks, unseen = [*checks, unseen], comparison.drawn(len(checks) + 2)


def tune(
    scene: Scene,
    *,
    device: str = "omni",
    jnd: float = 1.0,
    seed: int = 0,
    say: Callable[[str], None] = lambda text: None,
) -> Tuned:
    """Simplify a scene as far as a person cannot perceive the difference, and measure both on this machine.

    Args:
        scene: the scene.
        device: name of a device in `hapscene.device.DEVICES`, whose limits apply.
        jnd: limit of the difference from the original scene [JND], in `WITHIN` % of the ticks in contact.
        seed: seed of the paths.
        say: called with lines of progress.

    Raises:
        PathError: nothing in the scene can be touched from above.
        HapsceneError: an unknown device; fast-simplification is not installed; NUMBA_DISABLE_JIT=1 is set, with which
            times are meaningless.
    """
    from hapscene.touch import step

    if INTERPRETED:
        raise HapsceneError("`tune` measures compiled code; unset the environment variable NUMBA_DISABLE_JIT")
    with step(say, "preparing the scene"):
        original = trial.new_renderer(scene, device)
    with step(say, "generating paths"):
        if not trial.scene_paths(scene, seed + 1, device):
            raise PathError(f"the device cannot touch anything in the scene: {UNSEEN}")
    judged = _evaluate(scene, device, seed, jnd, say)
    comparison = _Comparison(scene, original, device, seed)
    plan, (paths, _), final = _choose(comparison, judged, jnd, say)
    del original, comparison  # a mesh that a renderer uses is prepared already, which would hide its loading time
    made = simplified(scene, plan)
    with step(say, "measuring the time of a tick"):
        before = _cost(scene, device, paths)
        after = {**_errors(final), **_cost(made, device, paths)}
    return Tuned(made, _choices(scene, plan, judged, final), before, after, after["error_jnd"] <= jnd)


def _evaluate(scene: Scene, device: str, seed: int, jnd: float, say: Callable[[str], None]) -> dict[str, Evaluation]:
    """The evaluation of each body and each painted swatch, by "body NAME" and "swatch NAME"."""
    most_jnd, found = MARGINS[0] * jnd, {}
    for name in trial.largest_bodies(scene):
        say(f"body {name}\n")
        found[f"body {name}"] = evaluate_body(scene, name, device, seed, most_jnd)
    for swatch in painted(scene):
        found[f"swatch {swatch.name}"] = evaluate_swatch(swatch, device, most_jnd)
    return found


def painted(scene: Scene) -> list[Swatch]:
    """The swatches that are painted anywhere in the scene."""
    used = {int(index) for body in scene.bodies for index in swatches_of(body)}
    return [swatch for index, swatch in enumerate(scene.swatches) if index in used]


def _failed(scene: Scene, judged: Mapping[str, Evaluation], error: trial.Error, jnd: float) -> list[str]:
    """Keys of the bodies and swatches whose difference exceeds the limit."""
    made = []
    for keys, index, off in (
        ([f"body {body.name}" for body in scene.bodies], error.body, error.force_jnd),
        ([f"swatch {swatch.name}" for swatch in scene.swatches], error.swatch, error.vibration_jnd),
    ):
        for i, key in enumerate(keys):
            if key in judged and (index == i).any() and np.percentile(off[index == i], WITHIN) > jnd:
                made.append(key)
    return made


def _planned(scene: Scene, judged: Mapping[str, Evaluation], most_jnd: Mapping[str, float]) -> Simplification:
    """The coarsest mesh of each body and the lowest order of each swatch whose differences keep to their limits."""
    meshes, orders = {}, {}
    for name in trial.largest_bodies(scene):
        count = judged[f"body {name}"].least(most_jnd[f"body {name}"])
        mesh = None if count is None else _reduced(scene, scene.body(name), count)
        if mesh is not None:
            meshes[name] = mesh
    for swatch in painted(scene):
        order = judged[f"swatch {swatch.name}"].least(most_jnd[f"swatch {swatch.name}"])
        if order is not None:
            orders[swatch.name] = order
    return Simplification(meshes, orders)


def _cost(scene: Scene, device: str, paths: list[Array]) -> dict[str, float]:
    """The cost of a scene on this machine, by the names of `Tuned.before`."""
    load_s = trial.shortest_time_s(lambda: trial.new_renderer(scene.copy(), device))
    renderer = trial.new_renderer(scene, device)
    times = trial.tick_us(renderer, paths)
    median, p99, worst = (round(float(v), 3) for v in np.percentile(times, (50, 99, trial.WORST)))
    faces = sum(len(body.mesh.faces) for body in scene.bodies)
    cost = {"tick_median_us": median, "tick_p99_us": p99, "tick_worst_us": worst, "load_s": round(load_s, 4)}
    return {**cost, "memory_B": trial.memory_B(renderer), "faces": faces}


def _errors(error: trial.Error) -> dict[str, float]:
    """Differences by the names of `Tuned.after`: the `WITHIN` % percentiles."""
    parts = {"error_jnd": error.total_jnd, "force_jnd": error.force_jnd, "vibration_jnd": error.vibration_jnd}
    return {name: round(float(np.percentile(part, WITHIN)), 3) for name, part in parts.items()}


def _choices(scene: Scene, plan: Simplification, judged: Mapping[str, Evaluation], final: trial.Error) -> list[Choice]:
    """Each choice with its difference on test paths."""
    made = []
    for index, body in enumerate(scene.bodies):
        what = f"{len(body.mesh.faces):,} faces"
        why = f"only the {trial.BODY_MAX} largest bodies are judged"
        if f"body {body.name}" in judged:
            why = judged[f"body {body.name}"].why_not or "fewer can be felt"
        what += f" → {len(plan.meshes[body.name].faces):,}" if body.name in plan.meshes else f", unchanged: {why}"
        made.append(Choice("body", body.name, what, _error_jnd(final.force_jnd[final.body == index])))
    for index, swatch in enumerate(scene.swatches):
        if f"swatch {swatch.name}" in judged:
            error = _error_jnd(final.vibration_jnd[final.swatch == index])
            made.append(Choice("swatch", swatch.name, _what_swatch(swatch, plan), error))
    return made


def _error_jnd(error_jnd: Array) -> float | None:
    return round(float(np.percentile(error_jnd, WITHIN)), 3) if len(error_jnd) else None


def _what_swatch(swatch: Swatch, plan: Simplification) -> str:
    """Description of the choice for a swatch."""
    if swatch.texture is None:
        return "unchanged: the swatch has no texture"
    own, order = swatch.texture.order, plan.orders.get(swatch.name, swatch.texture.order)
    return f"order {own} → {order}" if order < own else f"order {own}, unchanged"
