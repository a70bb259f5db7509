"""Which model of friction: the shipped one beside the simplest, a few lines each."""

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from hapscene.constants import STIFFNESS_N_M
from hapscene.device.hand import Grip
from hapscene.device.point import PointMass
from hapscene.perception import FORCE, FORCE_LEAST_N, FRICTION
from hapscene.renderer import Renderer
from hapscene.stability.rig import AT_M, sheet
from hapscene.surface.effect import Effect, Param, State
from hapscene.surface.swatch import Swatch
from hapscene.twin.hand_intent import Intent
from hapscene.twin.twin import Twin

from .measuring import STROKES, Array, best, effect_us, measured, no_recordings, recorded
from .question import Measure, Point, Question, Setting

MASS_KG, PRESS_N, COULOMB = 0.045, 1.0, 0.3
"""The device, with what it is pressed on, and the coefficient of friction where none is recorded."""

SHAKE: Final = (0.5, 0.2, 37.0)
"""Bias and vibration along the surface, over the friction's limit [1], and how often [Hz]: case F3."""

SLIDE_M_S, KNEE_M_S = 0.1, 5e-3
"""Speed from which a tool slides to rest, and that at which tanh has risen to three quarters [m/s]."""

BLOCK_S: Final = 0.05
"""Time over which recorded and played forces are averaged [s]."""

LEAST_MM, MOST_MM, LEAST_N = 1e-6, 100.0, 1e-4
"""What less drift is drawn as, more (it has left the sheet), and less ripple."""


def sign(touch: Any, p: Any, table: Any, s: Any, out: Any) -> None:
    """Against the slip, whole from the smallest speed on."""
    speed = math.sqrt(touch.slip_W_m[0] ** 2 + touch.slip_W_m[1] ** 2 + touch.slip_W_m[2] ** 2)
    if touch.touching and speed > 0.0:
        for i in range(3):
            out.f_W_N[i] -= p.friction_dynamic * touch.normal_force_N * touch.slip_W_m[i] / speed


def tanh(touch: Any, p: Any, table: Any, s: Any, out: Any) -> None:
    """The same, rising over `KNEE_M_S`."""
    speed = math.sqrt(touch.slip_W_m[0] ** 2 + touch.slip_W_m[1] ** 2 + touch.slip_W_m[2] ** 2)
    if touch.touching and speed > 0.0:
        share = math.tanh(speed / touch.tick_s / KNEE_M_S) / speed
        for i in range(3):
            out.f_W_N[i] -= p.friction_dynamic * touch.normal_force_N * share * touch.slip_W_m[i]


def viscous(touch: Any, p: Any, table: Any, s: Any, out: Any) -> None:
    """By the speed alone."""
    if touch.touching:
        for i in range(3):
            out.f_W_N[i] -= p.drag_Ns_m * touch.slip_W_m[i] / touch.tick_s


def dahl(touch: Any, p: Any, table: Any, s: Any, out: Any) -> None:
    """A bristle whose stiffness falls as it bends (Dahl 1976): dz = dx − |dx| z k/F_c."""
    if touch.began or not touch.touching:
        s.z_W_m[0] = s.z_W_m[1] = s.z_W_m[2] = 0.0
        return
    way = math.sqrt(touch.slip_W_m[0] ** 2 + touch.slip_W_m[1] ** 2 + touch.slip_W_m[2] ** 2)
    limit_m = max(p.friction_dynamic * touch.normal_force_N, 1e-9) / p.tangential_stiffness_N_m
    left = 1.0 / (1.0 + way / limit_m)  # implicit, so that no step is too long
    for i in range(3):
        s.z_W_m[i] = left * (s.z_W_m[i] + touch.slip_W_m[i])
        out.f_W_N[i] -= p.tangential_stiffness_N_m * s.z_W_m[i]


_MU: Final = Param("friction_dynamic", 0.0, "1", "coefficient", 0.0, 10.0)
_STIFF: Final = Param("tangential_stiffness_N_m", STIFFNESS_N_M, "N/m", "stiffness of the bristle", 1.0, 1e5)

