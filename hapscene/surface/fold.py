"""How much of a texture the base motors may have, on a device without an actuator in its handle.

Rendered every T to a device of damping b, a lateral grating of wavelength l is passive up to an amplitude of
b l/(πT) in force, and a height field that is pressed on with N up to b l²/(2π²NT) in height: beyond, its slope is a
spring stiffer than 2b/T. A texture is no grating, but a stroke at speed v plays it as one, of wavelength v/f with f
its root-mean-square frequency as the motors have it: block by block, at most 1/(2T). Its force is the mass it is folded
in by times its acceleration a, its height that by which such a mass moves, a/(2πf)².
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from hapscene.surface.texture import Texture

SPEED_MIN_M_S: Final = 0.02
"""Slowest stroke that counts [m/s]. A texture is silent at rest, and a stroke that slow has a wavelength of 0.2 mm at
100 Hz; at half of it the motors have a third of what they have now, at twice of it twice as much."""

SPEED_COUNT: Final = 16
"""Speeds that are tried, up to the texture's highest [count]."""

FORCE_SHARES: Final = (0.25, 0.5, 1.0)
"""Normal forces that are tried, over the texture's highest [1]."""

BINS: Final = 512
"""Frequencies of the spectrum [count]."""


@dataclass(frozen=True)
class Share:
    """What motors may have of a texture, and the stroke that limits it.

    Attributes:
        share: of its acceleration [1].
        force_N, slip_m_s, wavelength_m: the stroke.
        amplitude: what all of it would be, and limit: what is passive; in force [N] for a grating, in height [m].
        grating: which of the two limits it.
    """

    share: float
    force_N: float = 0.0
    slip_m_s: float = 0.0
    wavelength_m: float = 0.0
    amplitude: float = 0.0
    limit: float = math.inf
    grating: bool = True

    def message(self, swatch: str, device: str) -> str:
        """The warning."""
        scale, unit = (1e3, "mN") if self.grating else (1e6, "µm")
        return (
            f"swatch {swatch!r}: at {self.slip_m_s:.2g} m/s its texture is {scale * self.amplitude:.3g} {unit} of "
            f"{1e3 * self.wavelength_m:.2g} mm waves, and the motors of the {device} hold {scale * self.limit:.2g} "
            f"{unit}: they get {100.0 * self.share:.2g} % of it; an actuator in the handle takes all"
        )


def share_of(texture: "Texture", mass_kg: float, own_damping_Ns_m: float, tick_s: float) -> Share:
    """The share of a texture that may be folded, by `mass_kg`, into the force of a device."""
    if mass_kg == 0.0 or math.isinf(own_damping_Ns_m):
        return Share(1.0)
    top = texture.speed_max_m_s
    speed = np.linspace(min(SPEED_MIN_M_S, 0.5 * top), top, SPEED_COUNT)
    worst = Share(1.0)
    for part in FORCE_SHARES:
        force = np.full(SPEED_COUNT, part * texture.force_max_N)
        rms_m_s2, frequency_Hz = _in_blocks(*texture.models(force, speed), texture.rate_Hz, tick_s)
        for N, v, a, f in zip(force, speed, rms_m_s2, frequency_Hz, strict=True):
            if a == 0.0:
                continue
            l = v / f  # noqa: E741 (the wavelength, as in the formulas)
            grating = math.sqrt(2.0) * mass_kg * a, own_damping_Ns_m * l / (math.pi * tick_s)
            height = (
                math.sqrt(2.0) * a / (2.0 * math.pi * f) ** 2,
                own_damping_Ns_m * l * l / (2.0 * math.pi**2 * N * tick_s),
            )
            for amplitude, limit in (grating, height):
                if limit < worst.share * amplitude:
                    first = (amplitude, limit) == grating
                    worst = Share(limit / amplitude, float(N), float(v), float(l), amplitude, limit, first)
    return worst


def _in_blocks(
    a: NDArray[np.float64], variance: NDArray[np.float64], rate_Hz: float, tick_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Root mean square [m/s²] and root-mean-square frequency [Hz], each (n,), of models' output averaged by ticks."""
    f = (np.arange(BINS) + 0.5) * rate_Hz / (2.0 * BINS)
    gain2 = np.abs(np.fft.rfft(a, 4 * BINS, axis=1)[:, 1 : 2 * BINS : 2]) ** -2.0  # at those frequencies
    power = variance[:, None] * gain2 / BINS * np.sinc(f * tick_s) ** 2
    heard = np.abs(f - np.round(f * tick_s) / tick_s)
    total = power.sum(axis=1)
    frequency = np.sqrt((power * heard**2).sum(axis=1) / np.where(total > 0.0, total, 1.0))
    return np.sqrt(total), frequency
