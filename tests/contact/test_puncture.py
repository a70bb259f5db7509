"""Bodies that let the tool in: what is within is felt, the way out is free, and from outside they hold again."""

from itertools import groupby, pairwise

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.constants import PASSED_MAX
from hapscene.records import TOUCH
from hapscene.surface.effect import Effect, State
from hapscene.surface.swatch import Swatch


def _break(touch, p, table, s, out):
    """Let it in where the wall pushes with more than 1 N."""
    s.inside = touch.inside
    if touch.touching:
        for i in range(3):
            out.f_W_N[i] += touch.normal_force_N * touch.nhat_W[i]
        if touch.normal_force_N > 1.0 and touch.stiffness_N_m < 300.0:
            out.release = 1


BREAK = Effect("break", "Breaks at 1 N.", _break, state=(State("inside"),))
SKIN, BONE = Swatch("skin", stiffness_N_m=200.0), Swatch("bone", stiffness_N_m=1000.0)


def ball(radius_m: float) -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=4, radius=radius_m)


def arm(two_sided: bool = False) -> hapscene.Renderer:
    """A bone of 20 mm within skin of 50 mm."""
    scene = hapscene.Scene()
    scene.add(ball(0.05), name="skin", unit="m", swatch=SKIN, two_sided=two_sided)
    scene.add(ball(0.02), name="bone", unit="m", swatch=BONE)
    return hapscene.Renderer(scene, [BREAK])


def feel(renderer: hapscene.Renderer, *heights_m: float) -> list[tuple[str, float]]:
    """What is touched on a way along z in steps of 1 mm: body and height of the proxy, "" in the air."""
    found = []
    for start, end in pairwise(heights_m):
        for z in np.linspace(start, end, round(abs(end - start) / 1e-3) + 1):
            contact = renderer.step((0.001, 0.002, z)).contact
            found.append((contact.body, float(contact.p_W_m[2])) if contact else ("", z))
    return found


@pytest.mark.parametrize("two_sided", [False, True])
def test_punctured_skin_over_bone(two_sided):
    renderer = arm(two_sided)
    way_in = feel(renderer, 0.06, 0.01)
    assert [body for body, _ in groupby(way_in, key=lambda found: found[0])] == ["", "skin", "", "bone"]
    assert max(0.0499 - z for body, z in way_in if body == "skin") < 0.001
    assert all(z == pytest.approx(0.0197, abs=3e-4) for body, z in way_in if body == "bone")
    assert renderer.surface.touch[0].inside == 1
    way_out = feel(renderer, 0.01, 0.06)
    assert {body for body, z in way_out if z > 0.021} == {""}
    assert renderer.surface.touch[0].inside == 0 and not renderer.world.bodies["punctured"].any()
    assert [body for body, _ in feel(renderer, 0.06, 0.048)][-1] == "skin"  # it holds again


def test_punctured_body_moves():
    renderer = arm()
    feel(renderer, 0.06, 0.035)
    slots = renderer.moving_bodies(["skin"])
    for k in range(12):
        slots.X_WB[0, 2, 3] = 1e-3 * k
        renderer.step((0.001, 0.002, 0.035), slots)
        assert renderer.surface.touch[0].inside == 1
    for k in range(12, -40, -1):  # it is drawn off over the tool, which is out in the end
        slots.X_WB[0, 2, 3] = 1e-3 * k
        renderer.step((0.001, 0.002, 0.035), slots)
    assert renderer.surface.touch[0].inside == 0


def test_teleport_closes_a_puncture():
    renderer = arm()
    feel(renderer, 0.06, 0.035)
    slots = renderer.moving_bodies(["skin"])
    slots.X_WB[0, 2, 3] = -0.01  # still about the tool, which never went in there
    slots.teleport("skin")
    assert renderer.step((0.001, 0.002, 0.035), slots).contact is None
    assert renderer.surface.touch[0].inside == 0 and not renderer.world.bodies["punctured"].any()


def test_shaft_force_acts_on_the_punctured_body():
    def grip(touch, p, table, s, out):
        if touch.inside and not touch.touching:
            out.f_W_N[0] += 0.5

    scene = hapscene.Scene()
    scene.add(ball(0.05), name="skin", unit="m", swatch=SKIN)
    renderer = hapscene.Renderer(scene, [BREAK, Effect("hold", "Holds.", grip)])
    feel(renderer, 0.06, 0.035)
    before = renderer.impulse("skin").linear_N_s
    assert renderer.step((0.001, 0.002, 0.035)).contact is None
    np.testing.assert_allclose(renderer.impulse("skin").linear_N_s - before, [-0.5e-3, 0, 0], atol=1e-12)


