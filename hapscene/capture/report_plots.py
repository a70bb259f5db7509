"""How the plots of a report are made: Matplotlib's SVG, its colours turned into the page's own, light or dark."""

import io
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from hapscene.capture import metric
from hapscene.capture.excitation import ExcitationChoice
from hapscene.capture.order_search import OrderSearch
from hapscene.capture.report_numbers import FELT_DB, HeldOut, Judgement
from hapscene.capture.segment import InteractionState, Segmentation
from hapscene.capture.streams import Streams
from hapscene.constants import ACCELERATION_BAND_HZ, EXCITATION_SPAN
from hapscene.dsp.spectrogram import SPECTROGRAM_S
from hapscene.surface.swatch import Swatch
from hapscene.surface.taps import TAP_ROWS, Taps
from hapscene.surface.texture import Texture
from hapscene.view.palette import OKABE_ITO

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


COLOURS: Final = {
    "ink": ("#1b1f24", "#e6e9ed"),
    "muted": ("#5c6570", "#a3acb7"),
    "grid": ("#dfe3e8", "#313942"),
    "shade": ("#cfe3f1", "#203a4c"),
    "blue": (OKABE_ITO["blue"].lower(), "#5ab4e8"),
    "orange": (OKABE_ITO["vermilion"].lower(), "#f29a4a"),
    "green": (OKABE_ITO["green"].lower(), "#3fcfa4"),
    "purple": ("#a8457f", "#d98bb5"),
}
"""Colours of the plots by name, on light and on dark ground: Okabe & Ito's, shifted where their contrast on the
ground would be less than 3 to 1. Lines that must be told apart differ in dash or width as well."""

INK, MUTED, GRID, SHADE = (COLOURS[name][0] for name in ("ink", "muted", "grid", "shade"))
BLUE, ORANGE, GREEN, PURPLE = (COLOURS[name][0] for name in ("blue", "orange", "green", "purple"))

WIDTH_IN: Final = 4.4
"""Width of a plot [in]. At 9 points its text is 10 px high on a phone of 360 px."""

_STYLE: Final[dict[str, Any]] = {
    "svg.fonttype": "none",  # text stays text: small, and searched, read aloud and copied
    "font.family": "DejaVu Sans",  # its metrics are laid out with; the page names look-alikes
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 9.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "lines.linewidth": 1.4,
    "text.parse_math": False,
    "axes.formatter.use_mathtext": False,
    "axes.unicode_minus": True,
}


@dataclass(frozen=True)
class Key:
    """An entry of a plot's legend: what the lines or points of a look are."""

    text: str
    colour: str
    look: str = "solid"  # solid, dashed, dotted, dot, ring, area


@dataclass(frozen=True)
class Plot:
    """A plot of the page: a drawing, or the reason why there is none."""

    title: str
    caption: str
    svg: str = ""
    alternative: str = ""
    legend: tuple[Key, ...] = ()
    wide: bool = False


