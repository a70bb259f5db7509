"""The cases of texture with known answers: no filter explodes, whatever follows whatever (L1 to L3), and what a tick
cannot sample (T4). Beside them a wall that buzzes in a light hand, and does not at its device's limits.

The textures run through the real tick: a path strokes a sheet of stripes at a steady speed, so narrow that the swatch
changes with every tick, or as often as the case asks.
"""

import math
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import ACCELERATION_RATE_HZ, TICK_S
from hapscene.device.model import DEVICES, IDEAL, DeviceWarning, Limits, limits_of
from hapscene.dsp.ar_filter import ar_from_reflection, lsf_from_ar, power_gain, reflection_from_ar
from hapscene.recording import Recording
from hapscene.renderer import Renderer
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.stability.answer import Answer
from hapscene.stability.rig import AT_M, sheet
from hapscene.stability.wall_chart import draw_panels
from hapscene.surface.library import load_swatch, shipped_swatches
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import Texture, filters, form
from hapscene.twin.hand_intent import Intent
from hapscene.twin.result import Feel
from hapscene.twin.twin import Twin
from hapscene.view.palette import INK, OKABE_ITO, SHADE

Array = NDArray[np.float64]

SPEED_M_S: Final = 0.1
"""How fast the sheet is stroked [m/s]."""

DEPTH_M: Final = 2e-3
"""How deep the tool is while it strokes [m]: 1 N on a wall of 500 N/m."""

WARM_S: Final = 0.1
"""How long the tick's low-pass of the force takes to settle [s]."""

PAIRS: Final = 200
"""Random pairs of models at each order [count]: a share of them to 0.06 with 95 % confidence."""

UNSTABLE: Final = {3: 0.25, 8: 0.75, 20: 0.98}
"""Share of random pairs between which blended coefficients are unstable, by order: reference table, L1."""

TYPICAL, LOUDEST = 3.3, 4.2
"""Loudest of `STEPS` samples of a switched lattice over its level [1], of one pair and of 40: reference table, L3.
White Gaussian noise has about as much; noise of narrow spectra, whose samples are alike, has less."""

STEPS: Final = 1000
"""Samples of which the loudest is taken [count]."""

BUZZ_N_M: Final = 2000.0
"""The wall that buzzes [N/m]: twice what CHAI3D drives a Phantom 1.0 at."""

BUZZ_DEVICE: Final = "phantom-1.0"
"""The device in whose light hand it does: one of little friction."""


def texture_cases() -> list[Answer]:
    """All of them, in about 5 s."""
    return [*blends(), *switched(), *adversaries(), *shipped(), *sampling(), *buzz()]


def blends(seed: int = 0) -> list[Answer]:
    """L1: blends of random pairs. Poles of radius 0.85 to 0.99 at any angle, blended in nine places."""
    rng = np.random.default_rng(seed)
    answers = []
    for order, expected in UNSTABLE.items():
        a = np.stack([_random_model(order, rng) for _ in range(2 * PAIRS)])
        lsf = np.stack([lsf_from_ar(one) for one in a])
        share = np.linspace(0.1, 0.9, 9)[:, None, None]
        for name in ("lsf", "reflection"):
            x = form(name, lsf)
            blended = filters(name, ((1.0 - share) * x[::2] + share * x[1::2]).reshape(-1, order))
            bad = ~(np.abs(reflection_from_ar(blended)) < 1.0).all(axis=-1)
            answers.append(Answer(f"L1-{name}-{order}", "unstable blends [1]", 0.0, float(bad.mean()), 0.0))
        k = reflection_from_ar(((1.0 - share) * a[::2] + share * a[1::2]).reshape(-1, order + 1))
        bad = ~(np.abs(k) < 1.0).all(axis=-1).reshape(9, -1).all(axis=0)
        answers.append(Answer(f"L1-direct-{order}", "pairs with unstable blends [1]", expected, float(bad.mean()), 0.3))
    return answers


