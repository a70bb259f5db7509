"""The plots of a report that need the recording."""

from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from hapscene.capture import metric, metric_residual
from hapscene.capture.excitation import ExcitationChoice
from hapscene.capture.order import OrderSearch
from hapscene.capture.report_figure import BLUE, GREEN, INK, MUTED, ORANGE, PURPLE, SHADE, Key, Plot, drawn
from hapscene.capture.report_judgement import FELT_DB, HeldOut, Judgement
from hapscene.constants import ACCELERATION_BAND_HZ, EXCITATION_SPAN
from hapscene.handle.spectrogram import SPECTROGRAM_S
from hapscene.surface.texture import Texture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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
    rho = metric_residual.correlation(held_out.residual)
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
