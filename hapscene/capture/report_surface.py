"""The plots of a report that show the swatch itself, with the recording behind it where there is one."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.capture import metric
from hapscene.capture.channel import Channels
from hapscene.capture.report_figure import BLUE, GREEN, INK, MUTED, ORANGE, PURPLE, SHADE, Key, Plot, drawn
from hapscene.capture.report_plot import decibels, over_frequency
from hapscene.capture.segment import Segmentation, State
from hapscene.surface.swatch import Swatch
from hapscene.surface.taps import TAP_ROWS, Taps
from hapscene.surface.texture import Texture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

POINT_COUNT: Final = 800
"""Points of the recording that are drawn [count]: more are a blot, and a large page."""

TRANSIENT_COUNT: Final = 3
"""Approach speeds whose transients are drawn [count]."""


def plot_models(texture: Texture) -> Plot:
    """Spectra of the texture at a few places: what is shown where there is no recording."""
    places = [(f, v) for f in (0.5, 1.0) for v in (0.5, 1.0)]
    looks = list(zip((BLUE, GREEN, PURPLE, ORANGE), ("blue", "green", "purple", "orange"), strict=True))
    dashes = (("dotted", (0, (1, 1.2))), ("dashed", (0, (4, 1.5))), ("dashed", (0, (7, 2))), ("solid", "-"))
    frequency = np.geomspace(20.0, min(1000.0, 0.5 * texture.rate_Hz), 400)

    def draw(figure: "Figure") -> None:
        axes = figure.add_subplot()
        shown = []
        for (force, speed), (colour, _), (_, dash) in zip(places, looks, dashes, strict=True):
            a, variance = texture.model(force * texture.force_max_N, speed * texture.speed_max_m_s)
            shown.append(decibels(metric.model_spectrum(a, variance, texture.rate_Hz, frequency)))
            axes.plot(frequency, shown[-1], color=colour, linestyle=dash)
        sounding = [level for level in shown if level.max() > -200.0] or shown
        over_frequency(axes, min(s.min() for s in sounding), max(s.max() for s in sounding))

    legend = [
        Key(f"{f * texture.force_max_N:.2g} N, {1e3 * v * texture.speed_max_m_s:.0f} mm/s", name, look)
        for (f, v), (_, name), (look, _) in zip(places, looks, dashes, strict=True)
    ]
    return Plot(
        "Spectra of the models",
        "What the texture gives at half and at full force and speed of its models.",
        drawn(draw),
        "Power spectral density of the texture over frequency at four places.",
        tuple(legend),
    )


def plot_plane(texture: Texture, channels: Channels | None) -> Plot:
    """The plane of force and speed: models, triangles, where the recording was."""
    level = decibels(texture.model_power_m2_s4)
    sounding = texture.model_power_m2_s4 > 0.0

    def draw(figure: "Figure") -> None:
        axes = figure.add_subplot()
        speed, force = 1e3 * texture.speed_m_s, texture.force_N
        axes.grid(visible=False)
        axes.triplot(speed, force, texture.triangles, color=MUTED, linewidth=0.7, zorder=1)
        if channels is not None:
            pick = slice(None, None, max(1, len(channels.force_N) // POINT_COUNT))
            axes.plot(
                1e3 * channels.speed_m_s[pick], channels.force_N[pick], ".",
                color=BLUE, markersize=2.5, alpha=0.5, zorder=2,
            )  # fmt: skip
        silent = ~sounding
        axes.plot(speed[silent], force[silent], "o", markerfacecolor="none", markeredgecolor=MUTED, zorder=3)
        axes.plot(speed[sounding], force[sounding], "o", color=ORANGE, markersize=6, zorder=4)
        if np.count_nonzero(sounding) <= 12:
            for x, y, rms in zip(speed[sounding], force[sounding], 10 ** (level[sounding] / 20), strict=True):
                right = x > 0.6 * speed.max()
                axes.annotate(
                    f"{rms:.2g} m/s²", (x, y), (-6 if right else 6, -5), textcoords="offset points",
                    ha="right" if right else "left", va="top", fontsize=8.0, zorder=5,
                )  # fmt: skip
        axes.set(xlabel="slip speed [mm/s]", ylabel="normal force [N]")
        axes.margins(0.06)

    legend = [Key("model, with its vibration (rms)", "orange", "dot"), Key("silent model", "muted", "ring")]
    beyond = ""
    if channels is not None:
        legend.append(Key("the recording", "blue", "dot"))
        moving = channels.force_N > 0.02 * channels.force_N.max()
        over = (channels.force_N > texture.force_max_N) | (channels.speed_m_s > texture.speed_max_m_s)
        share = round(100 * float(np.mean(over[moving])))
        beyond = f" {share} % of the recording lies beyond them, where those at the edge hold." if share else ""
    count = int(np.count_nonzero(sounding))
    return Plot(
        "Force and speed",
        f"{count} sounding model{'s' if count != 1 else ''}; between them a triangle's three are blended.{beyond}",
        drawn(draw),
        "Plane of slip speed and normal force with models and triangles.",
        tuple(legend),
    )


def plot_friction(swatch: Swatch, channels: Channels, states: Segmentation) -> Plot:
    """Tangential over normal force with the friction line."""
    assert channels.tangential_force_N is not None
    normal, tangential = channels.force_N, np.abs(channels.tangential_force_N)
    sliding = (states.states == State.SLIDING) & (normal > 0.1 * normal.max())
    if not np.any(sliding):
        return Plot("Friction", "The tool never slides under a normal force in the recording.")
    pick = np.flatnonzero(sliding)[:: max(1, int(sliding.sum()) // POINT_COUNT)]
    interval = swatch.intervals.get("friction_dynamic")

    def draw(figure: "Figure") -> None:
        axes = figure.add_subplot()
        axes.plot(normal[pick], tangential[pick], ".", color=BLUE, markersize=2.5, alpha=0.5)
        top = np.array([0.0, float(normal[pick].max(initial=0.1)) * 1.05])
        if interval is not None:
            axes.fill_between(top, interval[0] * top, interval[1] * top, color=SHADE, linewidth=0)
        axes.plot(top, swatch.friction_dynamic * top, color=ORANGE, linewidth=1.8)
        axes.plot(top, swatch.friction_static * top, color=INK, linestyle=(0, (4, 1.5)))
        axes.set(xlabel="normal force [N]", ylabel="tangential force [N]", xlim=(0.0, top[1]))
        axes.set_ylim(0.0, 1.3 * max(swatch.friction_static * top[1], float(np.quantile(tangential[pick], 0.95))))

    low, high = np.quantile(tangential[pick] / normal[pick], (0.05, 0.95))
    said = "" if interval is None else f" (95 % interval {interval[0]:.3f} to {interval[1]:.3f})"
    legend = [
        Key("recorded while sliding", "blue", "dot"),
        Key(f"dynamic, {swatch.friction_dynamic:.3f}", "orange"),
        Key(f"static, {swatch.friction_static:.3f}", "ink", "dashed"),
    ]
    if interval is not None:
        legend.append(Key("interval", "shade", "area"))
    return Plot(
        "Friction",
        f"Dynamic coefficient {swatch.friction_dynamic:.3f}{said}. Nine tenths of the samples lie between {low:.2f} "
        f"and {high:.2f}. A person feels a change of 11 %.",
        drawn(draw),
        "Tangential over normal force with the lines of dynamic and static friction.",
        tuple(legend),
    )


def plot_taps(taps: Taps, intervals: Mapping[str, tuple[float, float]]) -> Plot:
    """Amplitude, frequency and decay of the taps over approach speed, with their intervals."""
    speed = np.linspace(0.0, 1.25 * float(taps.approach_m_s[-1]), 200)
    tap = np.array([taps.at(float(v)) for v in speed])
    labels = ("amplitude\n[m/s²]", "frequency\n[Hz]", "decay\n[1/s]")
    bars = [
        np.array([intervals.get(f"taps.{name}[{i}]", (np.nan, np.nan)) for i in range(len(taps.approach_m_s))])
        for name in TAP_ROWS[1:]
    ]

    def draw(figure: "Figure") -> None:
        for axes, label, name, line, bar in zip(
            figure.subplots(3, 1, sharex=True), labels, TAP_ROWS[1:], tap.T, bars, strict=True
        ):
            points = getattr(taps, name)
            axes.plot(1e3 * speed, line, color=ORANGE)
            axes.vlines(1e3 * taps.approach_m_s, bar[:, 0], bar[:, 1], color=BLUE)
            axes.plot(1e3 * taps.approach_m_s, points, "o", color=BLUE, markersize=4)
            top = np.nanmax(np.concatenate([points, bar[:, 1], [1e-9]]))
            axes.set(ylabel=label, ylim=(0.0, 1.2 * float(top)))
        axes.set_xlabel("approach speed [mm/s]")
        figure.align_ylabels()

    count = len(taps.approach_m_s)
    known = any(np.isfinite(bar).any() for bar in bars)
    return Plot(
        "Taps",
        f"{count} speed{'s' if count != 1 else ''}. Below the lowest the amplitude falls to nothing at rest, "
        "above the highest its tap is given.",
        drawn(draw, 3.6),
        "Amplitude, frequency and decay of taps over approach speed.",
        (Key("what a tap gets", "orange"), Key("in the swatch" + (", 95 % interval" if known else ""), "blue", "dot")),
    )


def plot_transients(taps: Taps) -> Plot:
    """Measured transients beside their decaying sinusoids, one below the other."""
    assert taps.wave_m_s2 is not None
    count = len(taps.approach_m_s)
    rows = np.unique(np.linspace(0, count - 1, min(count, TRANSIENT_COUNT)).round().astype(int))
    rate = taps.wave_rate_Hz
    t_s = np.arange(taps.wave_m_s2.shape[1]) / rate
    waves = taps.wave_m_s2

    def draw(figure: "Figure") -> None:
        for axes, row in zip(figure.subplots(len(rows), 1, sharex=True, squeeze=False)[:, 0], rows, strict=True):
            tap = taps.at(float(taps.approach_m_s[row]))
            ideal = np.exp(-tap.decay_1_s * t_s) * np.sin(2.0 * np.pi * tap.frequency_Hz * t_s)
            axes.plot(1e3 * t_s, waves[row], color=BLUE)
            axes.plot(1e3 * t_s, tap.amplitude_m_s2 * ideal, color=ORANGE, linestyle=(0, (4, 1.5)))
            axes.set(ylabel="[m/s²]", title=f"at {1e3 * taps.approach_m_s[row]:.0f} mm/s")
        axes.set_xlabel("time from the onset [ms]")
        figure.align_ylabels()

    return Plot(
        "Tap transients",
        f"What was measured and the sinusoid fitted to it, at {len(rows)} of {count} approach speeds. The measured "
        "transient is what is played.",
        drawn(draw, 1.2 + 0.9 * len(rows)),
        "Acceleration of taps over time, measured and fitted.",
        (Key("measured", "blue"), Key("decaying sinusoid", "orange", "dashed")),
    )