def test_reset_closes_punctures():
    renderer = arm()
    feel(renderer, 0.06, 0.035)
    renderer.reset((0.0, 0.0, 0.06))
    assert renderer.world.proxy[0].puncture_count == 0
    assert [body for body, _ in feel(renderer, 0.06, 0.049)][-1] == "skin"


def test_limit_of_punctured_bodies():
    scene = hapscene.Scene()
    for k in range(PASSED_MAX + 1):
        scene.add(ball(0.05 - 0.004 * k), unit="m", swatch=SKIN)
    renderer = hapscene.Renderer(scene, [BREAK])
    for z in np.linspace(0.06, 0.001, 2000):
        contact = renderer.step((0.0, 0.0, z)).contact
    assert contact.p_W_m[2] == pytest.approx(0.05 - 0.004 * PASSED_MAX, abs=2e-4)
    assert renderer.surface.touch[0].inside == PASSED_MAX and "inside" in TOUCH.names


SQUARE = [[0, 1, 2], [0, 2, 3]]
EXACT_M = [0.0, 1e-12, -1e-12, 1e-9, -1e-9, 1e-7, -1e-7, 1e-6, -1e-6]


@pytest.mark.parametrize("two_sided", [False, True])
@pytest.mark.parametrize("shape", ["box", "ball", "sheet"])
def test_withdrawal_over_exact_positions(shape, two_sided):
    """A tick on the face, an edge or a vertex of the skin leaves no trace: free above it, and contact when pressed."""
    mesh = {
        "box": trimesh.creation.box((0.1, 0.1, 0.1)),
        "ball": ball(0.05),
        "sheet": trimesh.Trimesh([[-0.05, -0.05, 0], [0.05, -0.05, 0], [0.05, 0.05, 0], [-0.05, 0.05, 0]], SQUARE),
    }[shape]
    scene = hapscene.Scene()
    scene.add(mesh, name="skin", unit="m", swatch=SKIN, two_sided=two_sided)
    renderer, random = hapscene.Renderer(scene, [BREAK]), np.random.default_rng(7)
    for weights in ([0.2, 0.3, 0.5], [0.4, 0.6, 0.0], [1.0, 0.0, 0.0] if shape == "ball" else [0.5, 0.0, 0.5]):
        for above_m in EXACT_M:
            face = random.integers(len(mesh.faces))
            up = mesh.face_normals[face]
            at = np.array(weights) @ mesh.triangles[face]
            step_m = random.uniform(1e-4, 2e-3)
            way = up + 0.5 * np.cross(up, random.normal(size=3))
            renderer.reset(at + 0.004 * up)
            for height_m in np.linspace(0.004, -0.012, 17):
                renderer.step(at + height_m * up)
            assert renderer.surface.touch[0].inside == 1
            for height_m in (-2, -1, above_m / step_m, 1, 2):
                renderer.step(at + step_m * height_m * (way if abs(height_m) >= 1 else up))
            assert renderer.surface.touch[0].inside == 0
            for height_m in np.linspace(0.004, -0.002, 13):
                contact = renderer.step(at + height_m * up).contact
            assert contact is not None and contact.depth_m > 0.001


def test_needle_that_stays_on_the_surface_is_still_held():
    """A reversal on the face itself is no way out: it remains punctured, and free on the way back in."""
    renderer = arm()
    feel(renderer, 0.06, 0.04)
    top_m = 0.05 * np.cos(0.02)
    for z in (0.049, top_m, top_m - 1e-9, 0.049):
        renderer.step((0.0, 0.0, z))
    assert renderer.surface.touch[0].inside == 1
    assert {body for body, _ in feel(renderer, 0.048, 0.03)} == {""}


@pytest.mark.parametrize(("at", "inside"), [((0.04, 0.09, 0.14), 1), ((0.06, 0.0, 0.0), 0), ((0.0, 0.11, 0.14), 0)])
def test_a_proxy_that_is_placed_inside_a_body_is_reported(world, at, inside):
    assert world(trimesh.creation.box((0.1, 0.2, 0.3)), at=at).proxy[0].enclosing == inside