MODELS: Final[dict[str, tuple[str, str | Effect]]] = {
    "viscous": (
        "viscous",
        Effect("viscous_drag", "By speed.", viscous, params=(Param("drag_Ns_m", 0.0, "N·s/m", "drag", 0.0, 100.0),)),
    ),
    "sign": ("Coulomb, sign(v)", Effect("coulomb_sign", "By the sign of the speed.", sign, params=(_MU,))),
    "tanh": ("Coulomb, tanh(v)", Effect("coulomb_tanh", "By tanh of the speed.", tanh, params=(_MU,))),
    "dahl": ("Dahl", Effect("dahl", "A bristle.", dahl, params=(_MU, _STIFF), state=(State("z_W_m", (3,)),))),
    "stick": ("stick and slip, the shipped", "friction"),
}


def settings(quick: bool, scene_file: str | None) -> list[Setting]:
    return [Setting(said, said.split(",")[-1].strip(), {"model": name}) for name, (said, _) in MODELS.items()]


def error(model: str) -> dict[str, float]:
    """Recorded drags, held out; what creeps though it should hold; what chatters when a tool has slid to rest."""
    found = {"drift": float(np.clip(1e3 * drift_m(model), LEAST_MM, MOST_MM)), "ripple": max(LEAST_N, ripple_N(model))}
    if not no_recordings():
        found["recorded"] = float(np.sqrt(np.mean([_held_out(model, name) ** 2 for name in STROKES])))
    return found


def rough(model: str, friction: float, drag_Ns_m: float) -> Swatch:
    """A swatch of that friction; the shipped one's adhesion is damped, as a device without friction needs."""
    own = {
        "viscous": {"viscous_drag": {"drag_Ns_m": drag_Ns_m}},
        "stick": {"friction": {"tangential_damping_Ns_m": 5.0}},
    }
    return Swatch(
        "rough", damping_Ns_m=5.0, friction_static=friction, friction_dynamic=friction, effects=own.get(model, {})
    )


def _pushed(model: str, push_N: Array, speed_m_s: float = 0.0) -> tuple[Array, Array]:
    """A point mass pressed on a sheet and pushed along it by (n,) [N]: its place (n,) [m], the motors' force [N]."""
    swatch = rough(model, COULOMB, COULOMB * PRESS_N / SLIDE_M_S)
    effects = ("wall", MODELS[model][1])
    twin = Twin(sheet(swatch), PointMass(MASS_KG), effects, tick_s=1e-3, a_rate_Hz=1000.0)
    twin.reset((*AT_M, 1e-4))
    depth = (*AT_M, -PRESS_N / STIFFNESS_N_M)
    twin.run(Intent.hold(depth, 500, Grip(2e3, 20.0), push_W_N=(0.0, 0.0, -PRESS_N)))
    twin.body.arm.point.v_m_s[0, 0] = speed_m_s
    push = np.column_stack((push_N, np.zeros(len(push_N)), np.full(len(push_N), -PRESS_N)))
    felt = twin.run(Intent(np.zeros_like(push), np.zeros_like(push), push))
    return felt.p_W_m[:, 0], felt.f_motor_W_N[:, 0]


def drift_m(model: str, duration_s: float = 20.0) -> float:
    """How far a tool creeps that is held below the limit and shaken (case F3) [m], from when it has settled."""
    bias, vibration, often_Hz = SHAKE
    t_s = 1e-3 * np.arange(round(1000.0 * duration_s))
    push = COULOMB * PRESS_N * (bias + vibration * np.sin(2.0 * np.pi * often_Hz * t_s))
    x, _ = _pushed(model, push)
    return abs(float(x[-1000:].mean() - x[1000:2000].mean()))


def ripple_N(model: str) -> float:
    """How much the force changes from tick to tick [N rms] when a tool has slid to rest."""
    _, f = _pushed(model, np.zeros(1500), SLIDE_M_S)
    return float(np.sqrt(np.mean(np.diff(f[-500:]) ** 2)))


