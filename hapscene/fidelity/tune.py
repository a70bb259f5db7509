"""No more than a scene needs: the coarsest meshes and shortest filters that cannot be told from the scene as it is.

Each body is reduced by halves and each texture's order by bisection until a person would notice on paths drawn for
that; effects that nobody could feel with this device are left out. On other paths it is then checked, and taken back by
a step where it does not hold, and on others again it is told how far the choice is from the scene as it is.

Pieces of work are a body or a swatch (`hapscene.parallel`); what is timed is timed alone, here, at the end.
"""

import math
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache, partial
from typing import Any, Final

import numpy as np

from hapscene import __version__
from hapscene.device.model import device_named
from hapscene.errors import HapsceneError, PathError
from hapscene.fidelity import trial
from hapscene.fidelity.apply import apply_level
from hapscene.fidelity.coarser_mesh import coarser_mesh
from hapscene.fidelity.fidelity import BodyFidelity, Fidelity, Level, SwatchFidelity
from hapscene.fidelity.trial import Array
from hapscene.motion.look_from_above import UNSEEN
from hapscene.native import INTERPRETED
from hapscene.parallel import Task, run_tasks
from hapscene.perception import (
    FLUCTUATION_DB,
    FORCE,
    FORCE_LEAST_N,
    FRICTION,
    band_edges_Hz,
    band_rms_m_s2,
    bands_jnd,
    is_felt,
)
from hapscene.renderer import EFFECTS, Renderer
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import swatches_of
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.effect_registry import load_effect
from hapscene.surface.swatch import Swatch

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
"""Lowest order that is tried [count]; below it a texture is left out altogether."""

PLACES: Final = 6
"""Forces and speeds at which a texture is judged [count] each."""

UPDATES: Final = (16, 8, 4)
"""Ticks between two updates of a texture's filter that are tried [count], the slowest first."""

SPEED_M_S: Final = 0.5
"""Fastest stroke or tap that is reckoned with [m/s]."""

LINES: Final = 4096
"""Lines of the spectrum by which a texture's models are compared [count]: of 1.2 Hz at 10 kHz."""

TAP_S: Final = 0.1
"""Over which a tap is felt [s]."""

LEAVING: Final = ("life", "lpc_texture", "tap", "friction")
"""Effects in the order in which they are given up where time is short: what carries least of the shape first."""


@dataclass(frozen=True)
class Source:
    """Where the scene is from: what `hapscene.touch.open_scene` takes, so that every process can open it."""

    path: str
    unit: str | None = None
    swatch: str | None = None
    two_sided: bool = False
    accept_damaged: bool = False
    up: str | None = None
    scale: float = 1.0


@dataclass(frozen=True)
class Choice:
    """What was chosen for a body or a swatch.

    Attributes:
        kind: "body" or "swatch".
        name: its own.
        what: from what to what, in words.
        error_jnd: within it in `WITHIN` % of its ticks in contact on unseen paths; None where it was not touched.
        saved: what it saves: "memory_B", "load_s", "tick_us".
        why: in words, for --explain.
    """

    kind: str
    name: str
    what: str
    error_jnd: float | None
    saved: Mapping[str, float]
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


# Pieces of work, in whichever process: arguments and results are what JSON can hold.


@lru_cache(maxsize=1)
def opened(source: Source) -> Scene:
    """The scene, opened once in a process."""
    from hapscene.touch import open_scene

    with trial.quietly():
        return open_scene(**asdict(source))


