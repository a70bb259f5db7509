"""Parts of a picture."""

import numpy as np
import pytest
import trimesh

from hapscene.render.recording import Recording
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch
from hapscene.view.figure_parts import (
    ARROW_HEAD,
    ARROW_LENGTH,
    HEAD,
    PATH_RADIUS,
    PROXY,
    SHAFT,
    TOOL,
    TOOL_LENGTH,
    arrow_ticks,
    make_figure_parts,
)
from hapscene.view.palette import AIR, LIGHT, PATH
from hapscene.view.triangles import joined, moved, tube


@pytest.fixture(scope="module")
def scene() -> Scene:
    scene = Scene()
    scene.add(Mesh.from_trimesh(trimesh.creation.icosphere(2, 0.05), "m"), name="ball")
    scene.paint("ball", Swatch("card"), np.arange(100))
    return scene


def test_path_tool_and_force(scene: Scene, recording: Recording) -> None:
    figure = make_figure_parts(scene, recording, LIGHT, np.array([500, 1000, 1999]))
    counts = [len(figure.shown(tick)) - len(figure.shown()) for tick in (100, 600, 1999)]
    assert counts == [2, 3, 5]  # tool and proxy; one segment; three segments
    poses = dict(figure.shown(900))  # within a stroke: 0.5 N along z
    assert poses[TOOL][:3, 3] == pytest.approx(recording.p_WT_m[900])
    tip = moved(figure.parts[HEAD], poses[HEAD]).corner_m
    top = tip[tip[:, 2].argmax()]
    assert top == pytest.approx(recording.p_WP_m[900] + (0, 0, ARROW_LENGTH * figure.size_m), abs=1e-9)
    foot = moved(figure.parts[SHAFT], poses[SHAFT]).corner_m
    assert foot[:, 2].max() == pytest.approx(top[2] - ARROW_HEAD * ARROW_LENGTH * figure.size_m)
    assert foot[:, 2].min() == pytest.approx(recording.p_WP_m[900, 2], abs=1e-9)


def test_path_is_thick_on_the_surface_and_thin_from_its_last_to_its_next_point(
    scene: Scene, recording: Recording
) -> None:
    figure = make_figure_parts(scene, recording, LIGHT, np.array([230, 520]))
    radius_m = PATH_RADIUS * figure.size_m
    line_m = figure.p_SP_m + recording.touching[:, None] * recording.nhat_W * radius_m / 2
    pieces = (((0, 201, AIR), (200, 231, PATH)), ((230, 250, PATH), (249, 501, AIR), (500, 521, PATH)))
    for part, runs in zip(figure.parts[-2:], pieces, strict=True):
        solid = joined([tube(line_m[a:b], radius_m * (1.0 if of == PATH else 0.4), of) for a, b, of in runs])
        np.testing.assert_array_equal(part.corner_m, solid.corner_m)
        np.testing.assert_array_equal(part.colour, solid.colour)


def test_tool_proxy_and_arrow_grow_with_the_scene(scene: Scene, recording: Recording) -> None:
    figure = make_figure_parts(scene, recording, LIGHT, np.array([1999]))
    tall = {TOOL: TOOL_LENGTH * figure.size_m, PROXY: 6 * PATH_RADIUS * figure.size_m, SHAFT: 1.0, HEAD: 1.0}
    wide = {PROXY: tall[PROXY], SHAFT: 0.032 * ARROW_LENGTH * figure.size_m, HEAD: 0.1 * ARROW_LENGTH * figure.size_m}
    for part in (TOOL, PROXY, SHAFT, HEAD):
        x_m, _, z_m = np.ptp(figure.parts[part].corner_m, axis=0)
        assert z_m == pytest.approx(tall[part], rel=0.02) and x_m == pytest.approx(wide.get(part, x_m), rel=0.02)


def test_arrow_spacing(recording: Recording) -> None:
    ticks = arrow_ticks(recording, 0.005)
    assert all(recording.touching[ticks])
    held = [np.count_nonzero((ticks >= a * 1e3) & (ticks < b * 1e3)) for a, b in ((0.2, 0.25), (0.8, 1.4))]
    assert held[0] == 1 and held[1] >= 5
    within = ticks[(ticks >= 800) & (ticks < 1400)]
    assert np.linalg.norm(np.diff(recording.p_WP_m[within], axis=0), axis=1).max() < 0.0055
