"""Which model of a tap: how many decaying sinusoids, or the transient itself; and whether it heeds the speed."""

import math
from collections.abc import Sequence
from functools import cache
from typing import Any, Final

import numpy as np
from scipy.linalg import hankel, svd
from scipy.optimize import least_squares

from hapscene.renderer import Renderer
from hapscene.stability.rig import sheet
from hapscene.surface.effect import Effect, State
from hapscene.surface.swatch import Swatch
from hapscene.surface.taps import Taps

from .acceleration_rate import tap_bands
from .measuring import ISRAR, RATE_HZ, Array, apart_jnd, best, effect_us, enough
from .question import Measure, Point, Question, Setting

MODES: Final = ((1.0, 140.0, 90.0), (0.8, 330.0, 160.0), (0.5, 760.0, 300.0))
"""A known surface's answer: amplitude at 1 m/s over `LOUD_M_S2` [1], frequency [Hz], decay [1/s] of each mode."""

LOUD_M_S2, STIFFER, NOISE_M_S2 = 100.0, 0.15, 0.1
"""Its loudness, the power of the speed that its frequencies grow with, as a contact does, and the sensor's noise."""

MEASURED_M_S, ASKED_M_S = (0.05, 0.1, 0.2, 0.4), (0.07, 0.14, 0.28)
"""Speeds at which it was tapped, and those between them that are asked for."""

TAP_S: Final = 0.1
"""Length of a tap [s]."""

MODE_MAX: Final = 3

LAWS: Final = {True: "by speed", False: "one for all speeds"}


def settings(quick: bool, scene_file: str | None) -> list[Setting]:
    models = [(f"{n} sinusoid{'s' * (n > 1)}", n) for n in range(1, MODE_MAX + 1)] + [("transient", 0)]
    return [Setting(said, name, {"modes": n, "heeds": heeds}) for heeds, said in LAWS.items() for name, n in models]


def true_tap(speed_m_s: float, noise: np.random.Generator | None = None) -> Array:
    """The known surface's answer (n,) [m/s²] to a tap."""
    t = np.arange(round(TAP_S * RATE_HZ)) / RATE_HZ
    tap = np.zeros(len(t))
    for share, frequency, decay in MODES:
        turn = 2.0 * np.pi * frequency * (speed_m_s / 0.1) ** STIFFER * t
        tap += LOUD_M_S2 * speed_m_s * share * np.exp(-decay * t) * np.sin(turn)
    return tap if noise is None else tap + NOISE_M_S2 * noise.standard_normal(len(t))


