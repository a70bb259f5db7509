"""The zoo in closed loop: nothing pops, nothing buzzes, nothing gives energy; and what would is found out."""

import json
from pathlib import Path

import numpy as np
import pytest

from hapscene.device.model import IDEAL
from hapscene_experiments import zoo_case
from hapscene_experiments.zoo_case import ENERGY_MJ, ZooCase, draw_zoo, zoo_cases

pytestmark = pytest.mark.filterwarnings("ignore::hapscene.scene.mesh.MeshWarning")

QUICK = ("slide_sph1k", "plate_thin", "vgroove45", "edge90", "wedge20", "open_boundary", "moving_plate_0.05")


@pytest.mark.parametrize("name", QUICK)
def test_case(shared: Path, name: str) -> None:
    rows = list(zoo_cases(shared / "zoo", [name]))
    assert len(rows) == 4
    for row in rows:
        assert row.ok, row


@pytest.mark.soak
def test_all_cases(shared: Path) -> None:
    for row in zoo_cases(shared / "zoo"):
        assert row.ok, row


def test_at_2_m_s_the_tick_is_late(shared: Path) -> None:
    """A tool that leaves at v is pushed half a tick too long; what came out of nothing before is taken back then."""
    light, firm = zoo_cases(shared / "zoo", ["fast2ms"], ["point"])
    assert 1.0 < light.energy_mJ < ENERGY_MJ
    assert light.lost == 0 and light.jump_deg == 0.0 and light.rest_mm_s < 1e-3
    assert light.ok and firm.ok


@pytest.fixture
def box(tmp_path: Path) -> Path:
    """A zoo of one case: the top of a box, touched and left."""
    import trimesh

    mesh = trimesh.creation.box((0.1, 0.1, 0.02))
    np.savez(tmp_path / "mesh_box.npz", vertices_m=mesh.vertices, faces=mesh.faces)
    height = 0.012 - 0.005 * np.clip(np.linspace(0.0, 2.0, 800), 0.0, 1.0)
    path = np.column_stack((np.linspace(-0.02, 0.02, 800), np.full(800, 0.003), height))
    np.savez(tmp_path / "box.npz", tool_m=path)
    case = {"name": "box", "mesh": "box", "ticks": 800, "kind": "mesh", "path": "box"}
    (tmp_path / "cases.json").write_text(json.dumps([case]))
    return tmp_path


def test_hand_pushes_as_hard_as_it_says(box: Path) -> None:
    (row,) = zoo_cases(box, devices=["point"], grips=["firm"])
    assert row.ok
    assert row.depth_mm == pytest.approx(6.0, abs=0.6)  # 3 N on 500 N/m, but for the device's own friction


def test_what_buzzes_is_found(box: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A wall of 3000 N/m on a device without friction, with none of its limits."""
    monkeypatch.setattr(zoo_case, "STIFFNESS_N_M", 3000.0)
    monkeypatch.setitem(zoo_case.DEVICES, "point", zoo_case.PointMass(0.045, 0.1))
    (row,) = zoo_cases(box, devices=["point"], grips=["light"], limits=IDEAL)
    assert row.rest_mm_s > 5.0 and row.energy_mJ > ENERGY_MJ and not row.ok


def test_a_row_is_judged() -> None:
    fine = dict(id="a/point/light", touching=0.5, not_finite=0, lost=0, jump_deg=1.0, jump_limit_deg=3.0, rest_mm_s=0.0)
    fine |= dict(energy_mJ=0.0, depth_mm=6.0, limited=0.0)
    assert ZooCase(**fine).ok
    for name, value in dict(not_finite=1, lost=1, jump_deg=4.0, rest_mm_s=5.1, energy_mJ=2.1, touching=0.0).items():
        assert not ZooCase(**(fine | {name: value})).ok


def test_chart(box: Path, tmp_path: Path) -> None:
    draw_zoo(list(zoo_cases(box)), tmp_path / "zoo.png")
    assert (tmp_path / "zoo.png").read_bytes().startswith(b"\x89PNG")