def switched() -> list[Answer]:
    """L2: poles 0.95 e^±0.1j and 0.95 e^±3.04j in turn, a sample each: stable parts, an unstable whole."""
    a = np.stack([np.real(np.poly((0.95 * np.exp(1j * w), 0.95 * np.exp(-1j * w)))) for w in (0.1, 3.04)])
    step = [np.array(((-one[1], -one[2]), (1.0, 0.0))) for one in a]
    radius = float(np.abs(np.linalg.eigvals(step[0] @ step[1])).max())
    swatches = [_swatch(f"pole {i}", one, 1.0 / TICK_S) for i, one in enumerate(a)]
    y = stroke(swatches, 20_000, 1.0 / TICK_S).a_m_s2.ravel()[round(WARM_S / TICK_S) :]
    return [
        Answer("L2-radius", "spectral radius of the two in turn [1]", 5.22, radius, 1e-3),
        Answer("L2-level", "level of our lattice, switched so [1]", 1.0, float(np.std(y)), 0.3),
        Answer("L2-peak", "its loudest sample over its level [1]", 5.0, float(np.abs(y).max()), 0.0, at_most=True),
    ]


def adversaries(pairs: int = 40, seed: int = 1) -> list[Answer]:
    """L3: AR(12) switched every 10 ms, low against high: about 3.3 σ, at most 4.2; a direct form explodes."""
    rng = np.random.default_rng(seed)
    ours, direct = [], []
    for pair in range(pairs):
        a = np.stack([_unlike(side, rng) for side in (0, 1)])
        swatches = [_swatch(f"side {i}", one, ACCELERATION_RATE_HZ) for i, one in enumerate(a)]
        ticks_each = round(0.01 / TICK_S)
        ticks = round((WARM_S + STEPS / ACCELERATION_RATE_HZ) / TICK_S)
        y = stroke(swatches, ticks, ACCELERATION_RATE_HZ, ticks_each, pair).a_m_s2.ravel()
        ours.append(float(np.abs(y[-STEPS:]).max()))
        direct.append(_direct_peak(a, rng))
    median = float(np.median(ours))
    return [
        Answer("L3-median", "loudest of 1000 samples over the level, median [1]", TYPICAL, median, 0.0, True),
        Answer("L3-worst", "the same, worst of 40 pairs [1]", LOUDEST, max(ours), 0.0, True),
        Answer("L3-direct", "the worst of a direct form is over 1e3 (1 yes) [1]", 1.0, float(max(direct) > 1e3), 0.0),
    ]


def shipped() -> list[Answer]:
    """From one shipped swatch to the next with every tick: finite, and as loud as they are."""
    swatches = [load_swatch(name) for name in shipped_swatches()]
    seen = stroke(swatches, 8000, ACCELERATION_RATE_HZ)
    first = round(WARM_S / TICK_S)
    y, at = seen.a_m_s2[first:], seen.swatch[first:]
    textures = {seen.swatch_names.index(s.name): s.texture for s in swatches}
    level = np.zeros(len(at))
    for index, texture in textures.items():
        if texture is not None:
            of = at == index
            f_N = seen.normal_force_N[first:][of]
            level[of] = np.sqrt(texture.power(f_N, seen.slip_m_s[first:][of]))
    ramp = (np.arange(y.shape[1]) + 1.0) / y.shape[1]
    before = np.roll(level, 1)
    expected = float(np.mean((before[1:, None] + ramp * (level - before)[1:, None]) ** 2))
    apart_dB = abs(10.0 * math.log10(float(np.mean(y[1:] ** 2)) / expected))
    crossed = float(np.mean(np.diff(at) != 0))
    return [
        Answer("crossing", "ticks in which the swatch changes [1]", 1.0, crossed, 0.02),
        Answer("crossing-finite", "samples that are not finite [count]", 0, int((~np.isfinite(y)).sum()), 0.0),
        Answer("crossing-level", "level off what the swatches have [dB]", 0.0, apart_dB, 3.0),
    ]


def sampling() -> list[Answer]:
    """T4: a grating of period l is felt at v/l as long as v < l/(2T); faster, at 1/T − v/l, as something else."""

    def answer(ratio: float) -> Answer:
        what, found = f"frequency over 1/T at v = {ratio} l/T [1]", felt_frequency(ratio) * TICK_S
        return Answer(f"T4-{ratio}", what, min(ratio, 1.0 - ratio), found, 0.01)

    return [answer(ratio) for ratio in (0.1, 0.3, 0.45, 0.6, 0.8)]


def felt_frequency(ratio: float) -> float:
    """Strongest frequency of the force [Hz] where a grating is crossed at `ratio` of its period in a tick."""
    width_m, stripes = 5e-4, 2000
    hard, soft = Swatch("ridge", stiffness_N_m=600.0), Swatch("groove", stiffness_N_m=400.0)
    scene = striped([hard, soft], width_m, stripes)
    count = min(4000, int(0.98 * stripes * width_m / (2.0 * width_m * ratio)))
    path = _line(2.0 * width_m * ratio / TICK_S, count, width_m, stripes)
    f_N = Renderer(scene, ["wall"], tick_s=TICK_S).run(path).f_W_N[100:, 2]
    density = np.abs(np.fft.rfft((f_N - f_N.mean()) * np.hanning(len(f_N))))
    return float(np.fft.rfftfreq(len(f_N), TICK_S)[int(np.argmax(density))])