def judge_body(source: dict[str, Any], name: str, device: str, seed: int, most_jnd: float) -> dict[str, Any]:
    """Errors of a body's mesh: "tried", rows of faces asked for, faces it then had and error [JND], most faces first.

    Goes on until the error is over `most_jnd`, and then between the last two; "seen" is whether anything was touched.
    """
    scene = opened(Source(**source))
    body = scene.body(name)
    paths = trial.body_paths(scene, name, seed, device)
    tried: list[tuple[int, int, float]] = []
    if not paths or len(body.mesh.faces) < FACES_MIN:
        return {"seen": bool(paths), "tried": tried}
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
        at = felt(mesh)
        made = float(np.percentile(trial.force_error(true, at), WITHIN)) if any(r.touching.any() for r in true) else 0.0
        tried.append((count, len(mesh.faces), made))
        return made

    good, bad = 0.0, HALVINGS + 1.0
    for k in range(1, HALVINGS + 1):
        if error(k) > most_jnd:
            bad = k
            break
        good = k
    for _ in range(BISECTIONS if bad <= HALVINGS else 0):
        middle = 0.5 * (good + bad)
        good, bad = (middle, bad) if error(middle) <= most_jnd else (good, middle)
    return {"seen": True, "tried": sorted(tried, reverse=True)}


def judge_swatch(source: dict[str, Any], name: str, device: str, reach_m_s2: list[float], most_jnd: float) -> Any:
    """What a swatch needs: "order" and its "error" [JND], "left_out" and why.

    A texture of lower order is held against its own by the levels in bands, over the forces and speeds that the device
    and its models reach.
    """
    swatch = next(s for s in opened(Source(**source)).swatches if s.name == name)
    limits, reach = trial.limits_here(device), np.asarray(reach_m_s2)
    force_N = min(limits.force_N, 10.0)
    left_out, why = unfelt(swatch, device, reach)
    tried: dict[int, float] = {}
    if swatch.texture is not None and "lpc_texture" not in left_out:
        texture = swatch.texture
        places = np.meshgrid(
            np.linspace(1 / PLACES, 1.0, PLACES) * min(force_N, texture.force_max_N),
            np.linspace(1 / PLACES, 1.0, PLACES) * min(SPEED_M_S, texture.speed_max_m_s),
        )
        true = np.minimum(texture_rms(swatch, *map(np.ravel, places)), reach)

        def error(order: int) -> float:
            if order not in tried:
                at = replace(swatch, texture=texture.truncated(order))
                rms = np.minimum(texture_rms(at, *map(np.ravel, places)), reach)
                tried[order] = float(np.percentile(bands_jnd(rms, true, band_edges_Hz()), WITHIN))
            return tried[order]

        low, high = ORDER_MIN - 1, texture.order  # too low, high enough
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if error(middle) <= most_jnd else (middle, high)
    return {"tried": sorted(tried.items(), reverse=True), "left_out": left_out, "why": why}


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


def unfelt(swatch: Swatch, device: str, reach_m_s2: Array) -> tuple[list[str], dict[str, str]]:
    """Effects of a swatch that nobody could feel with a device, and for each effect of it why, or why not."""
    limits, edges = trial.limits_here(device), band_edges_Hz()
    force_N = min(limits.force_N, 10.0)
    left_out, why = [], {}
    if swatch.texture is not None:
        texture = swatch.texture
        share = math.inf if np.any(texture.exponents > 0.0) else 1.0  # of the largest recorded
        loudest = min(force_N, share * texture.force_max_N), min(SPEED_M_S, share * texture.speed_max_m_s)
        rms = np.minimum(texture_rms(swatch, *(np.array([v]) for v in loudest)).max(axis=0), reach_m_s2)
        felt = is_felt(rms, edges)
        where = f"at {loudest[0]:.2g} N and {loudest[1]:.2g} m/s it vibrates by {np.sqrt(np.sum(rms**2)):.2g} m/s²"
        why["lpc_texture"] = f"{where}, which {'is felt' if felt else 'nobody feels'}"
        left_out += [] if felt else ["lpc_texture"]
        if felt and texture.log_spread > 0.0:
            spread_dB = 20.0 / math.log(10.0) * texture.log_spread
            spread_dB *= swatch.parameter("lpc_texture", "texture_life", 1.0)
            felt = spread_dB >= FLUCTUATION_DB
            why["life"] = f"its level varies by {spread_dB:.2g} dB, which {'is felt' if felt else 'nobody feels'}"
            left_out += [] if felt else ["life"]
    struck = [taps for taps in (swatch.taps, swatch.leaving) if taps is not None]
    if struck:
        fastest = min(max(float(taps.approach_m_s[-1]) for taps in struck), SPEED_M_S)
        count = round(TAP_S * trial.RATE_HZ)
        rms = np.zeros(len(edges) - 1)
        for taps in struck:
            a_m_s2 = swatch.parameter("tap", "tap_gain", 1.0) * taps.transient(fastest, trial.RATE_HZ)[:count]
            a_m_s2 = np.pad(a_m_s2, (0, count - len(a_m_s2)))
            here = band_rms_m_s2(a_m_s2, trial.RATE_HZ, edges, window="boxcar")  # no window: it is loudest at its start
            rms = np.maximum(rms, here)
        felt = is_felt(np.minimum(rms, reach_m_s2), edges)
        why["tap"] = f"a tap at {fastest:.2g} m/s {'is felt' if felt else 'nobody feels'}"
        left_out += [] if felt else ["tap"]
    if swatch.friction_static > 0.0:
        point = device_named(device).point
        own_N = 0.0 if point is None else point.c_N
        fast = swatch.friction_dynamic + swatch.friction_viscous_s_m * SPEED_M_S
        most_N = max(swatch.friction_static, fast) * force_N
        least_N = max(FORCE * FORCE_LEAST_N, FRICTION * own_N)
        told = f"friction of {most_N:.2g} N at most, over {least_N:.2g} N, the JND beside the device's own"
        why["friction"] = told if most_N >= least_N else told.replace("over", "under")
        left_out += [] if most_N >= least_N else ["friction"]
    return left_out, why


