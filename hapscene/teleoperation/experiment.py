"""The haptography paper's teleoperation experiment, in simulation, and what delay does to it.

A follower Omni touches a real surface (a swatch that was fitted to a recording of one); a leader Omni, held by a hand,
is tied to it. What its accelerometer reads is what the hand should feel; what the hand feels is the acceleration of the
leader's tip, by the base motors alone, or by them and the handle. After Kuchenbecker, Romano & McMahan, "Haptography".
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import ACCELERATION_RATE_HZ, DEFAULT_GRIP
from hapscene.dsp.spectrogram import spectrogram, spectrogram_error
from hapscene.files import whole_folder
from hapscene.surface.swatch import Swatch
from hapscene.teleoperation.datagram import SAMPLE_COUNT
from hapscene.teleoperation.endpoint import Coupling
from hapscene.teleoperation.operation import Operated, Operation
from hapscene.teleoperation.test_plate import START_M, Gesture, explore, plate
from hapscene.view.chart import new_chart, save_chart
from hapscene.view.palette import INK, OKABE_ITO
from hapscene.view.plot import FREQUENCY_MAX_HZ, RANGE_DB

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Array = NDArray[np.float64]

MADE: Final = ("experiment.png", "delay.png", "experiment.npz", "summary.json")
"""What the experiment writes."""

SUMMARY_VERSION: Final = 1


@dataclass(frozen=True, eq=False)
class Rendering:
    """What a leader's hand felt of what the follower's accelerometer read.

    Attributes:
        compensator: of the handle; "none" for the base motors alone.
        desired_m_s2, rendered_m_s2: (n,) at 10 kHz, the latency taken out.
        latency_s: from the follower to the leader's handle.
        errors: spectrogram error by part: "all", "tap", "stroke"; 1.0 is that of silence.
    """

    compensator: str
    desired_m_s2: Array
    rendered_m_s2: Array
    latency_s: float
    errors: dict[str, float]


def compare_handles(
    swatch: str | Swatch,
    compensators: tuple[str, ...],
    grip: str = DEFAULT_GRIP,
    seed: int = 0,
    taps: int = 3,
    strokes: int = 4,
) -> list[Rendering]:
    """The experiment once for each compensator: taps, a press, strokes, over a line without delay."""
    coupling = Coupling("position")
    gesture = explore(grip, coupling.stiffness_N_m, taps, strokes)
    return [_render(swatch, compensator, coupling, gesture, seed) for compensator in compensators]


def _render(swatch: str | Swatch, compensator: str, coupling: Coupling, gesture: Gesture, seed: int) -> Rendering:
    operation = Operation(plate(swatch), START_M, coupling=coupling, compensator=compensator, seed=seed)
    operated = operation.run(gesture.intent)
    desired, rendered = align(operated)
    errors = {"all": spectrogram_error(desired, rendered, ACCELERATION_RATE_HZ)}
    for part, spans in gesture.parts.items():
        within = _within(spans, len(desired))
        errors[part] = spectrogram_error(desired[within], rendered[within], ACCELERATION_RATE_HZ)
    return Rendering(compensator, desired, rendered, operated.latency_s, errors)


def align(operated: Operated) -> tuple[Array, Array]:
    """Desired and rendered acceleration (n,), the rendered one moved back by the latency."""
    late = round(operated.latency_s * ACCELERATION_RATE_HZ)
    desired = operated.a_follower_m_s2.ravel()
    rendered = (operated.a_tip_m_s2 + operated.a_handle_m_s2).ravel()
    return desired[: len(desired) - late], rendered[late:]


def _within(spans: list[tuple[int, int]], count: int) -> NDArray[np.bool_]:
    """(count,) which samples lie in spans of ticks."""
    within = np.zeros(count, bool)
    for first, last in spans:
        within[first * SAMPLE_COUNT : last * SAMPLE_COUNT] = True
    return within


def write_experiment(
    out: str | Path,
    swatch: str | Swatch = "wood",
    *,
    compensator: str = "adaptive",
    grip: str = DEFAULT_GRIP,
    seed: int = 0,
    say: Callable[[str], None] = lambda text: None,
    jobs: int | None = None,
    scheduler: str | None = None,
) -> list[Path]:
    """Do the experiment and the study of delay, and write `MADE` into a folder: all of it or nothing.

    Args:
        out: the folder.
        swatch: what is touched: a name, a .swatch file, or a `Swatch`.
        compensator: of the handle, beside "none" and "inverse".
        grip: of the hand in the experiment; the study of delay has its own.
        seed: of what is drawn at random.
        say: is given the progress, piece by piece.
        jobs, scheduler: processes here, or a Dask cluster, for the study of delay. What a study that was stopped has
            done is kept beside `out`, and the same one goes on there.

    Raises:
        HapsceneError: an unknown swatch, compensator or grip.
        OSError: the folder cannot be written.
    """
    from hapscene_experiments import delay_study

    journal = Path(out).absolute().with_name(f".{Path(out).name}.sweep.jsonl")
    with whole_folder(out, ours=MADE) as folder:
        say("touching a surface through leader and follower\n")
        names = tuple(dict.fromkeys(("none", "inverse", compensator)))
        renderings = compare_handles(swatch, names, grip, seed)
        name = swatch if isinstance(swatch, str) else swatch.name
        write_experiment_plot(renderings, folder / "experiment.png", f"{name}, {grip} grip")
        _save(renderings, folder / "experiment.npz")
        outcomes = delay_study.study_delays(seed, say, journal=journal, jobs=jobs, scheduler=scheduler)
        stiffness = delay_study.study_stiffness()
        delay_study.write_delay_plot(outcomes, stiffness, delay_study.trace_delay(seed), folder / "delay.png")
        summary = {
            "format_version": SUMMARY_VERSION,
            "surface": name,
            "grip": grip,
            "seed": seed,
            "experiment": {r.compensator: _summarise(r) for r in renderings},
            "delay": delay_study.summarise_delays(outcomes),
            "stiffness": stiffness,
        }
        text = json.dumps(summary, indent=2, ensure_ascii=False, allow_nan=False)
        (folder / "summary.json").write_text(text + "\n", encoding="utf-8")
    journal.unlink(missing_ok=True)
    return [Path(out) / name for name in MADE]


def _summarise(rendering: Rendering) -> dict[str, Any]:
    return {
        "spectrogram_error": {part: round(value, 4) for part, value in rendering.errors.items()},
        "latency_ms": round(rendering.latency_s * 1e3, 3),
        "desired_rms_m_s2": round(float(rendering.desired_m_s2.std()), 4),
        "rendered_rms_m_s2": round(float(rendering.rendered_m_s2.std()), 4),
    }


def _save(renderings: list[Rendering], path: Path) -> None:
    """The signals, for other judges: desired_… and rendered_… by compensator."""
    arrays: dict[str, Any] = {f"desired_{r.compensator}_m_s2": r.desired_m_s2 for r in renderings}
    arrays |= {f"rendered_{r.compensator}_m_s2": r.rendered_m_s2 for r in renderings}
    with path.open("wb") as file:
        np.savez_compressed(file, format_version=1, a_rate_Hz=ACCELERATION_RATE_HZ, **arrays)


# experiment.png: what the follower's accelerometer read, and what the leader's hand felt, with and without handle.


TITLES: Final = {"none": "base motors alone", "inverse": "base motors and handle,\nplain inverse"}

PARTS: Final = {"all": "all", "tap": "taps", "stroke": "strokes"}

IMAGE: Final[dict[str, Any]] = {"cmap": "magma", "aspect": "auto", "origin": "lower", "interpolation": "nearest"}
"""How a spectrogram is drawn."""


def write_experiment_plot(renderings: Sequence[Rendering], path: Path, title: str) -> None:
    """Draw, column by column, desired and rendered accelerations over time, and their spectrograms."""
    count = 1 + len(renderings)
    with new_chart(4.2 * count + 0.8, 7.0, f"Teleoperation: {title}") as figure:
        _draw(figure, renderings)
        save_chart(figure, path)


def _draw(figure: "Figure", renderings: Sequence[Rendering]) -> None:
    columns = [("desired:\nthe follower's accelerometer", renderings[0].desired_m_s2, INK)]
    for rendering, colour in zip(renderings, ("blue", "green", "vermilion"), strict=False):
        name = TITLES.get(rendering.compensator, f"base motors and handle,\n{rendering.compensator}")
        error = ", ".join(f"{PARTS[part]} {100 * value:.0f} %" for part, value in rendering.errors.items())
        columns.append((f"{name}\nerror: {error}", rendering.rendered_m_s2, OKABE_ITO[colour]))
    count = len(columns)
    grid = figure.add_gridspec(2, count + 1, width_ratios=(*[1.0] * count, 0.03))
    most_m_s2 = 1.05 * max(float(np.abs(signal).max()) for _, signal, _ in columns)
    levels = [_levels(signal) for _, signal, _ in columns]
    top_dB = float(np.ceil(max(level.max() for _, _, level in levels)))
    image: Any = None
    for k, ((name, signal, colour), (t_s, frequency_Hz, level)) in enumerate(zip(columns, levels, strict=True)):
        over, under = figure.add_subplot(grid[0, k]), figure.add_subplot(grid[1, k])
        over.plot(np.arange(len(signal)) / ACCELERATION_RATE_HZ, signal, color=colour, linewidth=0.4)
        over.set_title(name)
        over.set_ylim(-most_m_s2, most_m_s2)
        under.grid(visible=False)
        over.tick_params(labelbottom=False, labelleft=k == 0)
        extent = (float(t_s[0]), float(t_s[-1]), 0.0, float(frequency_Hz[-1]))
        image = under.imshow(level.T, extent=extent, vmin=top_dB - RANGE_DB, vmax=top_dB, **IMAGE)
        under.set_ylim(0.0, FREQUENCY_MAX_HZ)
        under.set_xlabel("time [s]")
        under.tick_params(labelleft=k == 0)
        for axes in (over, under):
            axes.set_xlim(0.0, t_s[-1])
        if k == 0:
            over.set_ylabel("acceleration along the handle [m/s²]")
            under.set_ylabel("frequency [Hz]")
    figure.colorbar(image, cax=figure.add_subplot(grid[1, count]), label="dB re 1 m/s²")


def _levels(signal: Any) -> tuple[Any, Any, Any]:
    """Times, frequencies up to the highest drawn, and magnitudes in dB (n, k)."""
    t_s, frequency_Hz, magnitude = spectrogram(signal, ACCELERATION_RATE_HZ)
    seen = frequency_Hz <= FREQUENCY_MAX_HZ
    return t_s, frequency_Hz[seen], 20.0 * np.log10(np.maximum(magnitude[:, seen], 1e-15))