def drawn(draw: Callable[["Figure"], None], height_in: float = 2.7, width_in: float = WIDTH_IN) -> str:
    """The SVG element that `draw` fills, its colours those of the page; the same for the same content."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    with rc_context(cast(Any, _STYLE | {"svg.hashsalt": f"{draw.__qualname__}{height_in}"})):
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        FigureCanvasSVG(figure)
        draw(figure)
        text = io.StringIO()
        figure.savefig(text, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r' (?:width|height)="[\d.]+pt"', "", svg, count=2)  # the page sets them
    for name, (light, _) in COLOURS.items():
        svg = svg.replace(light, f"var(--{name})")
    return svg.strip()


# The plots of a report that need the recording.


Array = NDArray[np.float64]

RANGE_DB: Final = 50.0
"""Range of the spectrograms below their maximum [dB]."""

SHOWN_S: Final = 4.0
"""Longest stretch of a spectrogram [s]: more is too fine to see."""


def plot_spectra(held_out: HeldOut) -> Plot:
    """Real halves and the model of the first, over frequency."""

    def draw(figure: "Figure") -> None:
        axes = figure.add_subplot()
        looks = (("fitted", MUTED, 1.0, "-"), ("held_out", BLUE, 1.6, "-"), ("model", ORANGE, 1.8, (0, (4, 1.5))))
        low, high = [], []
        for name, colour, width, dash in looks:
            level = decibels(getattr(held_out, name))
            axes.plot(held_out.frequency_Hz, level, color=colour, linewidth=width, linestyle=dash)
            shown = level[(held_out.frequency_Hz >= 20.0) & (held_out.frequency_Hz <= 1000.0)]
            low.append(shown.min())
            high.append(shown.max())
        over_frequency(axes, min(low), max(high))

    return Plot(
        "Spectra",
        f"The model of the first half follows the second, which it has not seen, to {held_out.distance_dB:.2f} dB "
        f"(root mean square, shape only). The two real halves differ by {held_out.floor_dB:.2f} dB.",
        drawn(draw),
        "Power spectral density over frequency of both halves of the recording and of the model.",
        (
            Key("recorded, first half (fitted)", "muted"),
            Key("recorded, second half (held out)", "blue"),
            Key("model of the first half", "orange", "dashed"),
        ),
    )


def plot_spectrograms(judgement: Judgement) -> Plot:
    """The recording and the swatch played along its force and speed, on one scale of colours."""
    rate = judgement.channels.rate_Hz
    count = min(len(judgement.synthetic), round(SHOWN_S * rate))
    both = [
        metric.spectrogram(signal[:count], rate)
        for signal in (judgement.channels.acceleration_m_s2, judgement.synthetic)
    ]
    top = max(decibels(magnitude**2).max() for _, _, magnitude in both)

    def draw(figure: "Figure") -> None:
        axes = figure.subplots(2, 1, sharex=True, sharey=True)
        for one, label, (time, frequency, magnitude) in zip(axes, ("recorded", "synthesised"), both, strict=True):
            shown = frequency <= ACCELERATION_BAND_HZ[1]
            step = 0.5 * SPECTROGRAM_S
            image = one.imshow(
                decibels(magnitude[:, shown] ** 2).T,
                origin="lower", aspect="auto", cmap="cividis", vmin=top - RANGE_DB, vmax=top, interpolation="nearest",
                extent=(time[0] - 0.5 * step, time[-1] + 0.5 * step, -0.5 * frequency[1], frequency[shown][-1]),
            )  # fmt: skip
            one.set(title=label, ylabel="frequency [Hz]", ylim=(ACCELERATION_BAND_HZ))
            one.grid(visible=False)
        axes[1].set_xlabel("time [s]")
        bar = figure.colorbar(image, ax=axes, label="level [dB re 1 m/s²]", aspect=40, pad=0.02)
        cast(Any, bar.outline).set_visible(False)
        cast(Any, bar.solids).set_rasterized(True)  # or each of its 256 colours is a path

    return Plot(
        "Spectrograms",
        f"The error between the two is {100 * judgement.spectrogram_error:.0f} % of the recording. A synthesised "
        "texture repeats the statistics and not the waveform: other noise of exactly the same spectrum and level has "
        "66 %, no output 100 %.",
        drawn(draw, 4.2),
        "Spectrograms of the recording and of the synthesised vibration.",
    )


def plot_order(search: OrderSearch, texture: Texture) -> Plot:
    """Held-out error and cost of each order."""

    def draw(figure: "Figure") -> None:
        upper, middle, lower = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2, 2))
        upper.axhline(search.floor_dB, color=MUTED, linestyle=(0, (1, 1.5)))
        upper.plot(search.orders, search.distance_dB, color=BLUE)
        # the first orders are off the scale on purpose: what matters is the flat part
        low, high = min(search.distance_dB.min(), search.floor_dB), np.quantile(search.distance_dB, 0.95)
        upper.set(ylabel="LSD [dB]", ylim=(low - 0.2 * (high - low + 0.2), high + 0.4 * (high - low + 0.2)))
        middle.axhline(search.allowed_dB, color=MUTED, linestyle=(0, (1, 1.5)))
        middle.plot(search.orders, search.misfit_dB, color=PURPLE)
        middle.set(ylabel="misfit [dB]", ylim=(0.0, 5.0 * search.allowed_dB))
        lower.semilogy(search.orders, search.residual, color=GREEN)
        lower.set(xlabel="order of the models", ylabel="residual [1]")
        lower.set_ylim(0.9 * search.residual.min(), min(1.1 * search.residual.max(), 3.0 * search.residual.min()))
        _plain_log(lower)
        figure.align_ylabels()
        for axes in (upper, middle, lower):
            axes.axvline(texture.order, color=ORANGE, linestyle=(0, (4, 1.5)))
        cost = upper.secondary_xaxis("top", functions=(_times(texture.rate_Hz), _times(1.0 / texture.rate_Hz)))
        cost.set_xlabel(f"cost [10⁶ multiplications a second at {texture.rate_Hz / 1e3:g} kHz]")

    at = int(np.argmin(np.abs(search.orders - texture.order)))
    return Plot(
        "Order",
        f"Order {texture.order} is in the swatch; held-out distance {search.distance_dB[at]:.2f} dB, the best of all "
        f"orders {search.distance_dB.min():.2f} dB. On this recording the search chooses {search.plain}: the smallest "
        f"whose misfit, what it misses of the recording's own spectrum, is at most {search.allowed_dB:.2f} dB. "
        + (
            ""
            if search.noise is None
            else f"With white noise beneath, {search.chosen} misses nothing: the rest would describe the sensor. "
        )
        + "The residual is the share of the power that a model leaves of the half it was not fitted to.",
        drawn(draw, 4.4),
        "Held-out log-spectral distance and residual over the order of the models.",
        (
            Key("held-out spectral distance", "blue"),
            Key("misfit", "purple"),
            Key("held-out residual", "green"),
            Key("floor (of the halves), misfit allowed", "muted", "dotted"),
            Key(f"order of the swatch, {texture.order}", "orange", "dashed"),
        ),
    )


def plot_whiteness(held_out: HeldOut) -> Plot:
    """Autocorrelation of the held-out residual with its bounds."""
    rho = metric.correlation(held_out.residual)
    bound = 1.96 / np.sqrt(len(held_out.residual))
    beyond = float(np.mean(np.abs(rho) > bound))

    def draw(figure: "Figure") -> None:
        axes = figure.add_subplot()
        axes.axhspan(-bound, bound, color=SHADE, linewidth=0)
        axes.vlines(np.arange(1, len(rho) + 1), 0.0, rho, color=BLUE, linewidth=1.3)
        axes.axhline(0.0, color=INK, linewidth=0.8)
        reach = max(0.1, 1.15 * np.abs(rho).max())
        axes.set(xlabel="lag [samples]", ylabel="autocorrelation [1]", ylim=(-reach, reach), xlim=(0, len(rho) + 1))

    test = held_out.whiteness
    said = f"p = {test.p_value:.2g}" if test.p_value >= 1e-4 else "p < 0.0001"
    return Plot(
        "Residual: is it white?",
        f"Of what the model leaves of the held-out half, {100 * beyond:.0f} % of the lags are beyond the bounds; white "
        f"noise has 5 %. Ljung–Box Q = {test.statistic:.0f} on {test.freedom} degrees of freedom, {said}: "
        + ("nothing speaks against white." if test.p_value > 0.05 else "not white. Long recordings fail it by traces."),
        drawn(draw),
        "Autocorrelation of the held-out residual over lag.",
        (Key("autocorrelation", "blue"), Key("95 % bounds of white noise", "shade", "area")),
    )


def plot_bands(held_out: HeldOut) -> Plot:
    """Level of the model over that of the held-out half, band by band."""
    edge = np.array(metric.BAND_EDGES_HZ)
    over = np.abs(held_out.band_dB) > FELT_DB

    def draw(figure: "Figure") -> None:
        axes = figure.add_subplot()
        axes.axhspan(-FELT_DB, FELT_DB, color=SHADE, linewidth=0)
        axes.bar(
            edge[:-1], held_out.band_dB, 0.94 * np.diff(edge), align="edge",
            color=np.where(over, ORANGE, BLUE), linewidth=0,
        )  # fmt: skip
        axes.axhline(0.0, color=INK, linewidth=0.8)
        reach = max(4.0, 1.15 * float(np.abs(held_out.band_dB).max()))
        over_frequency(axes, -reach, reach)
        axes.set(ylabel="model over recording [dB]", ylim=(-reach, reach))

    return Plot(
        "Level, band by band",
        f"In {int(over.sum())} of {len(over)} bands the model is louder or softer than the held-out half by more than "
        f"{FELT_DB:g} dB, which a person feels. All together: {signed(held_out.level_dB, 1)} dB.",
        drawn(draw),
        "Difference of level of model and held-out half in twelve bands.",
        (Key("not felt", "blue", "area"), Key("felt", "orange", "area"), Key(f"±{FELT_DB:g} dB", "shade", "area")),
    )


def plot_distribution(held_out: HeldOut, choice: ExcitationChoice, texture: Texture) -> Plot:
    """Distribution of the held-out residual against Gaussian noise and the swatch's excitation."""
    edge = np.linspace(-8.0, 8.0, 65)
    middle = 0.5 * (edge[1:] + edge[:-1])
    knots = texture.excitation

    def draw(figure: "Figure") -> None:
        axes = figure.add_subplot()
        axes.stairs(_density(held_out.residual, edge), edge, color=BLUE, linewidth=1.4, baseline=None)
        axes.plot(middle, np.exp(-0.5 * middle**2) / np.sqrt(2.0 * np.pi), color=MUTED, linestyle=(0, (1, 1.5)))
        if knots.size:
            axes.plot(middle, _bent(knots, edge), color=ORANGE, linestyle=(0, (4, 1.5)), linewidth=1.6)
        axes.set_yscale("log")
        axes.set(xlabel="residual [standard deviations]", ylabel="density [1]", ylim=(1e-5, 1.0), xlim=(-8, 8))
        axes.set_yticks([10.0**n for n in range(-5, 1)], ["10⁻⁵", "10⁻⁴", "0.001", "0.01", "0.1", "1"])
        axes.set_yticks([], minor=True)

    legend = [Key("held-out residual", "blue"), Key("Gaussian", "muted", "dotted")]
    if knots.size:
        legend.append(Key("excitation of the swatch", "orange", "dashed"))
    nearer = "the measured one" if choice.empirical < choice.gaussian else "Gaussian noise"
    return Plot(
        "Residual: how is it distributed?",
        f"Excess kurtosis {held_out.kurtosis:.1f}; Gaussian noise has 0, bursts have more. On held-out pieces the "
        f"vibration is {choice.gaussian:.3f} standard deviations off with Gaussian noise, {choice.empirical:.3f} with "
        f"the measured one (mean distance of amplitudes): {nearer} is nearer. The swatch has "
        + ("the measured one." if knots.size else "Gaussian noise."),
        drawn(draw),
        "Density of the held-out residual beside a Gaussian and the swatch's excitation.",
        tuple(legend),
    )


