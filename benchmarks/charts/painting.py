"""The question of painting: how fine the border of a painting inside faces should be, sharp or blended."""

from collections.abc import Sequence
from functools import cache
from typing import Final

import numpy as np
import trimesh
from numpy.typing import NDArray

from hapscene.renderer import Renderer
from hapscene.scene.fine_paint import SOFT_STEP
from hapscene.scene.region import Sphere
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch

from ..tick_time import hot
from .measuring import spread_us
from .question import Measure, Point, Question, Setting

FINEST_MM: Final = (2.0, 1.0, 0.5, 0.2, 0.1, 0.05)

SHARP, SOFT = "sharp border", "soft border of 4 mm"

SOFT_M: Final = 4e-3
SIDE_M, RADIUS_M, DEPTH_M = 0.1, 0.03, 1e-3
STIFF_N_M, SOFT_N_M = 800.0, 200.0

LEAST_MM: Final = 0.01
"""What is told of a border that is off by less [mm]: the path has a place so often."""


def settings(quick: bool, scene_file: str | None) -> list[Setting]:
    sizes = FINEST_MM[::2] if quick else FINEST_MM
    found = [Setting(kind, f"{mm:g} mm", {"kind": kind, "finest_mm": mm}) for kind in (SHARP, SOFT) for mm in sizes]
    found = [
        s for s in found if s.method == SHARP or s.arguments["finest_mm"] >= 0.8e3 * SOFT_M * SOFT_STEP
    ]  # no finer
    return [Setting("whole faces", "12", {"kind": "whole faces", "finest_mm": 1e6}), *found]


@cache
def painted(kind: str, finest_mm: float) -> Scene:
    """A disc of 60 mm on one side of a cube of 12 triangles."""
    scene = Scene()
    scene.add(trimesh.creation.box((SIDE_M,) * 3), "cube", unit="m", swatch=Swatch("stiff", stiffness_N_m=STIFF_N_M))
    soft_m = SOFT_M if kind == SOFT else 0.0
    region = Sphere((0.0, 0.0, SIDE_M / 2), RADIUS_M)
    scene.paint("cube", Swatch("soft", stiffness_N_m=SOFT_N_M), region, soft_m=soft_m, finest_m=1e-3 * finest_mm)
    return scene


@cache
def path() -> NDArray[np.float64]:
    """In and out over the border, all round it, at 0.02 m/s: slow, so that no lag of the weight is told."""
    t = np.arange(40_000) * 1e-3
    radius_m = RADIUS_M + 0.005 * np.sin(4.0 * t)
    z = np.full(len(t), SIDE_M / 2 - DEPTH_M)
    p = np.column_stack([radius_m * np.cos(0.16 * t), radius_m * np.sin(0.16 * t), z])
    p[0, 2] += 2.0 * DEPTH_M
    return p


def error(kind: str, finest_mm: float) -> dict[str, float]:
    """How far from its place the border is felt [mm], and the memory of its leaves."""
    scene = painted(kind, finest_mm)
    felt = Renderer(scene, ["wall"]).run(path())
    weight = (STIFF_N_M - felt.f_W_N[1:, 2] / DEPTH_M) / (STIFF_N_M - SOFT_N_M)
    off_m = np.linalg.norm(felt.p_WP_m[1:, :2], axis=1) - RADIUS_M
    if kind == SOFT:
        over = np.abs(off_m) < 0.4 * SOFT_M
        off_m = SOFT_M * (weight - (0.5 - off_m / SOFT_M))[over]
    else:
        off_m = np.where((weight > 0.5) == (off_m < 0.0), 0.0, off_m)
        off_m = off_m[off_m != 0.0] if (off_m != 0.0).any() else np.zeros(1)
    fine = scene.bodies[0].fine
    memory_kB = 1e-3 * fine.nbytes / (2e3 * np.pi * RADIUS_M) if fine is not None else np.nan
    return {"border": max(1e3 * float(np.percentile(np.abs(off_m), 95)), LEAST_MM), "memory": memory_kB}


def time(kind: str, finest_mm: float) -> tuple[float, float]:
    return spread_us(hot(Renderer(painted(kind, finest_mm)), path()[:8000], 5).tick_ns)


def advice(points: Sequence[Point]) -> str:
    sharp, soft = [p for p in points if p.method == SHARP][-2], points[-1]
    return (
        f"0.1 mm is what it is unless told. At {sharp.label} it is felt {sharp.errors['border']:.2g} mm from its place "
        f"for {sharp.errors['memory']:.2g} kB a millimetre of it. The tick does not feel how fine it is. A soft border "
        f"takes {soft.errors['memory']:.2g} kB a millimetre, and while two swatches are felt at once the tick calls "
        "the effects of contact twice."
    )


QUESTION: Final = Question(
    name="painting",
    title="How fine should the border of a painting be?",
    measures=(
        Measure("border", "border, off its place by (95 % of where it is off)", "mm"),
        Measure("memory", "memory of its pieces, per millimetre of border", "kB"),
    ),
    settings=settings,
    error=error,
    time=time,
    advice=advice,
    conditions="A disc of 60 mm on a cube of 12 triangles, 200 N/m on 800, stroked to and fro over its border all "
    "round. Truth: the circle. The renderer keeps as much memory again as is told.",
)
