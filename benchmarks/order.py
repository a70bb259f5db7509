"""Textures of many orders: made from a shipped swatch for timing, judged on held-out recordings where there are any."""

from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from hapscene.capture import FitOptions, SurfaceRecording, fit_swatch, load_recording, synthesize
from hapscene.capture.fit.order import search_order
from hapscene.capture.streams import clean
from hapscene.surface.library import load_swatch
from hapscene.surface.swatch import Swatch

from .sheet import Sheet

ORDERS: Final = (8, 20, 40, 80, 120)
"""Orders that are timed [count]."""

FORCE_N, SPEED_M_S, DURATION_S = 1.0, 0.1, 10.0
"""What the texture is played at before it is fitted again."""

RECORDINGS: Final[dict[str, tuple[str, dict[str, Any]]]] = {
    name: (
        f"cdp_{name}.csv",
        {"columns": {"acceleration": "accel"}, "units": {"acceleration": "m/s2", "force": "N", "speed": "mm/s"}},
    )
    for name in ("wood", "paper", "leather")
} | {"epoxy": ("lmt108_G1EpoxyRasterPlate_Movement_X_test1.txt", {"units": {"acceleration": "g"}})}
"""Recordings that the shipped swatches were fitted to, and how they are read."""

RATE_HZ: Final = 10_000.0


def swatch_of_order(order: int) -> Swatch:
    """The shipped wood, its texture played for `DURATION_S` and fitted again at `order`: real in level and spectrum."""
    wood = load_swatch("wood")
    count = round(DURATION_S * RATE_HZ)
    force_N, speed_m_s = np.full(count, FORCE_N), np.full(count, SPEED_M_S)
    played = synthesize(wood, force_N, speed_m_s, rate_Hz=RATE_HZ)
    fitted = fit_swatch(
        SurfaceRecording(RATE_HZ, played, force_N, speed_m_s), FitOptions(f"wood {order}", order, model_count=1)
    )
    return replace(wood, name=fitted.name, texture=fitted.texture)


def measure_recordings(sheet: Sheet, folder: Path) -> None:
    """Log-spectral distance between each order's model of one half of a recording and the other half."""
    for name, (file, words) in RECORDINGS.items():
        recording = load_recording(folder / file, RATE_HZ, **words)
        found = search_order(clean(recording.acceleration_m_s2, RATE_HZ).acceleration_m_s2, RATE_HZ)
        distance = dict(zip(found.orders.tolist(), found.distance_dB, strict=True))
        for order in ORDERS:
            if order in distance:
                sheet.add(f"recording {name}", f"order {order} distance", distance[order], "dB")
        sheet.add(f"recording {name}", "chosen order", found.chosen, "1")
        sheet.add(f"recording {name}", "floor", found.floor_dB, "dB")
