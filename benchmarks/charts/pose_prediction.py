"""Where a body is between two frames of the program that moves it: held, led behind, or predicted."""

from collections.abc import Sequence
from functools import cache
from typing import Any, Final

import numpy as np
from trimesh.creation import box

from hapscene.clock import new_clock
from hapscene.constants import TICK_S
from hapscene.contact.prediction import FRAME, HORIZON_S, PREDICTED, predict_bodies
from hapscene.perception import FORCE, FORCE_LEAST_N
from hapscene.records import records
from hapscene.renderer import Renderer
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch

from .measuring import Array, call_us
from .question import Measure, Point, Question, Setting

FRAMES_HZ: Final = (30.0, 60.0, 120.0)

METHODS: Final = {"held": "held", "led": "led, a frame behind", "predicted": "predicted"}

MASS_KG, STIFFNESS_N_M, FRICTION = 0.2, 650.0, 0.3
"""The crate that is pushed, how stiff it is, and what it slides on."""

PUSH_M_S, PUSH_S, START_S = 0.05, 3.0, 0.05
"""How fast the tool goes, how long, and when it starts: to `TOOL_M` before the crate's face."""

TOOL_M: Final = -0.026

SWING_M, SWING_HZ = 0.02, 1.0
"""A body that the program swings, and that nothing pushes."""

LEAST_N: Final = 1e-3
"""What a smaller step is drawn as."""

BODIES: Final = 200
"""Bodies that are timed at once [count]."""

START_NS: Final = 10**12


def settings(quick: bool, scene_file: str | None) -> list[Setting]:
    frames = FRAMES_HZ[1:2] if quick else FRAMES_HZ
    return [Setting(said, f"{f:g} Hz", {"method": m, "frames_Hz": f}) for m, said in METHODS.items() for f in frames]


class Between:
    """Frames of one body along x, and where it is in the ticks between them by one of `METHODS`."""

    def __init__(self, method: str, mass_kg: float = np.inf) -> None:
        self.method = method
        self.frames, self.predicted = records(1, FRAME), records(1, PREDICTED)
        self.impulse, self.clock = np.zeros((1, 6)), new_clock()
        self.X, self.teleported = np.eye(4)[None, None].copy(), np.zeros(1, np.int64)
        if method == "predicted" and np.isfinite(mass_kg):
            self.frames[0].lightness, self.frames[0].yields_B = 1.0 / mass_kg, 0.0

    def say(self, tick: int, x_m: float, v_m_s: float) -> None:
        """A frame."""
        frame = self.frames[0]
        frame.count += 1
        frame.X_WB = np.eye(4)
        frame.X_WB[0, 3] = x_m
        frame.v[0] = v_m_s if self.method == "predicted" else 0.0
        frame.seen, frame.lasts_s = self.impulse[0], HORIZON_S
        frame.time_ns = START_NS + round(1e9 * TICK_S * tick)
        frame.count += 1

    def at(self, tick: int) -> Array:
        """The pose (4, 4) in a tick."""
        if self.method == "held":
            return np.array(self.frames[0].X_WB)
        now, moving = START_NS + round(1e9 * TICK_S * tick), np.zeros(1, np.int64)
        predict_bodies(
            self.frames, self.predicted, moving, self.impulse, self.X, self.teleported, now, self.clock, TICK_S
        )
        return np.array(self.X[0, 0])


def error(method: str, frames_Hz: float) -> dict[str, float]:
    """A body that swings, against its sine; a pushed crate, against a program that runs as often as the tick."""
    found, true = (float(np.abs(np.diff(pushed(m, f))).max()) for m, f in ((method, frames_Hz), ("held", 1.0 / TICK_S)))
    return {"pose": 1e3 * swing_off_m(method, frames_Hz), "step": max(LEAST_N, found - true)}


def frames_at(frames_Hz: float, ticks: int) -> set[int]:
    """Ticks in which a frame comes."""
    return set(np.ceil(np.arange(0.0, ticks * TICK_S, 1.0 / frames_Hz) / TICK_S - 1e-9).astype(int).tolist())


def swing_off_m(method: str, frames_Hz: float, velocity_m_s: float | None = None) -> float:
    """How far a body that swings, or goes steadily, is from where it truly is [m rms], from the fifth frame on."""
    line, ticks, off = Between(method), 3000, []
    due, w = frames_at(frames_Hz, ticks), 2.0 * np.pi * SWING_HZ
    for k in range(ticks):
        t = k * TICK_S
        x, v = SWING_M * np.sin(w * t), SWING_M * w * np.cos(w * t)
        if velocity_m_s is not None:
            x, v = velocity_m_s * t, velocity_m_s
        if k in due:
            line.say(k, x, v)
        off.append(line.at(k)[0, 3] - x)
    return float(np.sqrt(np.mean(np.square(off[round(5.0 / frames_Hz / TICK_S) :]))))


