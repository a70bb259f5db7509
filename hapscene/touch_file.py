"""What a touch is kept in: numbers, plots, a picture and sound, and a summary of them."""

import json
import platform
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import ViewError
from hapscene.recording import Recording
from hapscene.records import Flag

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

MADE: Final = ("touch.npz", "touch.csv", "summary.json", "plots.png", "scene.png", "feel.wav")
"""What is written of every touch, in the order it is named."""

SUMMARY_VERSION: Final = 1

_PACKAGES: Final = ("hapscene", "embreex", "numba", "numpy", "scipy", "trimesh", "matplotlib", "pyrender2")


def summarise(recording: Recording, title: str, **more: Any) -> dict[str, Any]:
    """The content of summary.json: how long, how much contact, how fast, what went wrong, which versions."""
    touching = recording.touching
    names = {
        "bodies": (recording.body, recording.body_names),
        "swatches": (recording.swatch, recording.swatch_names),
    }
    return {
        "format_version": SUMMARY_VERSION,
        "scene": title,
        "ticks": len(recording),
        "ticks_in_contact": int(np.count_nonzero(touching)),
        **{
            f"ticks_on_{what}": {name: int(np.count_nonzero(touching & (index == i))) for i, name in enumerate(known)}
            for what, (index, known) in names.items()
        },
        "a_rate_Hz": recording.a_rate_Hz,
        "a_samples_per_tick": recording.a_m_s2.shape[1],
        "effects": list(recording.effects),
        "seed": recording.seed,
        "time_per_tick_us": {
            "whole": _spread_us(recording.tick_ns),
            "contact": _spread_us(recording.contact_ns),
        },
        "flags": {str(flag.name): int(np.count_nonzero(recording.flags & flag)) for flag in Flag},
        "depth_max_m": float(recording.depth_m.max(initial=0.0)),
        "force_max_N": float(np.linalg.norm(recording.f_W_N, axis=1).max(initial=0.0)),
        "acceleration_max_m_s2": float(np.abs(recording.a_m_s2).max(initial=0.0)),
        **more,
        "versions": {"python": platform.python_version(), **{name: _version(name) for name in _PACKAGES}},
        "machine": f"{platform.system()} {platform.machine()}",
    }


def write_touch(
    scene: "Scene",
    recording: Recording,
    folder: Path,
    title: str,
    with_picture: bool,
    say: Callable[[str], None],
    a_heard_m_s2: NDArray[np.float64] | None = None,
    dark: bool = False,
    **more: Any,
) -> dict[str, str]:
    """Write `MADE` into `folder`, `more` into its summary; return what is missing, and why.

    feel.wav has the accelerations `a_heard_m_s2` (n, block), where they are not those that the recording asks for. With
    `dark`, pictures are on dark ground.
    """
    from hapscene.view.palette import DARK, LIGHT, albedo_colours
    from hapscene.view.picture import write_picture
    from hapscene.view.plot import write_plot
    from hapscene.view.sound import write_sound

    missing: dict[str, str] = {}
    with ThreadPoolExecutor(1) as beside:  # the picture is drawn by another process meanwhile
        picture = None
        if with_picture:
            theme = DARK if dark else LIGHT
            picture = beside.submit(write_picture, scene, recording, folder / "scene.png", None, theme)
        with step(say, "writing touch.npz, touch.csv, feel.wav"):
            recording.save(folder / "touch.npz")
            recording.save_csv(folder / "touch.csv")
            heard = recording if a_heard_m_s2 is None else replace(recording, a_m_s2=a_heard_m_s2)
            full_scale_m_s2 = write_sound(heard, folder / "feel.wav")
        with step(say, "plotting plots.png"):
            heading = f"{title}: {len(recording):,} ticks, {np.count_nonzero(recording.touching):,} in contact"
            write_plot(recording, folder / "plots.png", heading, albedo_colours(scene.swatches), dark)
        if picture is not None:
            with step(say, "drawing scene.png"):
                try:
                    picture.result()
                except ViewError as error:
                    missing["scene.png"] = str(error)
    summary = summarise(recording, title, feel_wav_full_scale_m_s2=full_scale_m_s2, missing=missing, **more)
    text = json.dumps(summary, indent=2, ensure_ascii=False, allow_nan=False)
    (folder / "summary.json").write_text(text + "\n", encoding="utf-8")
    return missing


@contextmanager
def step(say: Callable[[str], None], what: str) -> Iterator[None]:
    """Say what is being done, and how long it took."""
    say(f"{what} … ")
    start_s = time.perf_counter()
    try:
        yield
    except BaseException:
        say("\n")
        raise
    say(f"{time.perf_counter() - start_s:.2f} s\n")


def _spread_us(time_ns: NDArray[np.int64]) -> dict[str, float]:
    """Median, p99, p99.9 and maximum of times [µs]."""
    points = np.percentile(time_ns, (50, 99, 99.9, 100)) / 1e3
    return {name: round(float(us), 3) for name, us in zip(("median", "p99", "p99_9", "max"), points, strict=True)}


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
