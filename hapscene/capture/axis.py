"""Three axes of acceleration made one: DFT321.

A person feels the strength and the spectrum of a vibration, hardly its direction. DFT321 makes one signal whose
spectrum has the summed power of the axes at each frequency (Landin, Romano, McMahan & Kuchenbecker 2010,
"Dimensional Reduction of High-Frequency Accelerations for Haptic Rendering", EuroHaptics):

    |A(f)|² = Σ_i |A_i(f)|²,   ∠A(f) = ∠ Σ_i A_i(f)
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import CaptureError

Array = NDArray[np.float64]

WINDOW_S: Final = 0.1
"""Window of `one_axis` [s]. Over a whole recording the method keeps the spectrum, but not when what happened: each
frequency is scaled by a factor that jumps about, which spreads a tap over the recording. A window bounds that."""

CUTOFF_HZ: Final = 10.0
"""What is below is taken out first [Hz]: gravity turns with the hand, and the sign of the sum flips with it. It takes
0.03 dB at 20 Hz, where the band begins."""


def dft321(axes: Array) -> Array:
    """One signal (n,) of the axes (k, n), taken as a whole: of their summed power at each frequency, exactly."""
    spectra = np.fft.rfft(axes, axis=1)
    together = spectra.sum(axis=0)
    size = np.abs(together)
    # where the axes cancel the phase is open: that of the strongest axis is as good as any
    strongest = np.take_along_axis(spectra, np.abs(spectra).argmax(axis=0)[None], axis=0)[0]
    lost = size <= 1e-9 * np.abs(strongest)
    together = np.where(lost, strongest, together)
    size = np.abs(together)
    magnitude = np.sqrt((np.abs(spectra) ** 2).sum(axis=0))
    return np.asarray(np.fft.irfft(magnitude * together / np.where(size > 0.0, size, 1.0), axes.shape[1]))


def one_axis(axes: Array, rate_Hz: float) -> Array:
    """One signal (n,) of one to three axes (k, n): DFT321 in windows, of what each axis has above `CUTOFF_HZ`.

    Windows of `WINDOW_S`, half overlapped, weighted by the root of a Hann window before and after. What overlaps adds
    up short of its power where the phases of two windows differ: each window's span gets that back, so that the power
    over time stays that of the axes. One axis is passed through as it is.

    Raises:
        CaptureError: no or more than three axes, or too short to be filtered.
    """
    from scipy.signal import butter, sosfiltfilt

    if axes.ndim != 2 or not 1 <= len(axes) <= 3:
        raise CaptureError(f"acceleration must have one to three axes, its shape is {axes.shape}")
    if len(axes) == 1:
        return np.asarray(axes[0])
    if axes.shape[1] < WINDOW_S * rate_Hz or rate_Hz < 4.0 * CUTOFF_HZ:
        raise CaptureError(
            f"three axes of {axes.shape[1]} samples at {rate_Hz:g} Hz: at least {WINDOW_S:g} s are needed"
        )
    sections = butter(4, CUTOFF_HZ, "highpass", fs=rate_Hz, output="sos")
    axes = np.asarray(sosfiltfilt(sections, axes, axis=1))
    hop = max(1, round(0.5 * WINDOW_S * rate_Hz))
    count = -(-axes.shape[1] // hop) + 1
    padded = np.zeros((len(axes), (count + 1) * hop))
    padded[:, hop : hop + axes.shape[1]] = axes
    weight = np.sin(np.pi * (np.arange(2 * hop) + 0.5) / (2 * hop))  # the root of a Hann window
    made, hann = np.zeros(padded.shape[1]), weight**2
    for start in range(0, count * hop, hop):
        part = slice(start, start + 2 * hop)
        made[part] += weight * dft321(weight * padded[:, part])
    gain = np.zeros(padded.shape[1])
    for start in range(0, count * hop, hop):
        part = slice(start, start + 2 * hop)
        power = float((hann * made[part] ** 2).sum())
        gain[part] += hann * np.sqrt(float((hann * padded[:, part] ** 2).sum()) / power if power > 0.0 else 0.0)
    return np.asarray((gain * made)[hop : hop + axes.shape[1]])
