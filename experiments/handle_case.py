"""The handle where it fails: a sensor that is later or slower than believed, and a coil that meets its stops.

The learning compensator is the only loop that is closed through the accelerometer. It is judged by the error of what is
felt, over that of `flat`, which hears nothing: where it is larger, learning does harm. Stops are met by handles that
are other than believed, where the governor's model of the travel is; how much other in closed form.
"""

from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.dsp.spectrogram import spectrogram_error
from hapscene.handle.governor import TRAVEL_SHARE
from hapscene.handle.handle_record import LATE_S as LEARNT_LATE_S
from hapscene.handle.plant import Plant
from hapscene.handle.playback import Played, play
from hapscene.handle.sensor import ACCELEROMETER_HZ, Sensor
from hapscene.stability.answer import Answer
from hapscene.stability.wall_chart import draw_panels
from hapscene.view.palette import INK, OKABE_ITO

Array = NDArray[np.float64]

RATE_HZ: Final = 10_000.0

DURATION_S: Final = 1.0
"""How long is played [s]: the second half is judged, when it is learnt."""

LATE_S: Final = (-0.0003, -0.0001, 0.0, 0.0001, 0.0003, 0.0006, 0.001, 0.002)
"""How much later the sensor is than believed [s]; it is believed to be `BELIEVED_S` late."""

BELIEVED_S: Final = 0.0005

BANDWIDTHS: Final = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
"""Bandwidth of the accelerometer over what is believed [1]."""

OFF: Final = 0.3
"""How far mass, spring and damping of coil, handle and hand are off what is believed [1]."""

PARTS: Final = ("m_c_kg", "k_s_N_m", "b_s_Ns_m", "m_h_kg", "k_u_N_m", "b_u_Ns_m")

FREQUENCIES_HZ: Final = (5.0, 10.0, 15.0, 20.0, 30.0, 50.0, 100.0)
"""At which stops are looked for [Hz]."""

LOUD_M_S2: Final = (2.0, 10.0, 50.0, 200.0)
"""How loud [m/s²]: from what fits to far more than the coil can do."""


ON_LIGHT: Final = "#402000"
ON_DARK: Final = "#FFF0C0"
"""Text on the map's light and dark fields: no greys, which dark ground would turn."""


def plants(off: float = OFF) -> list[Plant]:
    """The corners of what a handle may be: each of the six numbers that much more or less than believed."""
    nominal = Plant()
    signs = product((1.0 - off, 1.0 + off), repeat=len(PARTS))
    return [replace(nominal, **{n: s * getattr(nominal, n) for n, s in zip(PARTS, row, strict=True)}) for row in signs]


def noise(duration_s: float = DURATION_S, seed: int = 3) -> Array:
    """White noise between 20 and 1000 Hz, 2 m/s² rms."""
    count = round(duration_s * RATE_HZ)
    spectrum = np.fft.rfft(np.random.default_rng(seed).standard_normal(count))
    frequency = np.fft.rfftfreq(count, 1.0 / RATE_HZ)
    white = np.fft.irfft(np.where((frequency > 20.0) & (frequency < 1000.0), spectrum, 0.0), count)
    return np.asarray(2.0 * white / white.std())