def buzz() -> list[Answer]:
    """A stiff wall tapped by a light hand: without the device's limits it buzzes, with them it is at rest."""
    answers = []
    for name, limits in stabilisers().items():
        found = 1e3 * tapped(limits).rest_m_s
        if name == "nothing":
            answers.append(Answer("buzz-nothing", "buzzes, over 5 mm/s rms (1 yes) [1]", 1.0, float(found > 5.0), 0.0))
        else:
            answers.append(Answer(f"buzz-{name}", "speed at the end, rms [mm/s]", 5.0, found, 0.0, at_most=True))
    return answers


def stabilisers() -> dict[str, Limits]:
    """What may keep a wall at rest: nothing, the passivity controller alone, the device's limits with it (default)."""
    limits = limits_of(BUZZ_DEVICE, TICK_S)
    net = replace(limits, stiffness_N_m=math.inf, damping_Ns_m=math.inf, undamped_N_m=math.inf, damping_time_s=0.0)
    return {"nothing": IDEAL, "controller": net, "limits": limits}


def tapped(limits: Limits) -> Feel:
    """A light hand that falls on a wall and stays on it."""
    point = DEVICES[BUZZ_DEVICE].point
    assert point is not None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeviceWarning)
        twin = Twin(sheet(Swatch("stiff", stiffness_N_m=BUZZ_N_M)), point, ["wall"], limits=limits)
    path = np.tile((*AT_M, 0.02), (2000, 1))
    path[100:, 2] = -0.015
    return twin.run(Intent.along(path, "light"))


def draw_texture(rows: Sequence[Answer], path: Path) -> None:
    """Chart of blends (L1), of what a tick samples (T4), and of a wall that buzzes."""

    def draw(_: Any, axes: Any) -> None:
        _draw_blends(axes[0, 0], rows)
        _draw_sampling(axes[0, 1])
        _draw_buzz(axes[0, 2])

    draw_panels(path, 1, 3, (5.2, 4.2), draw)


def _draw_blends(axes: Any, rows: Sequence[Answer]) -> None:
    found = {row.id: row.found for row in rows}
    orders = [str(order) for order in UNSTABLE]
    forms = (
        ("direct", "coefficients", "vermilion"),
        ("reflection", "reflection coefficients", "blue"),
        ("lsf", "line spectral frequencies", "green"),
    )
    for shift, (name, label, colour) in enumerate(forms):
        share = [100.0 * found[f"L1-{name}-{order}"] for order in UNSTABLE]
        bars = axes.bar(np.arange(3) + 0.27 * (shift - 1), share, 0.25, color=OKABE_ITO[colour], label=label)
        axes.bar_label(bars, fmt="%.0f", padding=2)
    axes.set_xticks(np.arange(3), orders)
    axes.set(xlabel="order of the models", ylabel="unstable pairs [%]", ylim=(0, 150))
    axes.set_title("L1: blends of random pairs")
    axes.set_yticks(range(0, 101, 25))
    axes.legend(loc="upper left")


def _draw_sampling(axes: Any) -> None:
    ratios = np.concatenate((np.arange(0.05, 0.5, 0.05), np.arange(0.55, 1.0, 0.05)))
    axes.plot((0.0, 0.5, 1.0), (0.0, 500.0, 0.0), color=INK, linestyle=":", label="theory")
    axes.plot(ratios, [felt_frequency(float(r)) for r in ratios], "o", color=OKABE_ITO["blue"], label="felt")
    axes.axvspan(0.5, 1.0, color=SHADE, zorder=0)
    axes.text(0.75, 20.0, "v > l/(2T)", ha="center", color=INK)
    axes.set(title="T4: a grating crossed too fast", xlim=(0.0, 1.0), ylim=(0.0, 620.0))
    axes.set(xlabel="periods crossed in a tick, vT/l [1]", ylabel="frequency felt [Hz]")
    axes.legend(loc="upper left", ncols=2)