def decibels(power: Array) -> Array:
    """10 log10, silence far down and not infinite."""
    return np.asarray(10.0 * np.log10(np.maximum(power, 1e-30)))


def signed(value: float, digits: int) -> str:
    """The number with its sign, a minus and no hyphen."""
    return f"{value:+.{digits}f}".replace("-", "−")


def over_frequency(axes: "Axes", low_dB: float, high_dB: float) -> None:
    """The axes of a spectrum: 20 to 1000 Hz."""
    axes.set_xscale("log")
    axes.set(xlabel="frequency [Hz]", ylabel="density [dB re 1 (m/s²)²/Hz]", ylim=(low_dB - 3.0, high_dB + 3.0))
    axes.set_xlim(ACCELERATION_BAND_HZ)
    ticks = (20, 50, 100, 200, 500, 1000)
    axes.set_xticks(ticks, [str(f) for f in ticks])
    axes.set_xticks([], minor=True)


def _density(values: Array, edge: Array) -> Array:
    """Histogram as density (k,); empty bins are not drawn."""
    count = np.histogram(values, edge)[0]
    return np.where(count > 0, count / (len(values) * np.diff(edge)), np.nan)


def _bent(knots: Array, edge: Array) -> Array:
    """Density (k,) of an excitation between edges (k+1,): where the noise lies below x, its deviate lies below z."""
    from scipy.special import ndtr

    z = np.linspace(-EXCITATION_SPAN, EXCITATION_SPAN, len(knots))
    slope = np.diff(knots)[[0, -1]] / (z[1] - z[0])  # beyond the last knots it goes on straight
    low, high = ((edge - knots[end]) / max(slope[end], 1e-9) + z[end] for end in (0, -1))
    at = np.where(edge < knots[0], low, np.where(edge > knots[-1], high, np.interp(edge, knots, z)))
    return np.asarray(np.diff(ndtr(at)) / np.diff(edge))


def _plain_log(axes: "Axes") -> None:
    """Ticks of a logarithmic axis of less than a decade as plain numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _times(rate_Hz: float) -> Any:
    scale = rate_Hz / 1e6 if rate_Hz >= 1.0 else rate_Hz * 1e6
    return lambda order: np.asarray(order) * scale


# The plots of a report that show the swatch itself, with the recording behind it where there is one.


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


def plot_plane(texture: Texture, channels: Streams | None) -> Plot:
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


def plot_friction(swatch: Swatch, channels: Streams, states: Segmentation) -> Plot:
    """Tangential over normal force with the friction line."""
    assert channels.tangential_force_N is not None
    normal, tangential = channels.force_N, np.abs(channels.tangential_force_N)
    sliding = (states.states == InteractionState.SLIDING) & (normal > 0.1 * normal.max())
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
