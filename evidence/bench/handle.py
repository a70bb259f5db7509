"""The handle's compensators: error of what is felt against what was asked for, and time per sample."""

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
from hapscene.handle.handle_loop import new_handle
from hapscene.handle.plant import Plant
from hapscene.handle.playback import play, run
from hapscene.handle.sensor import ACCELEROMETER_HZ, Sensor
from hapscene.swatches.library import load_swatch

from .sheet import Sheet

Array = NDArray[np.float64]

RATE_HZ: Final = 10_000.0
DURATION_S: Final = 4.0

SPREAD: Final = 0.3
"""How far each of the six parameters may be off, evenly distributed [1]."""

PLANTS: Final = 100
"""Handles that are drawn so [count]."""

FIRM: Final = 4.0
"""How much firmer the grip is, stiffness and damping, where it is firm [1]."""

CHUNK: Final = 1000
"""Samples that are timed at once [count]: short, so that the least of many is undisturbed."""

SIGNALS: Final = ("white", "texture", "tap", "chirp")

NOISY: Final = 10.0
"""How much louder the accelerometer's noise is than that of the assumed one, where it is noisy [1]."""

QUIET: Final = 0.2
"""What is played of the texture where it is quiet [1]: 0.33 m/s², root mean square."""


@dataclass(frozen=True)
class Condition:
    """How the handle is heard, what is believed of that, and what is played, how many times as loud."""

    sensor: Sensor
    believed: Sensor
    signals: tuple[str, ...]
    loud: float = 1.0


def _known(sensor: Sensor, signals: tuple[str, ...] = SIGNALS, loud: float = 1.0) -> Condition:
    return Condition(sensor, sensor, signals, loud)


_NOISY: Final = Sensor(noise_m_s2_rtHz=NOISY * Sensor().noise_m_s2_rtHz)

CONDITIONS: Final = {
    "known delay of 0 ms": _known(Sensor()),
    "known delay of 0.3 ms": _known(Sensor(delay_s=0.3e-3)),
    "known delay of 1 ms": _known(Sensor(delay_s=1e-3)),
    "0.1 ms later than believed": Condition(Sensor(delay_s=0.4e-3), Sensor(delay_s=0.3e-3), SIGNALS),
    "0.1 ms earlier than believed": Condition(Sensor(delay_s=0.2e-3), Sensor(delay_s=0.3e-3), SIGNALS),
    "pole at half of what is believed": Condition(Sensor(bandwidth_Hz=0.5 * ACCELEROMETER_HZ), Sensor(), SIGNALS),
    f"noise × {NOISY:g}, texture × {QUIET:g}": _known(_NOISY, ("texture",), QUIET),
    f"the same, noise × {NOISY:g} not known": Condition(_NOISY, Sensor(), ("texture",), QUIET),
    "force commanded, tap × 8": _known(Sensor(force_measured=False), ("tap",), 8.0),
    "force commanded, white × 20": _known(Sensor(force_measured=False), ("white",), 20.0),
    "force commanded, texture × 20": _known(Sensor(force_measured=False), ("texture",), 20.0),
}
"""Sensors as they are and as they are believed to be; loudest last: the governor then fades most of it."""

PARAMETERS: Final = tuple(field.name for field in fields(Plant))[:6]


@dataclass(frozen=True)
class Judged:
    """Spectrogram errors of a compensator on a signal [1].

    Attributes:
        nominal: of the handle that the compensator was made for.
        median: of handles whose six parameters are off by up to `SPREAD`.
        p95: of them, what 95 % stay below.
        firm: of the nominal handle in a grip `FIRM` times as firm.
        hits: how often the coil met a stop in all of them [count].
    """

    nominal: float
    median: float
    p95: float
    firm: float
    hits: int


def signals() -> dict[str, Array]:
    """What is played, each (n,) [m/s²] at `RATE_HZ`: white noise of the band, a texture, taps and a chirp.

    The texture is the shipped wood at 1 N and 0.1 m/s, steady. A tap is 20 m/s² at 250 Hz, decaying at 60/s: with the
    approximate inverse of f₀ = 10 Hz it asks for 2.1 N and 0.43 mm, as the tap of the project's reference does. There
    are eight, for the error of one depends on where it lies between the spectrogram's windows.
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
    """Handles with each of the six parameters off the nominal by up to ± `spread`, evenly."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        off = rng.uniform(1.0 - spread, 1.0 + spread, len(PARAMETERS))
        yield replace(Plant(), **{name: getattr(Plant(), name) * f for name, f in zip(PARAMETERS, off, strict=True)})


def firm(plant: Plant, factor: float = FIRM) -> Plant:
    """The same handle in a grip that many times as firm."""
    return replace(plant, k_u_N_m=factor * plant.k_u_N_m, b_u_Ns_m=factor * plant.b_u_Ns_m)


def judge(
    desired_m_s2: Array,
    compensator: str,
    count: int = PLANTS,
    sensor: Sensor | None = None,
    believed: Sensor | None = None,
) -> Judged:
    """The errors of a compensator on a signal (n,) [m/s²], with that sensor, taken for what is believed."""

    def error(plant: Plant) -> tuple[float, int]:
        played = play(desired_m_s2, RATE_HZ, plant, compensator=compensator, sensor=sensor, believed=believed)
        return spectrogram_error(desired_m_s2, played.acceleration_m_s2, RATE_HZ), played.hits

    errors, hits = zip(*map(error, (Plant(), firm(Plant()), *plants(count))), strict=True)
    median, p95 = np.percentile(errors[2:], (50, 95))
    return Judged(errors[0], float(median), float(p95), errors[1], sum(hits))


def sample_us(desired_m_s2: Array, compensator: str, repeats: int = 300) -> float:
    """Time of a sample [µs], plant and all: the least over stretches of `CHUNK`, which nothing else disturbed."""
    handle = new_handle(Plant(), Plant(), compensator, RATE_HZ)[0]
    out, times = np.zeros((4, CHUNK)), []
    for k in range(repeats):
        part = desired_m_s2[(k * CHUNK) % (len(desired_m_s2) - CHUNK) :][:CHUNK]
        start = time.perf_counter()
        run(handle, part, out)
        times.append(time.perf_counter() - start)
    return min(times) / CHUNK * 1e6


def measure_handle(sheet: Sheet, count: int = PLANTS) -> None:
    """Note errors and time of every compensator."""
    played = signals()
    for name in COMPENSATORS:
        case = f"handle, {name}"
        sheet.add(case, "sample least", sample_us(played["texture"], name), "µs")
        for signal, desired in played.items():
            judged = judge(desired, name, count)
            for what in ("nominal", "median", "p95", "firm"):
                sheet.add(case, f"{signal} {what}", 100.0 * getattr(judged, what), "%")
            sheet.add(case, f"{signal} stops met", judged.hits, "1")
