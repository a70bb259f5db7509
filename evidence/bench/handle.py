"""Compensators of the handle: error of the rendered acceleration, and time per sample."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import chirp

from hapscene.capture.fit.synthesis import synthesize
from hapscene.constants import ACCELERATION_BAND_HZ
from hapscene.dsp.spectrogram import spectrogram_error
from hapscene.handle.compensator import COMPENSATORS
from hapscene.handle.handle_loop import play, run
from hapscene.handle.handle_record import new_handle
from hapscene.handle.plant import Plant, Sensor
from hapscene.swatches.library import load_swatch

from .sheet import Sheet

Array = NDArray[np.float64]

RATE_HZ: Final = 10_000.0
DURATION_S: Final = 4.0

SPREAD: Final = 0.3
"""Largest relative error of the six parameters, uniformly distributed [1]."""

PLANTS: Final = 100
"""Number of random handles [count]."""

FIRM: Final = 4.0
"""Factor of stiffness and damping of the firm grip [1]."""

CHUNK: Final = 1000
"""Samples per timed call [count]: short, so that the minimum of many calls is undisturbed."""

SIGNALS: Final = ("white", "texture", "tap", "chirp")

PARAMETERS: Final = tuple(field.name for field in fields(Plant))[:6]


@dataclass(frozen=True)
class CompensatorErrors:
    """Spectrogram errors of a compensator for a signal [1].

    Attributes:
        nominal: error with the handle that the compensator is made for.
        median, p95: median and 95th percentile for handles whose parameters differ by up to `SPREAD`.
        firm: error with the nominal handle in a grip that is `FIRM` times as firm.
        hits: number of times that the coil hit a stop, over all handles [count].
    """

    nominal: float
    median: float
    p95: float
    firm: float
    hits: int


def signals() -> dict[str, Array]:
    """Return the signals (n,) [m/s²] at `RATE_HZ`: band-limited white noise, a texture, taps and a chirp.

    The texture is the shipped wood at 1 N and 0.1 m/s without amplitude modulation. A tap is 20 m/s² at 250 Hz,
    decaying at 60/s; the approximate inverse with f₀ = 10 Hz needs 2.1 N and 0.43 mm for it. There are eight taps,
    because the error of one depends on its position relative to the spectrogram's windows.
    """
    count = round(DURATION_S * RATE_HZ)
    t_s, rng = np.arange(count) / RATE_HZ, np.random.default_rng(0)
    frequency = np.fft.rfftfreq(count, 1.0 / RATE_HZ)
    spectrum = np.fft.rfft(rng.standard_normal(count))
    low_Hz, high_Hz = ACCELERATION_BAND_HZ
    white = np.fft.irfft(np.where((frequency >= low_Hz) & (frequency <= high_Hz), spectrum, 0.0), count)
    taps = np.zeros(count)
    for k in range(8):
        after = t_s - (0.1 + 0.4831 * k)
        taps += np.where(after > 0.0, 20.0 * np.exp(-60.0 * np.abs(after)) * np.sin(2.0 * np.pi * 250.0 * after), 0.0)
    return {
        "white": 2.0 * white / white.std(),
        "texture": synthesize(
            load_swatch("wood"), np.full(count, 1.0), np.full(count, 0.1), rate_Hz=RATE_HZ, modulation=0.0
        ),
        "tap": taps,
        "chirp": np.asarray(chirp(t_s, low_Hz, DURATION_S, high_Hz, "logarithmic")),
    }


def plants(count: int = PLANTS, spread: float = SPREAD, seed: int = 0) -> Iterator[Plant]:
    """Return random handles whose six parameters differ from the nominal ones by up to ± `spread`."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        off = rng.uniform(1.0 - spread, 1.0 + spread, len(PARAMETERS))
        yield replace(Plant(), **{name: getattr(Plant(), name) * f for name, f in zip(PARAMETERS, off, strict=True)})


def firm(plant: Plant, factor: float = FIRM) -> Plant:
    """Return the same handle in a grip that is `factor` times as firm."""
    return replace(plant, k_u_N_m=factor * plant.k_u_N_m, b_u_Ns_m=factor * plant.b_u_Ns_m)


def judge(
    desired_m_s2: Array,
    compensator: str,
    count: int = PLANTS,
    sensor: Sensor | None = None,
    nominal_sensor: Sensor | None = None,
) -> CompensatorErrors:
    """Return the errors of a compensator for a signal (n,) [m/s²], with a sensor and the data assumed about it."""

    def error(plant: Plant) -> tuple[float, int]:
        played = play(
            desired_m_s2, RATE_HZ, plant, compensator=compensator, sensor=sensor, nominal_sensor=nominal_sensor
        )
        return spectrogram_error(desired_m_s2, played.acceleration_m_s2, RATE_HZ), played.hits

    errors, hits = zip(*map(error, (Plant(), firm(Plant()), *plants(count))), strict=True)
    median, p95 = np.percentile(errors[2:], (50, 95))
    return CompensatorErrors(errors[0], float(median), float(p95), errors[1], sum(hits))


def sample_us(desired_m_s2: Array, compensator: str, repeats: int = 300) -> float:
    """Return the time per sample including the simulated handle [µs]: the minimum over calls of `CHUNK` samples."""
    handle = new_handle(Plant(), Plant(), compensator, RATE_HZ)[0]
    out, times = np.zeros((4, CHUNK)), []
    for k in range(repeats):
        part = desired_m_s2[(k * CHUNK) % (len(desired_m_s2) - CHUNK) :][:CHUNK]
        start = time.perf_counter()
        run(handle, part, out)
        times.append(time.perf_counter() - start)
    return min(times) / CHUNK * 1e6


def measure_handle(sheet: Sheet, count: int = PLANTS) -> None:
    """Measure errors and time of every compensator."""
    played = signals()
    for name in COMPENSATORS:
        case = f"handle, {name}"
        sheet.add(case, "sample least", sample_us(played["texture"], name), "µs")
        for signal, desired in played.items():
            judged = judge(desired, name, count)
            for what in ("nominal", "median", "p95", "firm"):
                sheet.add(case, f"{signal} {what}", 100.0 * getattr(judged, what), "%")
            sheet.add(case, f"{signal} stops met", judged.hits, "1")