# The choice.


@dataclass
class _Plan:
    """What is chosen so far: meshes and orders, from which a level is made."""

    meshes: dict[str, Mesh] = field(default_factory=dict)
    orders: dict[str, int] = field(default_factory=dict)
    updates: dict[str, int] = field(default_factory=dict)
    left_out: dict[str, list[str]] = field(default_factory=dict)

    def level(self, told: Mapping[str, float] | None = None) -> Level:
        names = {*self.orders, *self.updates, *(name for name, effects in self.left_out.items() if effects)}
        swatches = {
            name: SwatchFidelity(
                self.orders.get(name), self.updates.get(name, 1), tuple(sorted(self.left_out.get(name, [])))
            )
            for name in sorted(names)
        }
        return Level({name: BodyFidelity(mesh) for name, mesh in self.meshes.items()}, swatches, told or {})

    def copy(self) -> "_Plan":
        lists = {name: list(effects) for name, effects in self.left_out.items()}
        return _Plan(dict(self.meshes), dict(self.orders), dict(self.updates), lists)


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
    feeling: _Feeling, judged: Mapping[str, Any], jnd: float, say: Callable[[str], None]
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
            plan.updates = dict(updates)
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
    source: Source,
    *,
    device: str = "omni",
    handle: str = "ideal",
    budget_us: float = 50.0,
    jnd: float = 1.0,
    seed: int = 0,
    jobs: int | None = None,
    scheduler: str | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> Tuned:
    """Measure a scene on this machine, and choose how finely to render it.

    Args:
        source: the scene.
        device: a name of `hapscene.device.DEVICES`, whose limits hold.
        handle: what vibrates: "ideal", which gives all that is asked for; "none"; or a .handle file, identified.
        budget_us: most that the worst tick may take [µs]: `trial.WORST` % of the ticks in contact, each the least of
            `trial.REPEATS` runs, of three times as many where that is over it. Where it cannot be had within the JND it
            is held beyond it.
        jnd: most that the chosen scene may differ from the untuned one [JND], in `WITHIN` % of ticks in contact.
        seed: of the paths.
        jobs, scheduler: as `hapscene.parallel.run_tasks` has them.
        say: is given the progress.

    Raises:
        PathError: nothing of the scene can be touched from above.
        HapsceneError: an unknown device or handle, or what reduces meshes is missing; under NUMBA_DISABLE_JIT=1, where
            times mean nothing.
    """
    from hapscene.touch import step

    if INTERPRETED:
        raise HapsceneError("tune times compiled code: run it without NUMBA_DISABLE_JIT")
    reach = reach_m_s2(handle)
    scene = opened(source)
    with step(say, "readying the scene"):
        whole = trial.ready(scene, device)
    with step(say, "drawing paths"):
        if not trial.scene_paths(scene, seed + 1, device):
            raise PathError(f"nothing of the scene is felt by this device: {UNSEEN}")
    judged = _judged(source, scene, device, reach, seed, jnd, jobs, scheduler, say)
    felt = _Feeling(scene, whole, device, reach, seed)
    plan, most_jnd, unseen, final = _settled(felt, judged, jnd, say)
    paths = unseen[0]
    with step(say, "timing"):
        before = _cost(scene, Level(), device, paths)
        after = first = _cost(scene, plan.level(), device, paths, budget_us)
        # a ray takes as long in few faces as in many, so meshes are the last to go
        while after["tick_worst_us"] > budget_us and (
            _shorter(scene, plan) or _leave_out(scene, plan) or _coarser(scene, plan)
        ):
            after = _cost(scene, plan.level(), device, paths, budget_us)
    final = final if after is first else felt.error([unseen], plan)
    choices = _choices(scene, plan, judged, final, device, paths, most_jnd)
    level = plan.level({**_told(final, jnd), **after})
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


