"""Fit the shipped swatches: python swatches/fit.py FOLDER_OF_RECORDINGS

The recordings are public, at the commits that `SOURCES` names, but no licence is stated for them, so they are not in
this repository; the swatches hold coefficients fitted to them. Quantities that were not recorded are assumed; the
provenance of each swatch lists them.
"""

import sys
from dataclasses import dataclass, replace
from pathlib import Path

from hapscene.capture import FitOptions, fit_swatch, load_recording
from hapscene.capture.io.recording import SurfaceRecording
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_file import save_swatch
from hapscene.surface.taps import Taps

LICENCE = "MIT. No licence is stated for the recording; these are coefficients fitted to it."
RATE_HZ = 10_000.0
TAP_SPEED_M_S = 0.3  # taps are linear in speed up to here; hands are seldom faster

CDP = (
    "Fitted to the recording of a hand-held tool dragged over {name} in CdpLab/MDTextHaptDisplay at commit cfd968fb, "
    '"The dataset we collected/multidata" (friction, normal force, speed, one axis of acceleration). Its rate is not '
    "documented: 10 kHz is inferred from its low-pass at 0.01 cycles a sample, the unit m/s² from its level."
)
LMT = (
    "Fitted to G1EpoxyRasterPlate_Movement_X_test1 of the TUM LMT108 set (10 kHz, acceleration, X axis), as in "
    "luhangluis/crossmodal_graph_coding at commit 90962921. Its unit is not stated: 1 = 1 g is assumed, which puts its "
    "level (0.6 m/s² rms) among those of other plates. Force and speed were not recorded: 1 N and 0.1 m/s assumed. So "
    "their changes count as amplitude modulation; it has 0.75 of the fitted depth, with which the kurtosis is that of "
    "the recording."
)
LEVELS = {
    CDP: "rate (10 kHz) and unit (m/s²) of the recording are inferred",
    LMT: "the unit of the recording is not stated; 1 g is assumed",
}
ASSUMED = " Assumed, not recorded: stiffness, taps (form and size after Okamura et al. 2001){more}."


@dataclass(frozen=True)
class Source:
    """A recording, and assumptions for the quantities that were not recorded."""

    file: str
    provenance: str
    stiffness_N_m: float  # assumed; a Phantom Omni renders up to about 700 N/m
    tap_1_s: float  # assumed: amplitude of the tap over approach speed [m/s² per m/s]
    tap_Hz: float  # assumed
    tap_decay_1_s: float  # assumed
    albedo_rgb: tuple[float, float, float]  # colours differ in hue and lightness, for colour-blind users
    friction: tuple[float, float] | None = None  # static and dynamic; assumed if not recorded
    modulation: float = 1.0  # depth of the amplitude modulation, relative to the fitted one


SOURCES = {
    "wood": Source("cdp_wood.csv", CDP, 650.0, 50.0, 100.0, 80.0, (0.71, 0.49, 0.28)),
    "paper": Source("cdp_paper.csv", CDP, 500.0, 30.0, 80.0, 120.0, (0.96, 0.94, 0.86)),
    "leather": Source("cdp_leather.csv", CDP, 350.0, 20.0, 40.0, 60.0, (0.42, 0.18, 0.10)),
    "epoxy": Source(
        "lmt108_G1EpoxyRasterPlate_Movement_X_test1.txt",
        LMT, 700.0, 60.0, 220.0, 90.0, (0.10, 0.37, 0.58), friction=(0.30, 0.25), modulation=0.75,
    ),
}  # fmt: skip


def load_source(name: str, folder: Path) -> SurfaceRecording:
    """Load the recording of a swatch from `folder`."""
    path = folder / SOURCES[name].file
    if path.suffix == ".csv":
        columns = {"acceleration": "accel"}
        units = {"acceleration": "m/s2", "force": "N", "speed": "mm/s"}
        return load_recording(path, RATE_HZ, columns=columns, units=units)
    return load_recording(path, RATE_HZ, units={"acceleration": "g"})


def fit_shipped(name: str, folder: Path) -> Swatch:
    """Fit a swatch to its recording in `folder`."""
    source, recording = SOURCES[name], load_source(name, folder)
    swatch = fit_swatch(recording, FitOptions(name))
    static, dynamic = source.friction or (swatch.friction_static, swatch.friction_dynamic)
    amplitude = source.tap_1_s * TAP_SPEED_M_S
    return replace(
        swatch,
        stiffness_N_m=source.stiffness_N_m,
        friction_static=static,
        friction_dynamic=dynamic,
        taps=Taps([TAP_SPEED_M_S], [amplitude], [source.tap_Hz], [source.tap_decay_1_s]),
        albedo_rgb=source.albedo_rgb,
        effects={} if source.modulation == 1.0 else {"lpc_texture": {"texture_life": source.modulation}},
        provenance=source.provenance.format(name=name) + ASSUMED.format(more=", friction" if source.friction else ""),
        licence=LICENCE,
        absent={**swatch.absent, "texture.level": LEVELS[source.provenance]},
    )


def main(folder: Path) -> None:
    """Fit all swatches and write them next to this file."""
    for name in SOURCES:
        swatch = fit_shipped(name, folder)
        texture = swatch.texture
        assert texture is not None
        save_swatch(swatch, Path(__file__).with_name(f"{name}.swatch"))
        count = int((texture.variance_m2_s4 > 0.0).sum())
        warped = ", warped" if texture.warp else ""
        print(
            f"{name}: order {texture.order}{warped}, {count} model(s), friction {swatch.friction_static:.3f} static, "
            f"{swatch.friction_dynamic:.3f} dynamic"
        )


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
