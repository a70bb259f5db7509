"""What `hapscene device play-file` writes, for a command is thin: what a hand would feel, as sound and as a plot."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np
import scipy

from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.dsp.spectrogram import SPECTROGRAM_S, decibels, spectrogram
from hapscene.handle.plant import Array, Plant
from hapscene.handle.playback import Played
from hapscene.io.files import whole_file
from hapscene.view.chart import new_chart, save_chart
from hapscene.view.palette import INK, OKABE_ITO
from hapscene.view.plot import STYLE, envelope
from hapscene.view.sound import PEAK_DBFS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["write_playback", "write_wave"]


SHOWN_S: Final = 0.05
"""How much of the signals is shown over time, around the strongest moment [s]: in more, no single wave can be seen."""

RANGE_DB: Final = 50.0
"""Range of the spectrograms below their maximum [dB]."""


def write_wave(acceleration_m_s2: Array, rate_Hz: float, path: Path) -> float:
    """Write an acceleration as WAV, mono, 16 bit; gives what full scale stands for [m/s²], 0 for silence.

    Raises:
        OSError: the folder is missing or cannot be written.
    """
    full_m_s2 = float(np.abs(acceleration_m_s2).max(initial=0.0)) / 10 ** (PEAK_DBFS / 20)
    wave = acceleration_m_s2 / (full_m_s2 or 1.0)
    with whole_file(path) as part:
        scipy.io.wavfile.write(part, round(rate_Hz), np.rint(wave * 32767).astype(np.int16))
    return full_m_s2


def write_playback(desired_m_s2: Array, played: Played, rate_Hz: float, plant: Plant, title: str, path: Path) -> None:
    """Draw desired and rendered acceleration, their spectrograms, and force and travel within their limits, as PNG.

    Raises:
        OSError: the folder is missing or cannot be written.
    """
    with new_chart(13, 12, title, STYLE) as figure:
        grid = figure.add_gridspec(5, 2, height_ratios=(2, 2, 2, 1.2, 1.2), width_ratios=(1, 0.012))
        zoom = figure.add_subplot(grid[0, 0])
        wanted = figure.add_subplot(grid[1, 0])
        rows = [wanted, *(figure.add_subplot(grid[row, 0], sharex=wanted) for row in range(2, 5))]
        _draw_moment(zoom, desired_m_s2, played.acceleration_m_s2, rate_Hz)
        bar = figure.add_subplot(grid[1:3, 1])
        _draw_spectrograms(rows[:2], bar, (desired_m_s2, played.acceleration_m_s2), rate_Hz)
        _draw_use(rows[2], played.force_N, plant.force_limit_N, rate_Hz, "force [N]")
        _draw_use(rows[3], 1e3 * played.travel_m, 1e3 * plant.travel_limit_m, rate_Hz, "travel [mm]")
        for one in rows[:-1]:
            one.tick_params(labelbottom=False)
        rows[-1].set_xlabel("time [s]")
        rows[-1].set_xlim(0.0, len(desired_m_s2) / rate_Hz)
        figure.align_ylabels([zoom, *rows])
        save_chart(figure, path)


def _draw_moment(ax: "Axes", desired: Array, rendered: Array, rate_Hz: float) -> None:
    """Both over time, around the strongest moment of the desired one."""
    count = min(len(desired), round(SHOWN_S * rate_Hz))
    first = int(np.clip(np.argmax(np.abs(desired)) - count // 3, 0, len(desired) - count))
    part, t_s = slice(first, first + count), (first + np.arange(count)) / rate_Hz
    ax.plot(t_s, desired[part], color=INK, linewidth=3.0, alpha=0.35, label="desired")
    ax.plot(t_s, rendered[part], color=OKABE_ITO["vermilion"], linewidth=1.3, label="rendered")
    ax.set(xlabel="time [s], at the strongest moment", ylabel="acceleration\n[m/s²]", xlim=(t_s[0], t_s[-1]))
    ax.legend(loc="upper left", bbox_to_anchor=(0.0, 1.18), ncols=2, borderaxespad=0.0)


def _draw_spectrograms(axes: list["Axes"], bar: "Axes", both: tuple[Array, Array], rate_Hz: float) -> None:
    """Both on one scale of colours."""
    levels = [spectrogram(signal, rate_Hz) for signal in both]
    top = max(float(decibels(magnitude).max()) for _, _, magnitude in levels)
    for ax, label, (time_s, frequency_Hz, magnitude) in zip(axes, ("desired", "rendered"), levels, strict=True):
        step_s, shown = 0.25 * SPECTROGRAM_S, frequency_Hz <= 1.02 * ACCELERATION_BAND_HZ[1]
        image = ax.imshow(
            decibels(magnitude[:, shown]).T,
            origin="lower", aspect="auto", cmap="cividis", vmin=top - RANGE_DB, vmax=top, interpolation="nearest",
            extent=(time_s[0] - step_s, time_s[-1] + step_s, -0.5 * frequency_Hz[1], frequency_Hz[shown][-1]),
        )  # fmt: skip
        ax.set(ylabel=f"{label},\nfrequency [Hz]", ylim=(0.0, ACCELERATION_BAND_HZ[1]))
        ax.grid(visible=False)
    colours = ax.figure.colorbar(image, cax=bar, label="level [dB re 1 m/s²]")
    cast(Any, colours.outline).set_visible(False)


def _draw_use(ax: "Axes", values: Array, limit: float, rate_Hz: float, label: str) -> None:
    """How much of the force or the travel is used, every peak kept."""
    t_s, low, high = envelope(np.arange(len(values)) / rate_Hz, values)
    colour = OKABE_ITO["blue"]
    ax.fill_between(t_s, low, high, facecolor=colour, edgecolor=colour, linewidth=0.5)
    for sign in (-1.0, 1.0):
        ax.axhline(sign * limit, color=INK, linewidth=1.0, linestyle=(0, (4, 3)))
    ax.set_ylim(-1.12 * limit, 1.12 * limit)
    ax.set_ylabel(label)
