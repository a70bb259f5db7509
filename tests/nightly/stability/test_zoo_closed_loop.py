"""Closed loop on difficult meshes: a hand guides a device along paths; contact is kept, stable and passive."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from hapscene.constants import TICK_S
from hapscene.device.model import IDEAL, limits_of
from hapscene.device.sim.point import PointMass
from hapscene.loop.reference_trajectory import ReferenceTrajectory
from hapscene.loop.result import ClosedLoopResult
from hapscene.loop.twin import Twin
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch

pytestmark = pytest.mark.filterwarnings("ignore::hapscene.scene.mesh.MeshWarning")

JUMP_DEG = {"slide_sph1k": 11.0, "plate_thin": 1.0, "vgroove45": 2.0, "edge90": 95.0, "wedge20": 180.0}
"""Cases, and the largest turn of the direction in a tick beside what the tool's own way makes: the zoo's judge."""

LEAVES = ("wedge20", "edge90")
"""Cases in which the tool leaves over an edge, so that contact is rightly lost while it is deep."""

OMNI = PointMass(0.045, 0.1, 0.26, 5.5e-5)
REST_M_S, ENERGY_J, LOST_M = 5e-3, 2e-3, 2e-4
"""Largest speed at rest, rms; largest work of the motors in a contact; depth at which contact may end."""

STILL, RELEASE = 1000, 300
"""Ticks for which the hand holds still where it is last deep, and then draws the tool out."""


def feel(
    folder: Path, name: str, device: PointMass = OMNI, stiffness_N_m: float = 500.0, grip: str = "firm", **setup: Any
) -> ClosedLoopResult:
    """A case of the zoo: its path, a hold where it is last well inside, and a way out along the surface's normal."""
    (case,) = (case for case in json.loads((folder / "cases.json").read_text()) if case["name"] == name)
    if case["mesh"] == "sph1k":
        made = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    else:
        data = np.load(folder / f"mesh_{case['mesh']}.npz")
        made = trimesh.Trimesh(data["vertices_m"], data["faces"], process=False)
    scene = Scene()
    scene.add(Mesh.from_trimesh(made, "m"), name="it", swatch=Swatch("surface", stiffness_N_m))
    setup = {"limits": limits_of("omni", TICK_S), **setup}
    twin = Twin(scene, device, ["wall"], a_rate_Hz=1.0 / TICK_S, **setup)
    tool_m = np.load(folder / f"{case['path']}.npz")["tool_m"]
    twin.renderer.reset(tool_m[0])
    seen = twin.renderer.run(tool_m)
    stop = int(np.flatnonzero(seen.depth_m >= 0.5 * seen.depth_m.max())[-1])
    out_m = np.linspace(0.0, 0.02, RELEASE)[:, None] * seen.nhat_W[stop]
    path = np.concatenate((tool_m[: stop + 1], np.tile(tool_m[stop], (STILL, 1)), tool_m[stop] + out_m))
    twin.reset(path[0])
    return twin.run(ReferenceTrajectory.along(path, grip))


def lost(felt: ClosedLoopResult) -> np.ndarray:
    """Depths (n,) [m] at which contact ended, beside what the tool moved in that tick."""
    rows = felt.recording
    ended = np.flatnonzero(rows.touching[:-1] & ~rows.touching[1:])
    moved = np.linalg.norm(np.diff(rows.p_WT_m, axis=0), axis=1)
    return rows.depth_m[ended] - moved[ended]


def jump_deg(felt: ClosedLoopResult) -> float:
    """Largest turn of the direction from tool to proxy in a tick, less what the tool's own way over its depth makes."""
    rows, depth = felt.recording, np.maximum(felt.recording.depth_m, 1e-12)
    held = rows.touching & (depth > LOST_M)
    u = (rows.p_WP_m - rows.p_WT_m) / depth[:, None]
    turn = np.arccos(np.clip((u[1:] * u[:-1]).sum(axis=1), -1.0, 1.0))
    turn -= np.linalg.norm(np.diff(rows.p_WT_m, axis=0), axis=1) / np.minimum(depth[1:], depth[:-1])
    return float(np.degrees(turn[held[1:] & held[:-1]].max(initial=0.0)))


def rest_m_s(felt: ClosedLoopResult) -> float:
    v = felt.v_W_m_s[-RELEASE - STILL // 2 : -RELEASE]
    return float(np.sqrt((v**2).sum(axis=1).mean()))


@pytest.mark.parametrize("name", JUMP_DEG)
def test_contact_is_kept_stable_and_passive(shared: Path, name: str) -> None:
    felt = feel(shared / "zoo", name)
    assert felt.recording.touching.mean() > 0.1 and np.isfinite(felt.p_W_m).all()
    assert name in LEAVES or lost(felt).max(initial=0.0) < LOST_M
    assert jump_deg(felt) <= JUMP_DEG[name]
    assert rest_m_s(felt) < REST_M_S and np.cumsum(felt.work_J).max() < ENERGY_J


def test_an_unstable_wall_is_detected(shared: Path) -> None:
    """A wall of 5000 N/m on a device without friction, with none of its limits."""
    felt = feel(shared / "zoo", "slide_sph1k", PointMass(0.045, 0.1), 5000.0, "light", limits=IDEAL)
    assert rest_m_s(felt) > REST_M_S or np.cumsum(felt.work_J).max() > ENERGY_J
