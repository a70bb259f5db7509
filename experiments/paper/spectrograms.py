"""Spectrograms of several signals on one scale of colours, one below the other."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.fit import distance as metric
from hapscene.capture.report.plots import decibels, drawn
from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.dsp.spectrogram import SPECTROGRAM_S

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RANGE_DB: Final = 50.0
"""Range of the spectrograms below their maximum [dB]."""


def spectrogram_panels(name: str, signals: Mapping[str, NDArray[np.float64]], rate_Hz: float) -> str:
    """Spectrograms of signals (n,) by title, one below the other on one scale of colours: the SVG element `name`.

    Raises:
        CaptureError: a signal that is shorter than a window.
    """
    seen = {title: metric.spectrogram(signal, rate_Hz) for title, signal in signals.items()}
    top = max(decibels(magnitude**2).max() for _, _, magnitude in seen.values())
    step = 0.5 * SPECTROGRAM_S

    def draw(*axes: "Axes") -> None:
        for one, (label, (time, frequency, magnitude)) in zip(axes, seen.items(), strict=True):
            shown = frequency <= ACCELERATION_BAND_HZ[1]
            image = one.imshow(
                decibels(magnitude[:, shown] ** 2).T,
                origin="lower", aspect="auto", cmap="cividis", vmin=top - RANGE_DB, vmax=top, interpolation="nearest",
                extent=(time[0] - 0.5 * step, time[-1] + 0.5 * step, -0.5 * frequency[1], frequency[shown][-1]),
            )  # fmt: skip
            one.set(title=label, ylabel="frequency [Hz]", ylim=(ACCELERATION_BAND_HZ))
            one.grid(visible=False)
        axes[-1].set_xlabel("time [s]")
        bar = axes[0].figure.colorbar(image, ax=axes, label="level [dB re 1 m/s²]", aspect=40, pad=0.02)
        cast(Any, bar.outline).set_visible(False)
        cast(Any, bar.solids).set_rasterized(True)  # or each of its 256 colours is a path

    return drawn(name, draw, 1.8 + 1.4 * len(signals), panels=(1,) * len(signals))