def _draw_buzz(axes: Any) -> None:
    labels = {"nothing": "nothing", "controller": "passivity controller", "limits": "device's limits and controller"}
    for (name, limits), colour in zip(stabilisers().items(), ("vermilion", "sky", "blue"), strict=True):
        felt = tapped(limits)
        height_mm = 1e3 * felt.p_W_m[:, 2]
        axes.plot(felt.recording.t_s, height_mm, color=OKABE_ITO[colour], label=labels[name], linewidth=1.2)
    axes.axhline(0.0, color=INK, linewidth=0.8)
    title = f"{BUZZ_N_M:g} N/m in a light hand, {BUZZ_DEVICE}"
    axes.set(title=title, xlabel="time [s]", ylabel="height over the wall [mm]", xlim=(0.0, 1.0), ylim=(-12.0, 34.0))
    axes.legend(loc="upper right")


def stroke(swatches: Sequence[Swatch], ticks: int, rate_Hz: float, ticks_each: int = 1, seed: int = 0) -> Recording:
    """A stroke over stripes of some swatches in turn, another each `ticks_each` ticks."""
    width_m = ticks_each * SPEED_M_S * TICK_S
    stripes = math.ceil(ticks / ticks_each) + 4
    scene = striped(swatches, width_m, stripes)
    renderer = Renderer(scene, ["wall", "lpc_texture"], seed=seed, tick_s=TICK_S, a_rate_Hz=rate_Hz)
    return renderer.run(_line(SPEED_M_S, ticks, width_m, stripes))


def striped(swatches: Sequence[Swatch], width_m: float, stripes: int) -> Scene:
    """A flat sheet at z = 0 of stripes across x, painted in turn."""
    x = width_m * (np.arange(stripes + 1) - stripes / 2)
    half = max(5e-3, 2.0 * width_m)
    low, high = (np.column_stack((x, np.full(len(x), y), np.zeros(len(x)))) for y in (-half, half))
    n, i = len(x), np.arange(stripes)
    faces = np.stack((np.stack((i, i + 1, n + i + 1), 1), np.stack((i, n + i + 1, n + i), 1)), 1).reshape(-1, 3)
    scene = Scene()
    scene.add(Mesh(np.concatenate((low, high)), faces.astype(np.int32)), name="stripes")
    for which, swatch in enumerate(swatches):
        scene.paint("stripes", swatch, np.repeat(i % len(swatches) == which, 2))
    return scene


def _line(speed_m_s: float, count: int, width_m: float, stripes: int) -> Array:
    """A path (n, 3) from above the first stripe, then along, in the middle of a stripe's way at each tick."""
    path = np.zeros((count, 3))
    path[:, 0] = width_m * (0.5 - stripes / 2 + 0.5 * width_m) + speed_m_s * TICK_S * np.arange(count)
    path[:, 1], path[:, 2] = 1e-3, -DEPTH_M
    path[0, 2] = 1e-3
    return path


def _swatch(name: str, a: Array, rate_Hz: float) -> Swatch:
    """A swatch whose texture is one model of variance 1, whatever force and speed."""
    gain = power_gain(a[None])
    texture = Texture.from_models(rate_Hz, [0.5], [SPEED_M_S / 2.0], a=a[None], variance_m2_s4=1.0 / gain)
    return Swatch(name, texture=texture)


def _random_model(order: int, rng: np.random.Generator) -> Array:
    pole = rng.uniform(0.85, 0.99, order // 2) * np.exp(1j * rng.uniform(0.0, np.pi, order // 2))
    poles = np.concatenate((pole, pole.conj(), rng.uniform(-0.99, 0.99, order % 2)))
    return np.asarray(np.real(np.poly(poles)), np.float64)


def _unlike(side: int, rng: np.random.Generator) -> Array:
    """AR(12), its energy low on one side, high on the other."""
    k = rng.uniform(-0.9, 0.9, 12)
    k[0] = 0.98 if side else -0.98
    return ar_from_reflection(k)


def _direct_peak(a: Array, rng: np.random.Generator) -> float:
    """Loudest of `STEPS` samples over the level, of a direct form that keeps its history as the model is switched."""
    level = np.sqrt(power_gain(a))
    each = round(0.01 * ACCELERATION_RATE_HZ)
    history = np.zeros(12)
    peak = 0.0
    for t in range(2 * STEPS):
        which = (t // each) % 2
        y = rng.normal() / level[which] - float(a[which, 1:] @ history)
        history[1:], history[0] = history[:-1].copy(), y
        peak = max(peak, abs(y))
    return peak
