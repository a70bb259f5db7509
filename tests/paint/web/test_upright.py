"""The question whether a mesh without a stated vertical axis is upright, through the page's real protocol."""

from pathlib import Path

import numpy as np
import pytest
from trimesh.creation import box

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")

import hapscene
from hapscene.paint.model.session import Session
from hapscene.paint.web.page import Page

from ..tab import Tab

TURNS = ("Turn it 90° about x", "Turn it 90° about y")


def test_mesh_is_turned_as_answered_in_one_step(tmp_path: Path) -> None:
    shape = box((20.0, 30.0, 40.0))
    shape.apply_translation((100.0, 0.0, 7.0))
    shape.export(tmp_path / "brick.obj")
    scene, file = hapscene.Scene(), tmp_path / "brick.scene.json"
    scene.add(tmp_path / "brick.obj", unit="mm")
    session = Session(scene, file)
    body = session.scene.bodies[0]
    with Page(session, port=0, with_hand=False, ask_upright=True) as page:
        tab = Tab(page)
        for turn, size_mm in ((TURNS[0], (20, 40, 30)), (TURNS[0], (20, 30, 40)), (TURNS[1], (40, 30, 20))):
            tab.set(turn, True)
            tab.settle()
            corners_m = body.mesh.vertices_m @ body.X_WB[:3, :3].T + body.X_WB[:3, 3]
            np.testing.assert_allclose(np.ptp(corners_m, axis=0), np.array(size_mm) / 1e3, atol=1e-9)
            np.testing.assert_allclose((corners_m.min(0) + corners_m.max(0)) / 2, (0.1, 0.0, 0.007), atol=1e-9)
        assert [c for c in tab.controls.values() if c["props"].get("label") in TURNS]  # it asks until the answer is yes
        tab.set("Yes", True)
        tab.wait(lambda: not page.context.questions)
        assert [step.what for step in session.history.done] == ["move 'brick'"]
        session.save()
        # 180° about x: diag(1, −1, −1), then 90° about y: x → −z, z → x
        expected = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]) @ np.diag([1.0, -1.0, -1.0])
        np.testing.assert_allclose(hapscene.load_scene(file).bodies[0].X_WB[:3, :3], expected, atol=1e-9)
        session.undo()
        np.testing.assert_array_equal(body.X_WB, np.eye(4))
        tab.close()


@pytest.mark.parametrize(("suffix", "asked"), [("obj", 1), ("stl", 1), ("glb", 0)])
def test_only_files_without_a_vertical_axis_are_asked_about(tmp_path: Path, suffix: str, asked: int) -> None:
    box((0.02, 0.03, 0.04)).export(tmp_path / f"brick.{suffix}")
    scene = hapscene.Scene()
    scene.add(tmp_path / f"brick.{suffix}", unit="m")
    with Page(Session(scene, tmp_path / "brick.scene.json"), port=0, with_hand=False, ask_upright=True) as page:
        assert len(page.context.questions) == asked
