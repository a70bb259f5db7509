"""The 3-D view on a scene of viser that only records its nodes."""

from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")

from hapscene.paint.model.display import Display
from hapscene.paint.model.session import Session
from hapscene.paint.web.view import ARROW_N, ROOM, SHOWN, Pointer, SceneView, ToolMarks, quaternion, rotation
from hapscene.scene.scene import Scene

DOWN = np.array([0.0, 1.0, 0.0, 0.0])
"""Quaternion of an eye that looks down: half a turn about x."""


class Nodes:
    """Records what is added to a scene of viser, by name."""

    def __init__(self) -> None:
        self.made: dict[str, Any] = {}

    def __getattr__(self, method: str) -> Any:
        def add(name: str = "", *arguments: Any, **fields: Any) -> Any:
            place = {"position": np.zeros(3), "wxyz": np.zeros(4), "visible": True}
            node = self.made[name] = SimpleNamespace(**place | fields)
            node.remove = lambda: self.made.pop(name)
            node.on_update = lambda report: setattr(node, "report", report)
            return node

        return add


@pytest.fixture
def camera() -> Any:
    return SimpleNamespace(wxyz=DOWN, position=np.array([0.0, 0.0, 6.0]), look_at=np.zeros(3), fov=0.8)


@pytest.fixture
def view(scene: Scene, camera: Any) -> SceneView:
    server: Any = SimpleNamespace(scene=Nodes(), initial_camera=SimpleNamespace(), atomic=nullcontext)
    server.get_clients = lambda: {1: SimpleNamespace(camera=camera)}
    painting = Session(scene).painting
    return SceneView(server, painting, Display(painting))


def test_a_ray_goes_through_the_pointer(view: SceneView, camera: Any) -> None:
    for x, y, slope in ((0.5, 0.5, (0.0, 0.0)), (1.0, 0.5, (4 / 3, 0.0)), (0.5, 1.0, (0.0, -1.0))):
        found = view.ray(Pointer(1, x, y, 800, 600))
        assert found is not None
        np.testing.assert_allclose(found[0], view.middle_W_m + np.array([0.0, 0.0, 6.0 / view.scale]))
        np.testing.assert_allclose(found[1][:2] / -found[1][2], np.tan(0.4) * np.array(slope), atol=1e-12)
        assert np.linalg.norm(found[1]) == pytest.approx(1.0)
    assert view.ray(Pointer(2, 0.5, 0.5, 800, 600)) is None
    for name, value in (("fov", 0.0), ("fov", np.pi), ("wxyz", np.zeros(4)), ("position", np.full(3, np.nan))):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(camera, name, value)
            assert view.ray(Pointer(1, 0.5, 0.5, 800, 600)) is None, name


def test_a_camera_frames_the_bodies_that_are_not_hidden(view: SceneView, camera: Any) -> None:
    diagonal_m = view.diagonal_m
    for aspect, factor in ((1.0, 1.0), (3.0, 1.0), (0.5, 2.0), (0.01, 10.0)):
        view.look(camera, aspect=aspect, name="left")
        away = camera.position - camera.look_at
        np.testing.assert_allclose(away, [-factor * ROOM * SHOWN / 2 / np.tan(np.radians(25.0)), 0.0, 0.0], atol=1e-9)
        np.testing.assert_allclose(camera.look_at, 0.0, atol=1e-9)
    view._painting.hidden.add("plate")
    view.look(camera, name="no such view")  # from where it looks
    ball_m = view._painting.scene.body("ball").X_WB[:3, 3]
    np.testing.assert_allclose(camera.look_at, view.to_view(ball_m), atol=0.02 * SHOWN)
    nearer = camera.position - camera.look_at
    assert nearer[0] < 0.0 and -nearer[0] < 0.1 * np.linalg.norm(away) and diagonal_m == view.diagonal_m


def test_marks_of_a_touch(view: SceneView) -> None:
    state: Any = SimpleNamespace(p_WT_m=(0.01, 0.0, 0.0), p_WP_m=(0.0, 0.02, 0.0), f_W_N=np.array([0.0, 0.0, -1.0]))
    view.show_touch(state)
    np.testing.assert_allclose(view._tool.position, view.to_view(state.p_WT_m))
    np.testing.assert_allclose([view._proxy.position, view._arrow.position], [view.to_view(state.p_WP_m)] * 2)
    assert view._arrow.scale == pytest.approx((1.0, 1.0, SHOWN / 8 / ARROW_N)) and view._arrow.visible
    state.f_W_N = np.array([0.0, 0.005, 0.0])
    view.show_touch(state)
    assert view._tool.visible and view._proxy.visible and not view._arrow.visible
    view.show_touch(None)
    assert not (view._tool.visible or view._proxy.visible or view._arrow.visible)


def test_marks_of_the_tools(view: SceneView) -> None:
    nodes: Any = Nodes()
    marks, painting = ToolMarks(nodes, view, view._painting), view._painting
    plate = painting.scene.body("plate")
    normal = plate.X_WB[:3, 2]
    hit = painting.pick(plate.X_WB[:3, 3] + 0.1 * normal, -normal, visible_only=True)
    assert hit is not None
    marks.show_ring(hit, 0.005)
    ring = marks._ring.points
    apart = np.linalg.norm(ring[:, 0] - view.to_view(hit.p_W_m), axis=1)
    np.testing.assert_allclose(apart, np.hypot(0.005 * view.scale, 0.004), rtol=1e-3)
    np.testing.assert_array_equal(ring[:, 1], np.roll(ring[:, 0], -1, axis=0))
    marks.show_sphere(np.array([0.0, 0.1, 0.0]), 0.03)
    assert marks._sphere.scale == pytest.approx(0.03 * view.scale)
    np.testing.assert_allclose(marks._sphere.position, view.to_view((0.0, 0.1, 0.0)))
    assert marks._ring.visible and marks._sphere.visible
    marks.show_ring(None, 0.005), marks.show_sphere(None)
    assert not (marks._ring.visible or marks._sphere.visible)


def test_rotations() -> None:
    np.testing.assert_allclose(rotation(np.array([90.0, 0.0, 90.0])) @ (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), atol=1e-12)
    np.testing.assert_allclose(quaternion(rotation(np.array([0.0, 0.0, 90.0]))), np.array([1, 0, 0, 1]) / 2**0.5)


def test_a_look_is_offered_if_any_body_has_colours(view: SceneView) -> None:
    assert not view.has_look
    view.display.bodies[1] = SimpleNamespace(file_colours=view.colours)  # type: ignore[call-overload]
    assert view.has_look


def test_a_scene_that_grows_is_scaled_and_hidden_bodies_are_not_shown(view: SceneView) -> None:
    painting, nodes = view._painting, view._server.scene.made  # type: ignore[attr-defined]
    before = view.scale
    painting.scene.body("ball").X_WB[:3, 3] = (0.0, 0.0, 1.0)
    painting.hidden.add("plate")
    view._compose()
    view._place_bodies()
    assert view.scale == pytest.approx(SHOWN / view.diagonal_m) and view.scale < 0.5 * before
    assert nodes["/body/0"].visible and not nodes["/body/1"].visible
    np.testing.assert_allclose(nodes["/body/0"].position, view.to_view((0.0, 0.0, 1.0)))
    assert {node.scale for name, node in nodes.items() if str(name).count("/") == 4} == {view.scale}