def _judged(
    source: Source, scene: Scene, device: str, reach: Array, seed: int, jnd: float, jobs: int | None,
    scheduler: str | None, say: Callable[[str], None],
) -> dict[str, Any]:  # fmt: skip
    """What was found of each body and each painted swatch, by "body NAME" and "swatch NAME"."""
    told = {"source": vars(source), "device": device}
    pieces = [
        Task(f"body {name}", judge_body, {**told, "name": name, "seed": seed, "most_jnd": MARGINS[0] * jnd})
        for name in trial.felt_bodies(scene)
    ]
    more = {"reach_m_s2": np.minimum(reach, 1e9).tolist(), "most_jnd": MARGINS[0] * jnd}
    pieces += [
        Task(f"swatch {swatch.name}", judge_swatch, {**told, **more, "name": swatch.name})
        for swatch in painted(scene)
    ]
    return run_tasks(
        pieces, jobs=jobs, scheduler=scheduler, after=lambda done, count, key: say(f"{key}: {done} of {count}\n")
    )


def painted(scene: Scene) -> list[Swatch]:
    """The swatches that the scene is painted with anywhere."""
    used = {int(index) for body in scene.bodies for index in swatches_of(body)}
    return [swatch for index, swatch in enumerate(scene.swatches) if index in used]


def _failed(scene: Scene, judged: Mapping[str, Any], error: trial.Error, jnd: float) -> list[str]:
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


def _planned(scene: Scene, judged: Mapping[str, Any], most_jnd: Mapping[str, float]) -> _Plan:
    """The least of all that was tried and keeps to an error."""
    plan = _Plan()
    for name in trial.felt_bodies(scene):
        good = [row for row in judged[f"body {name}"]["tried"] if row[2] <= most_jnd[f"body {name}"]]
        if good:
            mesh = _reduced(scene, scene.body(name), min(good)[0])
            assert mesh is not None  # as it was when it was judged
            plan.meshes[name] = mesh
    for swatch in painted(scene):
        found = judged[f"swatch {swatch.name}"]
        plan.left_out[swatch.name] = list(found["left_out"])
        good = [order for order, error in found["tried"] if error <= most_jnd[f"swatch {swatch.name}"]]
        if good and "lpc_texture" not in found["left_out"]:
            plan.orders[swatch.name] = min(good)
    return plan


