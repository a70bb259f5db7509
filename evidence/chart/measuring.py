"""Functions that several questions share: recordings, levels in bands and times."""

from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.capture.fit.distance import band_power
from hapscene.capture.io.streams import Streams, clean
from hapscene.perception import band_edges_Hz, bands_jnd
from hapscene.render.renderer import Renderer
from hapscene.stability.rig import sheet
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import Texture
from hapscene_swatches.fit import load_source

from ..bench.tick_time import hot

Array = NDArray[np.float64]

RATE_HZ: Final = 10_000.0

RECORDINGS: Final = Path(__file__).resolve().parents[3] / "shared" / "data" / "recordings"
"""Folder of recordings beside the checkout."""

STROKES: Final = ("wood", "paper", "leather")
"""Recordings with force, speed and friction."""

BAND_EDGES_HZ: Final = band_edges_Hz()
FINE_HZ: Final = np.geomspace(BAND_EDGES_HZ[0], BAND_EDGES_HZ[-1], 481)
"""Edges of the perceptible bands, and 40 frequencies in each [Hz]."""

ISRAR: Final = "2 dB in a band (Israr, Tan & Reed 2006)"

TICKS: Final = 3000
"""Ticks that are timed [count]; 30 of them exceed the 99th percentile."""


@cache
def recorded(name: str) -> Streams:
    """Return one of `STROKES`, cleaned, at `RATE_HZ`."""
    r = load_source(name, RECORDINGS)
    return clean(r.acceleration_m_s2, r.rate_Hz, r.force_N, r.speed_m_s, r.tangential_force_N)


def texture_bands(texture: Texture, force_N: ArrayLike, speed_m_s: ArrayLike, *, held: bool = False) -> Array:
    """Return the rms (n, k) [m/s²] of a texture in the perceptible bands at forces and speeds (n,).

    With `held` the output stage is a zero-order hold, whose response is |sinc(f/rate)|.
    """
    density = texture.density(force_N, speed_m_s, frequency_Hz=FINE_HZ)
    return bands_of(FINE_HZ, density * np.sinc(FINE_HZ / texture.rate_Hz) ** 2 if held else density)


def bands_of(frequency_Hz: Array, density: Array) -> Array:
    """Return the rms (..., k) [m/s²] of a power density (..., n) [(m/s²)²/Hz] in the perceptible bands."""
    return np.asarray(np.sqrt(np.maximum(band_power(density, frequency_Hz), 0.0)))


def apart_jnd(bands_m_s2: ArrayLike, true_m_s2: ArrayLike) -> Array:
    """Return the distance (…,) [JND] between levels (…, k) of the perceptible bands and the true ones (…, k)."""
    return bands_jnd(bands_m_s2, true_m_s2, BAND_EDGES_HZ)


def spread_us(times_ns: ArrayLike) -> tuple[float, float]:
    """Return median and 99th percentile [µs] of times [ns]."""
    median, p99 = np.percentile(np.asarray(times_ns, np.float64), (50, 99))
    return 1e-3 * float(median), 1e-3 * float(p99)


def stroke_path(count: int = TICKS, tick_s: float = 1e-3) -> Array:
    """Return tool positions (n, 3) [m]: strokes over the rig's sheet at up to 0.2 m/s, 1 to 2 mm deep."""
    t = tick_s * np.arange(count)
    depth = 1.5e-3 + 0.5e-3 * np.sin(9.0 * t)
    depth[0] = -1e-3
    return np.column_stack((0.04 * np.sin(5.0 * t), np.full(count, 0.01), -depth))


def ticks_ns(renderer: Renderer, path: Array, repeats: int = 9) -> NDArray[np.int64]:
    """Return the time of each tick in contact [ns], the minimum of several runs."""
    return hot(renderer, path, repeats).tick_ns


def texture_us(swatch: Swatch, a_rate_Hz: float = RATE_HZ) -> tuple[float, float]:
    """Return median and 99th percentile of the time that the texture of a swatch adds to a tick [µs], in contact."""
    with_texture, without = (
        ticks_ns(Renderer(sheet(swatch), effects, a_rate_Hz=a_rate_Hz), stroke_path())
        for effects in (("wall", "lpc_texture"), ("wall",))
    )
    return spread_us(np.maximum(with_texture - float(np.median(without)), 1.0))