def fitted(tap_m_s2: Array, modes: int) -> Array:
    """Amplitude, frequency and decay (modes, 3) of the decaying sines nearest to a tap, frequencies ascending.

    Least squares from the poles of the matrix pencil (Hua & Sarkar 1990).
    """
    count = len(tap_m_s2)
    t = np.arange(count) / RATE_HZ
    early = tap_m_s2[: count // 2]  # the rest is noise
    rows = hankel(early[: count // 6], early[count // 6 - 1 :])
    space = svd(rows, full_matrices=False)[0][:, : 2 * MODE_MAX]
    pole = np.log(np.linalg.eigvals(np.linalg.pinv(space[:-1]) @ space[1:])) * RATE_HZ
    pole = pole[(pole.imag > 0.0) & (pole.real < 0.0)]
    basis = np.exp(pole.real[None] * t[:, None]) * np.sin(pole.imag[None] * t[:, None])
    loud = np.linalg.lstsq(basis, tap_m_s2, rcond=None)[0]
    first = np.argsort(-(loud**2) / -pole.real)[:modes]
    begin = np.column_stack((loud, pole.imag / (2.0 * np.pi), -pole.real))[first]

    def played(p: Array) -> Array:
        a, f, decay = p.reshape(-1, 3).T[:, :, None]
        return np.asarray((a * np.exp(-decay * t) * np.sin(2.0 * np.pi * f * t)).sum(axis=0))

    def off(p: Array) -> Array:
        return played(p) - tap_m_s2

    scale = np.tile((np.abs(loud).max(), 100.0, 100.0), len(begin))
    found = least_squares(off, begin.ravel(), x_scale=scale, max_nfev=100).x.reshape(-1, 3)
    found = np.vstack((found, np.tile((0.0, 100.0, 100.0), (modes - len(found), 1))))
    return np.asarray(found[np.argsort(found[:, 1])])


@cache
def _recorded() -> tuple[Array, ...]:
    rng = np.random.default_rng(3)
    return tuple(true_tap(v, rng) for v in MEASURED_M_S)


def ring(touch: Any, p: Any, table: Any, s: Any, out: Any) -> None:
    """`MODE_MAX` resonators at most, struck by the speed: what the shipped effect does with one."""
    modes, speeds = int(table[0]), int(table[1])
    if touch.began:
        i, v = 0, touch.approach_m_s
        while i < speeds - 2 and v > table[3 + i]:
            i += 1
        j = min(i + 1, speeds - 1)
        low, high = table[2 + i], table[2 + j]
        u = min(max((v - low) / (high - low), 0.0), 1.0) if j > i else 0.0
        fade = min(1.0, v / low)
        for m in range(modes):
            one, two = 2 + speeds + 3 * (i * modes + m), 2 + speeds + 3 * (j * modes + m)
            s.real[m] += fade * ((1.0 - u) * table[one] + u * table[two])
            angle = 2.0 * math.pi * ((1.0 - u) * table[one + 1] + u * table[two + 1]) / touch.rate_Hz
            shrink = math.exp(-((1.0 - u) * table[one + 2] + u * table[two + 2]) / touch.rate_Hz)
            s.cosine[m], s.sine[m] = shrink * math.cos(angle), shrink * math.sin(angle)
    for m in range(modes):
        if abs(s.real[m]) + abs(s.imag[m]) > 1e-6:
            for k in range(touch.block):
                out.a_m_s2[k] += s.imag[m]
                real = s.cosine[m] * s.real[m] - s.sine[m] * s.imag[m]
                s.imag[m] = s.sine[m] * s.real[m] + s.cosine[m] * s.imag[m]
                s.real[m] = real


@cache
def model(modes: int, heeds: bool) -> tuple[Swatch, str | Effect]:
    """A swatch of the taps that were measured, and the effect that plays them; 0 modes is the transient itself."""
    taps, speeds = _recorded(), np.array(MEASURED_M_S)
    if not heeds:  # that of the middle, as loud however slowly it comes
        taps, speeds = taps[len(taps) // 2 :][:1], np.array([1e-3])
    if modes == 0:
        one = np.ones(len(speeds))
        return Swatch("tapped", taps=Taps(speeds, one, one, one, np.stack(taps), RATE_HZ)), "tap"
    rows = np.stack([fitted(tap, modes) for tap in taps])
    if modes == 1:  # the shipped effect has one
        a, f, decay = rows[:, 0].T
        return Swatch("tapped", taps=Taps(speeds, np.abs(a), f, decay)), "tap"
    table = np.concatenate(([modes, len(speeds)], speeds, rows.ravel()))
    state = [State(name, (MODE_MAX,)) for name in ("real", "imag", "cosine", "sine")]
    return Swatch("tapped"), Effect(
        f"modes_{modes}", "Modes that ring.", ring, state=tuple(state), table=lambda swatch, rate_Hz: table
    )


def error(modes: int, heeds: bool) -> dict[str, float]:
    """Taps at speeds that were not measured, as the tick plays them, against the known surface's own."""
    apart = [apart_jnd(tap_bands(played(v, modes, heeds), RATE_HZ), tap_bands(true_tap(v), RATE_HZ)) for v in ASKED_M_S]
    return {"planted": float(np.sqrt(np.mean(np.square(apart))))}


def played(speed_m_s: float, modes: int, heeds: bool) -> Array:
    """What the tick plays (n,) [m/s²] when the tool comes at a speed, from its onset."""
    swatch, effect = model(modes, heeds)
    path = np.full((round(TAP_S * 1e3) + 20, 3), 0.01)
    path[:, 2] = speed_m_s * 1e-3 * np.maximum(19.5 - np.arange(len(path)), -0.5)
    felt = Renderer(sheet(swatch), ("wall", effect)).run(path)
    return felt.a_m_s2[np.argmax(felt.touching) :].ravel()[: round(TAP_S * RATE_HZ)]


def time(modes: int, heeds: bool) -> tuple[float, float]:
    swatch, effect = model(modes, heeds)
    path = np.tile((0.01, 0.01, 0.0), (3000, 1))
    path[:, 2] = (
        2e-3 * np.sin(2.0 * np.pi * 20.0 * 1e-3 * np.arange(3000)) + 1e-3
    )  # 20 a second: some ticks are strikes
    return effect_us(swatch, ("wall", effect), path=path)


def advice(points: Sequence[Point]) -> str:
    """The quickest that is near enough, and what becomes of it without the speed."""
    chosen, least = enough(points, "planted", 1.0), best(points, "planted")
    deaf = min(p.errors["planted"] for p in points if p.method == LAWS[False])
    one = next(p for p in points if p.method == LAWS[True] and p.label.startswith("1"))
    return (
        f"Choose {chosen.label} {chosen.method}: {chosen.errors['planted']:.2g} JND at speeds that were not measured, "
        f"{chosen.median_us:.2g} µs and {chosen.p99_us:.2g} when it is struck; {least.label} come nearest "
        f"({least.errors['planted']:.2g}). One sinusoid, as most surfaces are stored, misses "
        f"{one.errors['planted']:.2g} where a surface has {len(MODES)} modes; it does where there is but one to hear. "
        f"Never one tap for all speeds: {deaf:.2g} JND at best."
    )


QUESTION: Final = Question(
    name="tap-model",
    title="Which model of a tap?",
    measures=(Measure("planted", "taps at speeds between, twelve bands", "JND", 1.0, ISRAR),),
    settings=settings,
    error=error,
    time=time,
    advice=advice,
    conditions=(
        f"A known surface of {len(MODES)} modes that ring higher when it is struck faster, heard with noise at "
        f"{len(MEASURED_M_S)} speeds from {MEASURED_M_S[0]:g} to {MEASURED_M_S[-1]:g} m/s and asked for between them: "
        "levels from 20 to 1000 Hz of what the tick plays against its own, in closed form. No real recording of taps "
        "is within reach. Time: a whole tick in contact, 20 taps a second, so that the 99th percentile is a tick "
        "that strikes."
    ),
)