def _slow_updates(
    scene: Scene, plan: _Plan, error: Callable[[_Plan], trial.Error], most_jnd: Mapping[str, float]
) -> dict[str, int]:
    """After how many ticks each texture's filter may follow force and speed, so that nobody notices."""
    sounding = [s.name for s in painted(scene) if s.texture is not None and "lpc_texture" not in plan.left_out[s.name]]
    left, updates = set(sounding), dict[str, int]()
    for ticks in UPDATES:
        if not left:
            break
        slow = plan.copy()
        slow.updates.update(dict.fromkeys(left, ticks))
        found = error(slow)
        for name in sorted(left):
            on = found.swatch == [s.name for s in scene.swatches].index(name)
            if on.any() and np.percentile(found.vibration_jnd[on], WITHIN) <= most_jnd[f"swatch {name}"]:
                updates[name] = ticks
                left.discard(name)
    return updates


def _shorter(scene: Scene, plan: _Plan) -> bool:
    """Halve the order of every texture; False where none is left to be halved."""
    done = False
    for swatch in painted(scene):
        if swatch.texture is None or "lpc_texture" in plan.left_out[swatch.name]:
            continue
        order = plan.orders.get(swatch.name, swatch.texture.order)
        if order > ORDER_MIN:
            plan.orders[swatch.name], done = max(order // 2, ORDER_MIN), True
    return done


def _coarser(scene: Scene, plan: _Plan) -> bool:
    """Halve the mesh of every body; False where none is left to be halved."""
    done = False
    for name in trial.felt_bodies(scene):
        count = len(plan.meshes.get(name, scene.body(name).mesh).faces)
        mesh = _reduced(scene, scene.body(name), count // 2) if count >= FACES_MIN else None
        if mesh is not None and len(mesh.faces) < 0.8 * count:
            plan.meshes[name], done = mesh, True
    return done


def _leave_out(scene: Scene, plan: _Plan) -> bool:
    """Leave an effect out of every swatch; False where none is left that is not the shape itself."""
    for effect in LEAVING:
        having = [s.name for s in painted(scene) if effect in _effects_of(s) and effect not in plan.left_out[s.name]]
        for name in having:
            plan.left_out[name].append(effect)
        if having:
            return True
    return False


def _effects_of(swatch: Swatch) -> list[str]:
    has = {
        "life": swatch.texture is not None and swatch.texture.log_spread > 0.0,
        "lpc_texture": swatch.texture is not None,
        "tap": swatch.taps is not None or swatch.leaving is not None,
        "friction": swatch.friction_static > 0.0,
    }
    return [effect for effect, there in has.items() if there]


def _cost(scene: Scene, level: Level, device: str, paths: list[Array], budget_us: float = math.inf) -> dict[str, float]:
    """What a level costs on this machine, by the names of `Level.told`."""
    load_s = trial.seconds(lambda: trial.ready(apply_level(scene, level), device))
    renderer = trial.ready(apply_level(scene, level), device)
    times, _ = trial.tick_us(renderer, paths, budget_us)
    median, p99, worst = (round(float(v), 3) for v in np.percentile(times, (50, 99, trial.WORST)))
    faces = sum(len(body.mesh.faces) for body in renderer._bodies)
    cost = {"tick_median_us": median, "tick_p99_us": p99, "tick_worst_us": worst, "load_s": round(load_s, 4)}
    return {**cost, "memory_B": trial.memory_B(renderer), "faces": faces}


def _told(error: trial.Error, jnd: float) -> dict[str, float]:
    """An error as a level tells it: `WITHIN` % of the ticks keep to each; and the share that keeps to what is asked."""
    parts = {"error_jnd": error.total_jnd, "force_jnd": error.force_jnd, "vibration_jnd": error.vibration_jnd}
    told = {name: round(float(np.percentile(part, WITHIN)), 3) for name, part in parts.items()}
    return {**told, "share_within": round(float(np.mean(error.total_jnd <= jnd)), 4)}


def _choices(
    scene: Scene, plan: _Plan, judged: Mapping[str, Any], final: trial.Error, device: str, paths: list[Array],
    most_jnd: Mapping[str, float],
) -> list[Choice]:  # fmt: skip
    """Each choice with what it costs and saves."""
    tuned = apply_level(scene, plan.level())
    made = []
    for index, body in enumerate(scene.bodies):
        own, now = (trial.alone(one, body.name) for one in (scene, tuned))
        counts = [len(one.bodies[0].mesh.faces) for one in (own, now)]
        load = [trial.seconds(partial(trial.ready, one, device, ("wall",))) for one in (own, now)]
        memory = [trial.memory_B(trial.ready(one, device, ("wall",))) for one in (own, now)]
        saved = (
            {"memory_B": memory[0] - memory[1], "load_s": max(load[0] - load[1], 0.0)}
            if body.name in plan.meshes
            else {}
        )
        what = f"{counts[0]:,} → {counts[1]:,} faces" if saved else f"{counts[0]:,} faces, as it is"
        why = _why_body(judged.get(f"body {body.name}"), most_jnd.get(f"body {body.name}", 0.0))
        made.append(Choice("body", body.name, what, _felt_error(final.force_jnd[final.body == index]), saved, why))
    before, after = (trial.tick_us(trial.ready(one, device), paths) for one in (scene, tuned))
    for index, swatch in enumerate(scene.swatches):
        if f"swatch {swatch.name}" not in judged:
            continue
        size = [_table_B(one.swatches[index]) for one in (scene, tuned)]
        medians = [float(np.median(times[on == index])) for times, on in (before, after) if np.any(on == index)]
        saved = {"memory_B": size[0] - size[1], **({"tick_us": medians[0] - medians[1]} if len(medians) == 2 else {})}
        what, why = _why_swatch(swatch, plan, judged[f"swatch {swatch.name}"], most_jnd[f"swatch {swatch.name}"])
        error = _felt_error(final.vibration_jnd[final.swatch == index])
        made.append(Choice("swatch", swatch.name, what, error, saved, why))
    return made


def _felt_error(error_jnd: Array) -> float | None:
    return round(float(np.percentile(error_jnd, WITHIN)), 3) if len(error_jnd) else None


def _table_B(swatch: Swatch) -> int:
    """What the effects' tables of a swatch take [bytes]."""
    tables = [effect.table for effect in map(load_effect, EFFECTS)]
    return sum(np.asarray(table(swatch, trial.RATE_HZ)).nbytes for table in tables if table is not None)


def _why_body(found: Mapping[str, Any] | None, most_jnd: float) -> str:
    """Why a body has the mesh it has, in words."""
    if found is None:
        return f"more than {trial.BODY_MAX} bodies, of which the largest are judged: it stays as it is"
    if not found["seen"]:
        return "none of it is seen from above, as it stands or turned: it stays as it is"
    if not found["tried"]:
        return "it has so few faces, or all of them at borders, that there is nothing to be won"
    errors = {faces: error for _, faces, error in found["tried"]}
    told = [f"at {faces:,} faces the force is {error:.2g} JND off" for faces, error in errors.items()]
    return f"asked for {most_jnd:.2g} JND on the paths to choose by; " + ", ".join(told)


def _why_swatch(swatch: Swatch, plan: _Plan, found: Mapping[str, Any], most_jnd: float) -> tuple[str, str]:
    """What a swatch has, and why, in words."""
    words, why = [], list(found["why"].values())
    left_out = plan.left_out[swatch.name]
    if swatch.texture is not None and "lpc_texture" not in left_out:
        own, order = swatch.texture.order, plan.orders.get(swatch.name, swatch.texture.order)
        words.append(f"order {own} → {order}" if order < own else f"order {own}")
        ticks = plan.updates.get(swatch.name, 1)
        words += [f"its filter follows every {ticks} ticks"] if ticks > 1 else []
        told = [f"order {p} is {error:.2g} JND off" for p, error in found["tried"]]
        why += [f"asked for {most_jnd:.2g} JND: " + ", ".join(told)] if told else []
    words += [f"without {effect}" for effect in left_out]
    given_up = [effect for effect in left_out if effect not in found["left_out"]]
    why += [f"{effect} is felt, and given up for the budget" for effect in given_up]
    return ", ".join(words) or "as it is", "; ".join(why) or "it has no texture, tap or friction"
