"""Plots of a report as inline SVG: spectra, order, force and speed, friction, taps."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapscene.capture.fit.order import PERCEPTUAL_JND, OrderSearch
from hapscene.capture.fit.segment import InteractionState, Segmentation
from hapscene.capture.io.streams import Array, Streams
from hapscene.capture.report.numbers import HeldOut
from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.surface.swatch import Swatch
from hapscene.surface.taps import TAP_ROWS, Taps
from hapscene.surface.texture import Texture
from hapscene.view.chart import inline_svg, new_chart
from hapscene.view.palette import INK, OKABE_ITO

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Plot", "plot_friction", "plot_models", "plot_order", "plot_plane", "plot_spectra", "plot_taps", "signed"]

BLUE, ORANGE, GREEN, PURPLE = (OKABE_ITO[name] for name in ("blue", "vermilion", "green", "purple"))

MUTED: Final = "#707070"
"""Colour of references; grey is visible on light and dark backgrounds."""

BAND: Final[dict[str, Any]] = {"color": OKABE_ITO["sky"], "alpha": 0.3, "linewidth": 0}
"""Style of an interval."""

POINT: Final[dict[str, Any]] = {"color": BLUE, "markersize": 3.5, "alpha": 0.5}
"""Style of recorded points."""

DOTTED: Final = (0, (1, 1.5))
DASHED: Final = (0, (4, 1.5))

WIDTH_IN: Final = 4.8
"""Width of a plot [in]; text is 10 px high on a phone with a width of 360 px."""

LINE_IN: Final = 0.19
"""Height of a line of the legend [in]."""


@dataclass(frozen=True)
class Plot:
    """A plot with title and caption; without `svg`, the caption is the reason why there is no plot."""

    title: str
    caption: str
    svg: str = ""
    alternative: str = ""


def drawn(
    name: str,
    draw: Callable[..., None],
    height_in: float = 2.9,
    columns: int = 2,
    panels: tuple[float, ...] = (1,),
    width_in: float = WIDTH_IN,
) -> str:
    """Draw a plot with a legend of `columns` above it; return the SVG element. `name` is unique on the page.

    `draw` is called with one axes for each of `panels`, which are relative heights, from top to bottom. The size
    [in] excludes the legend.
    """
    with new_chart(width_in, height_in) as figure:
        draw(*figure.subplots(len(panels), 1, sharex=True, squeeze=False, height_ratios=panels)[:, 0])
        figure.align_ylabels()
        count = sum(len(axes.get_legend_handles_labels()[1]) for axes in figure.axes)
        if count:
            figure.set_figheight(height_in + LINE_IN * -(-count // columns))
            figure.legend(loc="outside upper left", ncols=columns, fontsize=9, borderpad=0.0, columnspacing=1.2)
        return inline_svg(figure, name)


def plot_spectra(held_out: HeldOut) -> Plot:
    """Spectra of both halves of the recording and of the model of the first half."""

    def draw(axes: "Axes") -> None:
        looks = (
            ("fitted", "recorded, first half (fitted)", MUTED, 1.0, "-"),
            ("held_out", "recorded, second half (held out)", BLUE, 1.6, "-"),
            ("model", "model of the first half", ORANGE, 1.8, DASHED),
        )
        shown = []
        for name, label, colour, width, dash in looks:
            level = decibels(getattr(held_out, name))
            axes.plot(held_out.frequency_Hz, level, color=colour, linewidth=width, linestyle=dash, label=label)
            shown.append(level[(held_out.frequency_Hz >= 20.0) & (held_out.frequency_Hz <= 1000.0)])
        over_frequency(axes, np.min(shown), np.max(shown))

    return Plot(
        "Spectra",
        f"The log-spectral distance between the model of the first half and the second half is "
        f"{held_out.distance_dB:.2f} dB; the distance between the two halves is {held_out.floor_dB:.2f} dB.",
        drawn("spectra", draw, columns=1),
        "Power spectral density over frequency of both halves of the recording and of the model.",
    )


def plot_order(search: OrderSearch, order: int) -> Plot:
    """Held-out spectral distance and difference from the highest order, over the order, with that of the swatch."""

    def draw(upper: "Axes", lower: "Axes") -> None:
        upper.plot(search.orders, search.distance_dB, color=BLUE, label="held-out spectral distance")
        upper.axhline(
            search.floor_dB, color=MUTED, linestyle=DOTTED, label="floor (distance of the halves), permitted difference"
        )
        # the range omits the first orders, to resolve the flat part
        low, high = min(search.distance_dB.min(), search.floor_dB), np.quantile(search.distance_dB, 0.95)
        upper.set(ylabel="LSD [dB]", ylim=(low - 0.2 * (high - low + 0.2), high + 0.4 * (high - low + 0.2)))
        lower.axhline(PERCEPTUAL_JND, color=MUTED, linestyle=DOTTED)
        lower.plot(search.orders, search.difference_jnd, color=PURPLE, label="difference from the highest order")
        lower.set(xlabel="order of the models", ylabel="bands [JND]", ylim=(0.0, 4.0 * PERCEPTUAL_JND))
        upper.axvline(order, color=ORANGE, linestyle=DASHED, label=f"order of the swatch, {order}")
        lower.axvline(order, color=ORANGE, linestyle=DASHED)

    at = int(np.argmin(np.abs(search.orders - order)))
    return Plot(
        "Order",
        f"The swatch has order {order} with a held-out distance of {search.distance_dB[at]:.2f} dB; the best order has "
        f"{search.distance_dB.min():.2f} dB. For this recording, the search chooses order {search.chosen}, the "
        "smallest one that differs from the highest order by less than one JND in each band.",
        drawn("order", draw, 3.8, panels=(3, 2)),
        "Held-out log-spectral distance and difference from the highest order over the order of the models.",
    )


def decibels(power: Array) -> Array:
    """10 log10 of a power, with a lower limit of −300 dB."""
    return np.asarray(10.0 * np.log10(np.maximum(power, 1e-30)))


def signed(value: float, digits: int) -> str:
    """Formats a number with its sign, and with a minus sign instead of a hyphen."""
    return f"{value:+.{digits}f}".replace("-", "−")


def over_frequency(axes: "Axes", low_dB: float, high_dB: float) -> None:
    """Sets up the axes of a spectrum from 20 to 1000 Hz."""
    axes.set_xscale("log")
    axes.set(xlabel="frequency [Hz]", ylabel="density [dB re 1 (m/s²)²/Hz]", ylim=(low_dB - 3.0, high_dB + 3.0))
    axes.set_xlim(ACCELERATION_BAND_HZ)
    ticks = (20, 50, 100, 200, 500, 1000)
    axes.set_xticks(ticks, [str(f) for f in ticks])
    axes.set_xticks([], minor=True)


POINT_COUNT: Final = 800
"""Largest number of recorded points in a plot."""


def plot_models(texture: Texture) -> Plot:
    """Spectra of the texture at four combinations of force and speed, for a report without recording."""
    places = [(f, v) for f in (0.5, 1.0) for v in (0.5, 1.0)]
    looks = ((BLUE, (0, (1, 1.2))), (GREEN, DASHED), (PURPLE, (0, (7, 2))), (ORANGE, "-"))
    frequency = np.geomspace(20.0, min(1000.0, 0.5 * texture.rate_Hz), 400)

    def draw(axes: "Axes") -> None:
        shown = []
        for (force, speed), (colour, dash) in zip(places, looks, strict=True):
            force_N, speed_m_s = force * texture.force_max_N, speed * texture.speed_max_m_s
            shown.append(decibels(texture.density([force_N], [speed_m_s], frequency_Hz=frequency)[0]))
            label = f"{force_N:.2g} N, {1e3 * speed_m_s:.0f} mm/s"
            axes.plot(frequency, shown[-1], color=colour, linestyle=dash, label=label)
        active = [level for level in shown if level.max() > -200.0] or shown
        over_frequency(axes, min(s.min() for s in active), max(s.max() for s in active))

    return Plot(
        "Spectra of the models",
        "Spectra of the texture at half and at full force and speed of its models.",
        drawn("models", draw),
        "Power spectral density of the texture over frequency at four combinations of force and speed.",
    )


def plot_plane(texture: Texture, channels: Streams | None) -> Plot:
    """Plane of force and speed with models, triangles and the recording."""
    level = decibels(texture.model_power_m2_s4)
    active = texture.model_power_m2_s4 > 0.0

    def draw(axes: "Axes") -> None:
        speed, force = 1e3 * texture.speed_m_s, texture.force_N
        axes.grid(visible=False)
        axes.triplot(speed, force, texture.triangles, color=MUTED, linewidth=0.7, zorder=1)
        if channels is not None:
            pick = slice(None, None, max(1, len(channels.force_N) // POINT_COUNT))
            x, y = 1e3 * channels.speed_m_s[pick], channels.force_N[pick]
            axes.plot(x, y, ".", **POINT, zorder=2, label="the recording")
        label = "model, with its vibration (rms)"
        axes.plot(speed[active], force[active], "o", color=ORANGE, markersize=6, zorder=4, label=label)
        silent = speed[~active], force[~active]
        axes.plot(*silent, "o", markerfacecolor="none", markeredgecolor=MUTED, zorder=3, label="silent model")
        if np.count_nonzero(active) <= 12:
            for x, y, rms in zip(speed[active], force[active], 10 ** (level[active] / 20), strict=True):
                right = x > 0.6 * speed.max()
                axes.annotate(
                    f"{rms:.2g} m/s²", (x, y), (-6 if right else 6, -5), textcoords="offset points",
                    ha="right" if right else "left", va="top", fontsize=9, zorder=5,
                )  # fmt: skip
        axes.set(xlabel="slip speed [mm/s]", ylabel="normal force [N]")
        axes.margins(0.06)

    beyond = ""
    if channels is not None:
        moving = channels.force_N > 0.02 * channels.force_N.max()
        over = (channels.force_N > texture.force_max_N) | (channels.speed_m_s > texture.speed_max_m_s)
        share = round(100 * float(np.mean(over[moving])))
        beyond = f" {share} % of the recording is beyond the models and uses those at the edge." if share else ""
    count = int(np.count_nonzero(active))
    return Plot(
        "Force and speed",
        f"{count} model{'s' if count != 1 else ''}; models are interpolated in triangles.{beyond}",
        drawn("plane", draw),
        "Plane of slip speed and normal force with models and triangles.",
    )


def plot_friction(swatch: Swatch, channels: Streams, states: Segmentation) -> Plot:
    """Tangential over normal force with the friction coefficients."""
    assert channels.tangential_force_N is not None
    normal, tangential = channels.force_N, np.abs(channels.tangential_force_N)
    sliding = (states.states == InteractionState.SLIDING) & (normal > 0.1 * normal.max())
    if not np.any(sliding):
        return Plot("Friction", "The tool never slides under a normal force in the recording.")
    pick = np.flatnonzero(sliding)[:: max(1, int(sliding.sum()) // POINT_COUNT)]
    interval = swatch.intervals.get("friction_dynamic")

    def draw(axes: "Axes") -> None:
        axes.plot(normal[pick], tangential[pick], ".", **POINT, label="recorded while sliding")
        top = np.array([0.0, float(normal[pick].max(initial=0.1)) * 1.05])
        if interval is not None:
            axes.fill_between(top, interval[0] * top, interval[1] * top, **BAND, label="interval")
        dynamic, static = swatch.friction_dynamic, swatch.friction_static
        axes.plot(top, dynamic * top, color=ORANGE, linewidth=1.8, label=f"dynamic, {dynamic:.3f}")
        axes.plot(top, static * top, color=INK, linestyle=DASHED, label=f"static, {static:.3f}")
        axes.set(xlabel="normal force [N]", ylabel="tangential force [N]", xlim=(0.0, top[1]))
        axes.set_ylim(0.0, 1.3 * max(swatch.friction_static * top[1], float(np.quantile(tangential[pick], 0.95))))

    low, high = np.quantile(tangential[pick] / normal[pick], (0.05, 0.95))
    range_text = "" if interval is None else f" (95 % interval {interval[0]:.3f} to {interval[1]:.3f})"
    return Plot(
        "Friction",
        f"Dynamic coefficient {swatch.friction_dynamic:.3f}{range_text}. 90 % of the samples are between {low:.2f} and "
        f"{high:.2f}. The JND is 11 %.",
        drawn("friction", draw),
        "Tangential over normal force with the lines of dynamic and static friction.",
    )


def plot_taps(taps: Taps, intervals: Mapping[str, tuple[float, float]]) -> Plot:
    """Amplitude, frequency and decay of the taps over approach speed, with 95 % intervals."""
    speed = np.linspace(0.0, 1.25 * float(taps.approach_m_s[-1]), 200)
    tap = np.array([taps.at(float(v)) for v in speed])
    labels = ("amplitude\n[m/s²]", "frequency\n[Hz]", "decay\n[1/s]")
    numbers, unknown = range(len(taps.approach_m_s)), (np.nan, np.nan)
    bars = [np.array([intervals.get(f"taps.{name}[{i}]", unknown) for i in numbers]) for name in TAP_ROWS[1:]]
    label_points = "fitted" + (", 95 % interval" if any(np.isfinite(bar).any() for bar in bars) else "")

    def draw(*panels: "Axes") -> None:
        for axes, label, name, line, bar in zip(panels, labels, TAP_ROWS[1:], tap.T, bars, strict=True):
            points = getattr(taps, name)
            legend = ("rendered", label_points) if axes is panels[0] else (None, None)
            axes.plot(1e3 * speed, line, color=ORANGE, label=legend[0])
            axes.vlines(1e3 * taps.approach_m_s, bar[:, 0], bar[:, 1], color=BLUE)
            axes.plot(1e3 * taps.approach_m_s, points, "o", color=BLUE, markersize=4, label=legend[1])
            top = np.nanmax(np.concatenate([points, bar[:, 1], [1e-9]]))
            axes.set(ylabel=label, ylim=(0.0, 1.2 * float(top)))
        axes.set_xlabel("approach speed [mm/s]")

    count = len(taps.approach_m_s)
    return Plot(
        "Taps",
        f"{count} approach speed{'s' if count != 1 else ''}. Below the lowest, the amplitude is proportional to the "
        "speed; above the highest, it is constant.",
        drawn("taps", draw, 3.9, panels=(1, 1, 1)),
        "Amplitude, frequency and decay of taps over approach speed.",
    )