@cache
def pushed(method: str, frames_Hz: float) -> Array:
    """Forces (n,) [N] of a tool that pushes a crate, which the program moves by what it was given since last time."""
    scene, ticks = Scene(), round(PUSH_S / TICK_S)
    scene.add(box((0.05,) * 3), name="crate", unit="m", swatch=Swatch("crate", stiffness_N_m=STIFFNESS_N_M))
    renderer, line = Renderer(scene, ("wall",)), Between(method, MASS_KG)
    slots, due = renderer.moving(["crate"]), frames_at(frames_Hz, ticks)
    line.impulse = renderer.world.impulse
    x = v = told = 0.0
    forces = np.zeros(ticks)
    for k in range(ticks):
        if k in due:
            given, told = line.impulse[0, 0] - told, float(line.impulse[0, 0])
            v += given / MASS_KG
            v -= np.sign(v) * min(FRICTION * 9.81 / frames_Hz, abs(v))
            x += v / frames_Hz
            line.say(k, x, v)
        slots.X_WB[0] = line.at(k)
        forces[k] = renderer.step((TOOL_M + PUSH_M_S * max(0.0, k * TICK_S - START_S), 0.0, 0.0), slots).f_W_N[0]
    return forces


def time(method: str, frames_Hz: float) -> tuple[float, float]:
    """Of one body in a tick, of `BODIES` at once; frames that come take their share."""
    frames, predicted, clock = records(BODIES, FRAME), records(BODIES, PREDICTED), new_clock()
    frames["X_WB"], frames["count"], frames["lasts_s"] = np.eye(4), 2, HORIZON_S
    frames["lightness"] = 1.0 / MASS_KG if method == "predicted" else 0.0
    X, moving = np.tile(np.eye(4), (1, BODIES, 1, 1)), np.arange(BODIES)
    impulse, teleported, tick = np.zeros((BODIES, 6)), np.zeros(BODIES, np.int64), [0]
    every = max(1, round(1.0 / frames_Hz / TICK_S))

    def job() -> Any:
        tick[0] += 1
        now = START_NS + round(1e9 * TICK_S * tick[0])
        if tick[0] % every == 0:
            frames["count"] += 2
            frames["time_ns"] = now
        if method == "held":
            X[0] = frames["X_WB"]
        else:
            predict_bodies(frames, predicted, moving, impulse, X, teleported, now, clock, TICK_S)

    return call_us(job, BODIES, 1000)


def advice(points: Sequence[Point]) -> str:
    """What each is worth at the slowest rate of frames, and from which on another one does."""

    def of(method: str) -> list[Point]:
        return sorted((p for p in points if p.method == METHODS[method]), key=lambda p: float(p.label.split()[0]))

    guessed, led, held = of("predicted"), of("led"), of("held")
    enough = next((p.label for p in guessed if p.errors["step"] <= STEP_N), "no rate")
    plain = next((p.label for p in held if p.errors["step"] <= STEP_N), "no rate")
    return (
        f"Predict: a pushed crate's force then steps by {guessed[0].errors['step']:.2g} N too much at "
        f"{guessed[0].label}, where one that is held does by {held[0].errors['step']:.2g} and one that is led by "
        f"{led[0].errors['step']:.2g}; that is not felt from {enough} on, held from {plain}. It takes "
        f"{guessed[0].median_us:.2g} µs a body. Hold only what stands still or is teleported; lead what has no "
        f"velocity to tell, and bear that it is a frame late ({led[0].errors['pose']:.2g} mm of a swing at "
        f"{led[0].label}, {guessed[0].errors['pose']:.2g} predicted)."
    )


STEP_N: Final = FORCE * FORCE_LEAST_N

QUESTION: Final = Question(
    name="pose-prediction",
    title="Where is a body between two frames?",
    measures=(
        Measure(
            "step",
            "a pushed crate's largest step of force, beyond the true one",
            "N",
            STEP_N,
            "7 % of 0.5 N (Pang et al. 1991)",
        ),
        Measure("pose", "place of a body that swings", "mm rms"),
    ),
    settings=settings,
    error=error,
    time=time,
    advice=advice,
    conditions=(
        f"A crate of {MASS_KG:g} kg on friction of {FRICTION:g}, {STIFFNESS_N_M:g} N/m, pushed at {1e3 * PUSH_M_S:g} "
        f"mm/s: against the same where the program runs as often as the tick. A body swung by {1e3 * SWING_M:g} mm at "
        f"{SWING_HZ:g} Hz: against its sine."
    ),
    per="body",
)