@cache
def felt_error(compensator: str, late_s: float, bandwidth: float, count: int) -> float:
    """Error of what is felt [1], the median over `count` handles with such a sensor."""
    desired, believed = noise(), Sensor(delay_s=BELIEVED_S)
    sensor = replace(believed, delay_s=BELIEVED_S + late_s, bandwidth_Hz=bandwidth * ACCELEROMETER_HZ)
    half, errors = len(desired) // 2, []
    for plant in plants()[5 :: 64 // count][:count]:
        played = play(desired, RATE_HZ, plant, compensator=compensator, sensor=sensor, believed=believed)
        errors.append(spectrogram_error(desired[half:], played.acceleration_m_s2[half:], RATE_HZ))
    return float(np.median(errors))


def harm(late_s: float, bandwidth: float, count: int = 4) -> float:
    """Error of the learning compensator over that of `flat`, which hears nothing [1]: above 1 learning does harm."""
    return felt_error("adaptive", late_s, bandwidth, count) / felt_error("flat", 0.0, 1.0, count)


def travel_ratio(frequency_Hz: float, off: float = OFF) -> float:
    """Travel of the coil per force, over what is believed, the most of all handles that are off so far [1]: in closed
    form, R/F = ((m_c + m_h)s² + b_u s + k_u)/den(s) of `hapscene.handle.plant`."""
    s = 2j * np.pi * frequency_Hz

    def travel(p: Plant) -> float:
        z = p.b_s_Ns_m * s + p.k_s_N_m
        below = (p.m_c_kg * s**2 + z) * (p.m_h_kg * s**2 + z + p.b_u_Ns_m * s + p.k_u_N_m) - z**2
        return float(abs(((p.m_c_kg + p.m_h_kg) * s**2 + p.b_u_Ns_m * s + p.k_u_N_m) / below))

    return max(map(travel, plants(off))) / travel(Plant())


def swings(frequency_Hz: float, size_m_s2: float, plant: Plant, compensator: str, seconds: float = 0.6) -> Played:
    """A vibration that swells over a fifth of a second, played."""
    t_s = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    desired = size_m_s2 * np.minimum(1.0, 5.0 * t_s) * np.sin(2.0 * np.pi * frequency_Hz * t_s)
    return play(desired, RATE_HZ, plant, compensator=compensator)


@cache
def knocks(frequency_Hz: float, compensator: str = "flat", off: float = OFF, each: int = 4) -> float:
    """Share of handles, of all loudnesses, whose coil meets a stop [1]."""
    some = plants(off)[::each]
    hits = [swings(frequency_Hz, a, p, compensator).hits > 0 for a in LOUD_M_S2 for p in some]
    return float(np.mean(hits))


def later_than_believed_s(late_s: float, bandwidth: float) -> float:
    """How much later a reading is in all than is believed [s]: a slower pole is late, too."""
    return late_s + (1.0 / bandwidth - 1.0) / (2.0 * np.pi * ACCELEROMETER_HZ)


def hits_after(start_s: float, end_s: float, frequency_Hz: float = 30.0, size_m_s2: float = 10.0) -> int:
    """Most stops that a handle `OFF` meets between two times of a vibration that goes on, the compensator learning."""
    runs = [[swings(frequency_Hz, size_m_s2, p, "adaptive", t).hits for t in (start_s, end_s)] for p in plants()[::8]]
    return max(end - start for start, end in runs)


def handle_cases() -> list[Answer]:
    """All of them, in some seconds."""
    rows = []
    for late_s, bandwidth, most in (
        (0.0, 1.0, 0.2),
        (0.0001, 0.5, 0.2),
        (0.0003, 0.5, 1.02),
        (0.002, 1.0, 1.02),
        (0.0, 0.1, 2.0),
    ):
        total_ms = 1e3 * later_than_believed_s(late_s, bandwidth)
        what = f"a sensor {total_ms:.2f} ms later than believed, bandwidth × {bandwidth:g}: error over that of flat [1]"
        found = harm(late_s, bandwidth)
        rows.append(Answer(f"sensor-{1e3 * late_s:g}ms-{bandwidth:g}", what, most, found, 0.0, at_most=True))
    most = max(knocks(f, off=0.1) for f in FREQUENCIES_HZ)
    rows.append(Answer("stops-10", "handles 10 % off, flat: share that meets a stop [1]", 0.0, most, 0.0))
    what = "handles 30 % off at 30 Hz, adaptive: stops met in the second second [count]"
    rows.append(Answer("stops-30", what, 4.0, hits_after(1.0, 2.0), 0.0, at_most=True))
    return rows


def draw_handle_limits(path: Path) -> None:
    """Chart: where learning helps, is given up and harms, over lateness and bandwidth; and which handles meet stops."""

    def draw(figure: Any, axes: Any) -> None:
        left, right = axes[0]
        errors = np.array([[harm(late_s, b) for b in BANDWIDTHS] for late_s in LATE_S])
        image = left.imshow(np.log2(errors), origin="lower", aspect="auto", cmap="RdBu_r", vmin=-4.0, vmax=4.0)
        for i, j in np.ndindex(errors.shape):
            dark = abs(np.log2(errors[i, j])) > 2.5
            left.text(
                j, i, f"{errors[i, j]:.2f}", ha="center", va="center", fontsize=9, color=ON_DARK if dark else ON_LIGHT
            )
        beyond = [[later_than_believed_s(late_s, b) > 3.0 * LEARNT_LATE_S for b in BANDWIDTHS] for late_s in LATE_S]
        left.contour(np.array(beyond, float), [0.5], colors=ON_LIGHT, linewidths=1.6)
        left.set_xticks(range(len(BANDWIDTHS)), [f"{b:g}" for b in BANDWIDTHS])
        left.set_yticks(range(len(LATE_S)), [f"{1e3 * late_s:g}" for late_s in LATE_S])
        left.grid(False)
        left.set(xlabel="bandwidth of the accelerometer over what is believed", ylabel="later than believed [ms]")
        left.set_title("Error of learning over that of flat; line: given up")
        figure.colorbar(
            image, ax=left, ticks=(-3, 0, 1), format=lambda x, _: f"{2.0**x:g}", label="1: as without learning"
        )
        line = np.geomspace(4.0, 200.0, 120)
        for off, (colour, marker) in zip(
            (0.1, 0.2, 0.3), (("blue", "o"), ("green", "s"), ("orange", "D")), strict=True
        ):
            right.plot(
                line, [travel_ratio(f, off) for f in line], color=OKABE_ITO[colour], label=f"{100 * off:g} % off"
            )
            for f in FREQUENCIES_HZ:
                met = knocks(f, off=off) > 0.0
                style = {"fillstyle": "full" if met else "none", "markersize": 7}
                right.plot(f, travel_ratio(f, off), marker, color=OKABE_ITO[colour], **style)
        right.axhspan(1.0 / TRAVEL_SHARE, 6.0, color=OKABE_ITO["vermilion"], alpha=0.12, linewidth=0)
        right.plot([], [], "o", fillstyle="full", linestyle="", label="some meet a stop", color=INK)
        right.plot([], [], "o", fillstyle="none", linestyle="", label="none does", color=INK)
        right.set(
            xscale="log", ylim=(1.0, 6.0), xlabel="frequency [Hz]", ylabel="travel over what is foreseen, at most [1]"
        )
        right.set_title("Handles other than believed, flat: the coil's stops")
        right.legend(loc="upper right", fontsize=9)

    draw_panels(path, 1, 2, (6.2, 4.8), draw)