def _held_out(model: str, name: str) -> float:
    """Half of a recorded drag, played with the coefficients of the other half, both ways [JND of a coefficient]."""
    streams, apart = recorded(name), []
    assert streams.tangential_force_N is not None
    halves = np.array_split(np.arange(0, len(streams.force_N), 10), 2)
    for own, other in (halves, halves[::-1]):
        pull, press, speed = (np.asarray(s) for s in (streams.tangential_force_N, streams.force_N, streams.speed_m_s))
        friction = float(np.median(pull[own] / press[own]))
        drag = float(pull[own] @ speed[own] / (speed[own] @ speed[own]))
        apart.append(off_jnd(played_N(rough(model, friction, drag), model, press[other], speed[other]), pull[other]))
    return float(np.sqrt(np.mean(np.square(apart))))


def played_N(swatch: Swatch, model: str, press_N: Array, speed_m_s: Array) -> Array:
    """The pull (n,) [N] that the tick plays along normal forces and speeds (n,), a tick each."""
    path = np.zeros((len(press_N) + 1, 3))
    path[1:, 0], path[1:, 2] = 1e-3 * np.cumsum(speed_m_s), -press_N / STIFFNESS_N_M
    path[:, 0] -= 0.5 * path[-1, 0]
    path[0, 2] = 1e-4
    effects = ("wall", MODELS[model][1])
    return -Renderer(sheet(swatch, 2.0), effects, tick_s=1e-3, a_rate_Hz=1000.0).run(path).f_W_N[1:, 0]


def off_jnd(played: Array, pull_N: Array) -> float:
    """Root mean square of how far means over `BLOCK_S` are apart, over what is felt of a coefficient [JND]."""
    length = round(1000.0 * BLOCK_S)
    one, two = (x[: len(x) // length * length].reshape(-1, length).mean(axis=1) for x in (played, pull_N))
    return float(np.sqrt(np.mean(((one - two) / (FRICTION * two)) ** 2)))


def time(model: str) -> tuple[float, float]:
    return effect_us(rough(model, COULOMB, 1.0), ("wall", MODELS[model][1]))


def advice(points: Sequence[Point]) -> str:
    """The quickest model that neither creeps nor chatters, and how much a recording tells them apart."""
    real, told = measured(points, "recorded"), ""
    if real:
        one, most = best(points, "recorded"), max(real, key=lambda p: p.errors["recorded"])
        told = (
            f" Recorded drags, which never stop, are nearest to {one.method} ({one.errors['recorded']:.2g} JND) and "
            f"farthest from {most.method} ({most.errors['recorded']:.2g})."
        )
    still = [p for p in measured(points, "drift") if p.errors["ripple"] <= FORCE * FORCE_LEAST_N]
    holds = min(still or measured(points, "drift"), key=lambda p: p.errors["drift"])
    quick = min(measured(points, "drift"), key=lambda p: p.median_us)
    other = f"; {quick.method} takes {quick.median_us:.2g}, and creeps {quick.errors['drift']:.2g} mm"
    return (
        f"Choose {holds.method} where a tool may rest: it creeps {holds.errors['drift']:.2g} mm in 18 s and its force "
        f"changes by {holds.errors['ripple']:.2g} N a tick at rest, for {holds.median_us:.2g} µs"
        f"{'' if quick == holds else other}.{told} A simpler one does where nothing ever "
        "stands still on the surface."
    )


QUESTION: Final = Question(
    name="friction-model",
    title="Which model of friction?",
    measures=(
        *(
            ()
            if no_recordings()
            else (Measure("recorded", "drags on recordings, held out", "JND", 1.0, "11 % (Gueorguiev et al. 2017)"),)
        ),
        Measure("drift", "creep below the limit, 18 s", "mm"),
        Measure("ripple", "force at rest, tick to tick", "N", FORCE * FORCE_LEAST_N, "7 % of 0.5 N (Pang et al. 1991)"),
    ),
    settings=settings,
    error=error,
    time=time,
    advice=advice,
    conditions=(
        "Half of each drag over wood, paper and leather played through the tick with the coefficients of the other "
        f"half, means of {1e3 * BLOCK_S:g} ms; a device of {1e3 * MASS_KG:g} g without friction of its own, pressed "
        f"on with {PRESS_N:g} N, µ = {COULOMB:g}: pushed by half of what holds it and shaken by a fifth, which must "
        f"not move it; and let slide to rest from {SLIDE_M_S:g} m/s. Time: a whole tick with a wall."
    ),
)
