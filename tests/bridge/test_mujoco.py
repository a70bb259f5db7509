"""MuJoCo models: geoms against MuJoCo's own rays, pushed bodies, errors."""

import io
import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

import hapscene
from hapscene.bridge.mujoco_file import compile_model
from hapscene.cli import main
from hapscene.errors import FormatError
from hapscene.scene.mesh import MeshWarning

mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed: pip install 'hapscene[mujoco]'")

KINDS = {
    "box": 'type="box" size=".03 .02 .01"',
    "sphere": 'type="sphere" size=".03"',
    "capsule": 'type="capsule" size=".01 .03"',
    "cylinder": 'type="cylinder" size=".02 .03"',
    "ellipsoid": 'type="ellipsoid" size=".01 .03 .02"',
    "mesh": 'type="mesh" mesh="wedge"',
    "plane": 'type="plane" size=".05 .04 .1"',
    "hfield": 'type="hfield" hfield="hills"',
}

GEOM = """<mujoco>
  <option gravity="0 0 0"/>
  <asset>
    <mesh name="wedge" scale=".03 .02 .01" vertex="1 1 1  3 1 1  1 4 1  1 1 6  2 2 -3"/>
    <hfield name="hills" nrow="4" ncol="3" size=".04 .03 .02 .01" elevation="0 1 0  2 0 1  0 3 1  1 0 0"/>
  </asset>
  <worldbody>
    <body name="part" pos=".1 -.2 .3" euler="20 40 60">%s
      <geom name="part" pos=".02 .01 -.03" euler="50 10 -30" %s/>
    </body>
  </worldbody>
</mujoco>"""

CRATE = """<mujoco>
  <option timestep="{step_s}" gravity="0 0 {gravity}"/>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 .1"/>
    <body name="crate" pos="0 0 {height}"><freejoint/>
      <geom type="box" size=".05 .05 .05" mass=".2"/>
    </body>
    <body name="second" pos=".3 0 {height}"><freejoint/>
      <geom type="box" size=".05 .05 .05" mass=".3"/>
    </body>
  </worldbody>
</mujoco>"""


def compiled(text: str) -> tuple[Any, Any]:
    model = mujoco.MjModel.from_xml_string(text)
    return model, mujoco.MjData(model)


def crates(step_s: float, gravity: float = 0.0, height: float = 0.05) -> tuple[Any, Any]:
    return compiled(CRATE.format(step_s=step_s, gravity=gravity, height=height))


def soft() -> hapscene.Swatch:
    return hapscene.Swatch("soft", stiffness_N_m=650.0)


def solid(body: hapscene.Body) -> trimesh.Trimesh:
    mesh = trimesh.Trimesh(body.mesh.vertices_m, body.mesh.faces, process=False)
    return mesh.apply_transform(body.X_WB)


def met_at(mesh: trimesh.Trimesh, start: NDArray[np.float64], to: NDArray[np.float64]) -> tuple[float, float]:
    """Where a ray first meets a mesh (Möller & Trumbore 1997), in its lengths, and the cosine to the face's normal."""
    a, b, c = mesh.triangles.transpose(1, 0, 2)
    across = np.cross(to, c - a)
    scale = (across * (b - a)).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (across * (start - a)).sum(axis=1) / scale
        turned = np.cross(start - a, b - a)
        v = turned @ to / scale
        along = (turned * (c - a)).sum(axis=1) / scale
    along[~((u >= -1e-9) & (v >= -1e-9) & (u + v <= 1.0 + 1e-9) & (along >= 0.0))] = np.inf
    face = int(along.argmin())
    return float(along[face]), float(-mesh.face_normals[face] @ to / np.linalg.norm(to))


@pytest.mark.parametrize("kind", KINDS)
def test_geoms_agree_with_rays_of_mujoco(kind: str) -> None:
    free = kind not in ("plane", "hfield")  # which MuJoCo has in static bodies alone
    model, data = compiled(GEOM % ("<freejoint/>" if free else "", KINDS[kind]))
    if free:
        data.qpos[:] += np.random.default_rng(1).normal(0.0, 0.3, 7)
    body = hapscene.bridge.MuJoCo(model, data).scene.body("part")
    mesh, rng, hit = solid(body), np.random.default_rng(2), np.zeros(1, np.int32)
    assert mesh.is_volume == (kind != "plane")  # closed, and its faces are outward
    middle, reach = mesh.bounds.mean(axis=0), float(np.linalg.norm(mesh.extents))
    sag_m = 1.3e-3 * 0.03 if kind in ("sphere", "capsule", "cylinder", "ellipsoid") else 1e-8

    off_m = []
    for _ in range(200):
        start = middle + reach * (out := rng.normal(size=3)) / np.linalg.norm(out)
        to = middle + 0.2 * reach * rng.normal(size=3) - start
        along, (ours, cosine) = mujoco.mj_ray(model, data, start, to, None, 1, -1, hit), met_at(mesh, start, to)
        if np.isfinite(ours) and cosine > 0.2:
            off_m.append((ours - along) * np.linalg.norm(to) * cosine)
    wrong = [off for off in off_m if not -1e-8 <= off <= sag_m + 1e-8]
    assert len(off_m) > 20 and len(wrong) <= (kind == "hfield")  # of which MuJoCo 3.2 misses the side once

    for i in rng.choice(len(mesh.faces), 200):
        p, n = mesh.triangles_center[i], mesh.face_normals[i]
        if kind == "hfield" and mujoco.mj_ray(model, data, p + 0.3 * n, -n, None, 1, -1, hit) < 0.3 - 1e-4:
            continue  # another hill in front
        along = mujoco.mj_ray(model, data, p + 1e-3 * n, -n, None, 1, -1, hit)
        assert 1e-3 - sag_m <= along <= 1e-3 + 1e-8, i


def test_geoms_of_a_body_and_swatches_by_name() -> None:
    model, data = compiled("""<mujoco>
      <asset><material name="steel"/></asset>
      <worldbody>
        <geom name="floor" type="plane" size="0 0 .1"/>
        <body name="cart" pos="0 0 1"><joint type="slide" axis="1 0 0"/>
          <geom name="bed" type="box" size=".1 .1 .1" contype="0"/>
          <geom type="sphere" size=".1" material="steel" conaffinity="0"/>
          <geom name="handle" type="sphere" size=".1" material="steel"/>
          <geom name="paint" type="box" size=".2 .2 .2" contype="0" conaffinity="0"/>
          <body pos="0 0 1"><geom type="sphere" size=".1"/></body>
        </body>
        <body name="post" pos="0 2 0"><geom type="sphere" size=".1"/></body>
        <body name="hand" mocap="true" pos="0 3 0"><geom type="sphere" size=".1"/></body>
      </worldbody>
    </mujoco>""")
    named = {"steel": "wood", "handle": "cork", "cart": "felt", "default": "paper"}
    swatches = {name: hapscene.Swatch(swatch) for name, swatch in named.items()}
    bridge = hapscene.bridge.MuJoCo(model, data, swatches)
    assert [body.name for body in bridge.scene.bodies] == ["world", "cart", "body_2", "post", "hand"]
    assert bridge.names == ("cart", "body_2", "hand")
    assert not bridge.mobility(2).any()
    scene, cart = bridge.scene, bridge.scene.body("cart")
    worn = [scene.swatches[i].name for i in cart.face_swatch[np.unique(cart.mesh.group, return_index=True)[1]]]
    assert worn == ["felt", "wood", "cork"]
    assert {scene.swatches[i].name for b in ("world", "post") for i in scene.body(b).face_swatch} == {"paper"}
    assert scene.paint("cart", swatches["default"], "bed") == 12
    with pytest.raises(hapscene.HapsceneError, match=r"'paint' is not used: .*contype"):
        hapscene.bridge.MuJoCo(model, data, {"paint": "wood"})
    for one, name in (("wood", "wood"), (swatches["handle"], "cork")):
        same = hapscene.bridge.MuJoCo(model, data, one).scene
        assert {same.swatches[i].name for body in same.bodies for i in body.face_swatch} == {name}
    with pytest.raises(hapscene.HapsceneError, match=r"no geom, material or body 'craet'; there are: .*cart"):
        hapscene.bridge.MuJoCo(model, data, {"craet": "wood"})
    model.geom_type[1] = mujoco.mjtGeom.mjGEOM_SDF
    with pytest.warns(MeshWarning, match="'bed' of body 'cart'"):
        assert hapscene.bridge.MuJoCo(model, data).scene.body("cart").mesh.group_names == (
            "geom_2/steel",
            "handle/steel",
        )


@pytest.mark.parametrize("step_s", [1e-3, 1 / 60])
def test_momentum_of_a_free_body(step_s: float) -> None:
    model, data = crates(step_s, height=1.0)
    bridge = hapscene.bridge.MuJoCo(model, data, {"default": soft()})
    renderer = hapscene.Renderer(bridge.scene)
    for k in range(round(0.8 / step_s)):
        t_s = k * step_s  # the one is pushed to the left, then the other to the right
        bridge.step(renderer, (0.051 - 0.05 * t_s if t_s < 0.4 else 0.249 + 0.05 * (t_s - 0.4), 0.02, 1.0))
    for name, about in (("crate", 1), ("second", 2)):
        impulse = renderer.impulse(name)
        mujoco.mj_subtreeVel(model, data)
        own = model.body_mass[about] * data.qvel[6 * about - 6 : 6 * about - 3]
        assert abs(impulse.linear_N_s[0]) > 1e-3 and abs(impulse.angular_N_m_s[2]) > 1e-5
        assert own == pytest.approx(impulse.linear_N_s, rel=1e-12, abs=1e-17)
        spin = model.body_inertia[about] * data.qvel[6 * about - 3 : 6 * about]  # about z alone: in W as in B
        assert spin[2] == pytest.approx(impulse.angular_N_m_s[2], rel=1e-12)


def test_other_applied_forces_are_kept() -> None:
    model, data = crates(1e-3, height=1.0)
    bridge = hapscene.bridge.MuJoCo(model, data, {"default": soft()})
    renderer = hapscene.Renderer(bridge.scene)
    data.xfrc_applied[1] = theirs = np.array([0.1, 0.2, 0.3, 1e-3, 2e-3, 3e-3])
    for k in range(50):
        bridge.step(renderer, (-0.0505 + 1e-4 * k, 0.0, 1.0))
        assert (data.xfrc_applied[1] == theirs).all()
    given = renderer.impulse("crate").linear_N_s
    assert given[0] > 0.01
    assert 0.2 * data.qvel[:3] == pytest.approx(given + 50 * 1e-3 * theirs[:3], rel=1e-12)


@pytest.mark.parametrize(("step_s", "most_N"), [(1e-3, 0.01), (2e-3, 0.01), (1 / 60, 0.1)])
def test_a_box_on_the_floor_is_pushed_smoothly(step_s: float, most_N: float) -> None:
    """0.2 kg at 650 N/m for 3 s; at 60 Hz, constant poses would cause force steps of 0.2 N."""
    model, data = crates(step_s, -9.81)
    bridge = hapscene.bridge.MuJoCo(model, data, {"default": soft()})
    renderer, felt, tick = hapscene.Renderer(bridge.scene), list[hapscene.Command](), itertools.count()
    while len(felt) < 3000:
        bridge.step(renderer, lambda: (-0.0505 + 1e-5 * next(tick), 0.0, 0.05), felt.append)
    f_N = np.array([command.f_W_N for command in felt])
    assert np.linalg.norm(np.diff(f_N, axis=0), axis=1).max() <= most_N
    assert np.count_nonzero(np.diff([command.contact is not None for command in felt])) <= 2
    assert 0.02 < data.qpos[0] < 0.03
    assert -f_N[-500:, 0].mean() == pytest.approx(0.2 * 9.81, rel=0.5)  # what MuJoCo's friction has at most


def test_reset() -> None:
    model, data = crates(1 / 60, -9.81)
    bridge = hapscene.bridge.MuJoCo(model, data, {"default": soft()})
    renderer = hapscene.Renderer(bridge.scene)
    data.qpos[0] = -0.3
    for _ in range(5):
        bridge.step(renderer, (-0.15, 0.0, 0.05))
    mujoco.mj_resetData(model, data)  # the crate passes the tool
    assert bridge.step(renderer, (-0.15, 0.0, 0.05)).contact is None
    assert abs(data.qpos[0]) < 1e-9


def test_a_diverged_and_reset_simulation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes a log of it
    model, data = crates(0.002)
    bridge = hapscene.bridge.MuJoCo(model, data)
    renderer = hapscene.Renderer(bridge.scene)
    for k in range(8):
        if k == 3:
            data.qpos[:] = np.nan  # which MuJoCo resets in its next step
        command = bridge.step(renderer, (0.0, 0.0, 0.2))
    assert command.flags == 0


def test_invalid_models_and_data(monkeypatch: pytest.MonkeyPatch) -> None:
    model, data = crates(0.002)
    with pytest.raises(hapscene.HapsceneError, match="another model"):
        hapscene.bridge.MuJoCo(model, compiled("<mujoco/>")[1])
    with pytest.raises(hapscene.HapsceneError, match="NoneType"):
        hapscene.bridge.MuJoCo(model, None)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    for load, given in ((hapscene.bridge.MuJoCo, (model, data)), (hapscene.bridge.load_mujoco, ("a.xml",))):
        with pytest.raises(hapscene.HapsceneError, match="MuJoCo is not installed"):
            load(*given)


def test_pose_and_mobility_of_a_free_body_at_present() -> None:
    model, data = compiled("""<mujoco><worldbody>
      <body><freejoint/><geom type="box" size=".05 .03 .02" mass=".2"/></body>
    </worldbody></mujoco>""")
    bridge, X_WB = hapscene.bridge.MuJoCo(model, data), np.eye(4)[None]
    data.qpos[:] = 0.1, 0.2, 0.3, 0.8, 0.0, 0.6, 0.0  # a turn about y
    bridge.read(X_WB)
    turned = np.array([[0.28, 0.0, 0.96], [0.0, 1.0, 0.0], [-0.96, 0.0, 0.28]])
    np.testing.assert_allclose(X_WB[0, :3], np.c_[turned, [0.1, 0.2, 0.3]], atol=1e-12)
    inertia = 0.2 / 3.0 * np.array([0.03**2 + 0.02**2, 0.05**2 + 0.02**2, 0.05**2 + 0.03**2])
    np.testing.assert_allclose(bridge.mobility(0), hapscene.bridge.free_mobility(0.2, inertia, turned), atol=1e-6)


def test_mobility_of_a_hinged_body() -> None:
    model, data = compiled("""<mujoco><option gravity="0 0 0"/><worldbody>
      <body name="door"><joint name="hinge" axis="0 0 1"/>
        <geom type="box" pos=".4 0 0" size=".4 .01 .5" mass="5"/></body>
    </worldbody></mujoco>""")
    bridge = hapscene.bridge.MuJoCo(model, data, {"default": soft()})
    renderer = hapscene.Renderer(bridge.scene)
    inertia = 1.0 / bridge.mobility(0)[5, 5]
    assert inertia == pytest.approx(5.0 * (0.8**2 + 0.02**2) / 12.0 + 5.0 * 0.4**2, rel=1e-9)
    assert np.allclose(bridge.mobility(0)[:3], 0.0)
    for k in range(200):
        bridge.step(renderer, (0.7, -0.0105 + 1e-4 * k, 0.0))
    assert inertia * data.qvel[0] == pytest.approx(renderer.impulse("door").angular_N_m_s[2], rel=1e-9)
    assert data.qvel[0] > 0.1


def test_contact_force() -> None:
    model, data = crates(1e-3, -9.81)
    data.qpos[7:10] = (0.0, 0.0, 0.15)  # the second body stands on the crate
    bridge = hapscene.bridge.MuJoCo(model, data)
    for _ in range(500):
        bridge.advance(np.zeros((2, 6)))
    for body, mass_kg in ((0, 0.2), (1, 0.3)):
        assert bridge.contact(body) == pytest.approx([0.0, 0.0, 9.81 * mass_kg], abs=1e-3)


def test_a_light_body_is_warned_of() -> None:
    model, data = compiled(CRATE.format(step_s=1 / 60, gravity=0, height=1.0).replace('mass=".2"', 'mass=".02"'))
    bridge = hapscene.bridge.MuJoCo(model, data, {"default": soft()})
    renderer = hapscene.Renderer(bridge.scene)
    with pytest.warns(hapscene.bridge.ChatterWarning, match="crate"):
        bridge.step(renderer, (-0.06, 0.0, 1.0))
        bridge.step(renderer, (-0.045, 0.0, 1.0))


FIELD = '<mujoco><asset><hfield name="a" nrow="{0}" ncol="{0}" size="1 1 1 1"/></asset></mujoco>'


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (FIELD.format(2**31 - 1), ".*MuJoCo"),  # crashes MuJoCo 4.0
        ('<mujoco><size nuser_geom="2147483647"/><worldbody><geom size="1"/></worldbody></mujoco>', ".*MuJoCo"),
        (None, "cannot be read: No such file"),
    ],
)
def test_a_model_that_crashes_mujoco_is_an_error(tmp_path: Path, text: str | None, says: str) -> None:
    path = tmp_path / "their model.xml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(hapscene.HapsceneError, match=f"their model.xml: {says}"):
        hapscene.bridge.load_mujoco(path)


def test_load_mujoco(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trimesh.creation.icosphere(1, 0.05).export(tmp_path / "ball.stl")
    (tmp_path / "inner.xml").write_text('<mujoco><asset><mesh name="m" file="ball.stl"/></asset></mujoco>')
    body = '<body name="b"><freejoint/><geom type="mesh" mesh="m"/></body>'
    (tmp_path / "outer.xml").write_text(f'<mujoco><include file="inner.xml"/><worldbody>{body}</worldbody></mujoco>')
    monkeypatch.chdir(tmp_path.parent)
    bridge = hapscene.bridge.load_mujoco(f"{tmp_path.name}/outer.xml")
    direct = mujoco.MjModel.from_xml_path(str(tmp_path / "outer.xml"))
    assert bridge.names == ("b",)
    for name in ("mesh_vert", "mesh_face", "geom_pos", "geom_quat", "body_inertia", "names"):
        assert np.array_equal(getattr(bridge.model, name), getattr(direct, name)), name


def test_touch_of_a_model_on_the_command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("table.xml").write_text(CRATE.format(step_s=2e-3, gravity=-9.81, height=0.05))
    rows = [f"{t},{-0.06 + 0.05 * t},0,0.05" for t in np.arange(0.0, 1.0, 0.01)]
    Path("push.csv").write_text("t,x,y,z\n" + "\n".join(rows))
    assert main(["touch", "table.xml", "--path", "push.csv", "--swatch", "wood", "--no-picture"]) == 0
    recording = hapscene.load_touch("out/table/touch.npz")
    assert recording.swatch_names[recording.swatch[-1]] == "wood" and recording.touching[-1]
    assert 1e-3 < recording.p_WP_m[-1, 0] - recording.p_WP_m[np.argmax(recording.touching), 0] < 0.05  # it moved
    assert main(["touch", "table.xml", "--hand", "press", "--out", "hand", "--no-picture"]) == 0
    assert hapscene.load_touch("hand/touch.npz").touching.any()
    assert main(["touch", "table.xml", "--unit", "mm"]) == 2
    Path("bad.xml").write_text("<mujoco><worldbody><geom size='-1'/></worldbody></mujoco>")
    assert main(["touch", "bad.xml"]) == 2
    Path("empty.xml").write_text("<mujoco/>")
    assert main(["touch", "empty.xml"]) == 2
    text = capsys.readouterr().err
    assert all(words in text for words in ("table.xml: --unit", "bad.xml: error of MuJoCo", "empty.xml: the model"))


@pytest.mark.parametrize(
    ("xml", "says"),
    [
        ('<option timestep="0"/><worldbody><geom size=".1"/></worldbody>', "timestep"),
        (
            '<asset><hfield name="h" nrow="2100" ncol="2000" size="1 1 1 .1"/></asset>'
            '<worldbody><geom type="hfield" hfield="h"/></worldbody>',
            "2,100 × 2,000",
        ),
    ],
)
def test_a_model_that_would_take_too_long_is_refused(xml: str, says: str) -> None:
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{xml}</mujoco>")
    with pytest.raises(hapscene.errors.SceneError, match=says):
        hapscene.bridge.MuJoCo(model, mujoco.MjData(model))


def test_unnamed_bodies_have_unique_names() -> None:
    bodies = '<body><geom size=".1"/></body><body name="body_1"><geom size=".1"/></body>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    assert len({part.name for part in hapscene.bridge.MuJoCo(model, mujoco.MjData(model)).scene.bodies}) == 2


@pytest.mark.parametrize("counts", [(10**9,), (10**30,), (1000, 1000)])
def test_replicate_with_too_many_copies_is_an_error(counts: tuple[int, ...]) -> None:
    text = '<geom type="sphere" size=".1"/>'
    for count in counts:
        text = f'<replicate count="{count}">{text}</replicate>'
    with pytest.raises(FormatError, match="replicate"):
        compile_model(io.BytesIO(f"<mujoco><worldbody>{text}</worldbody></mujoco>".encode()), "never read")
    few = 2 * '<replicate count="100000"/>'  # one beside the other
    with pytest.raises(FormatError, match="error of MuJoCo"):
        compile_model(io.BytesIO(f"<mujoco><worldbody>{few}</worldbody></mujoco>".encode()), "never read")


def test_two_hands_lift_a_box() -> None:
    """They squeeze it by 3 mm and lift it by 3 cm at 60 Hz; friction carries half of its weight at each hand."""
    model, data = crates(1 / 60, -9.81)
    grip = hapscene.Swatch("grip", stiffness_N_m=650.0, friction_static=0.9, friction_dynamic=0.9)
    bridge = hapscene.bridge.MuJoCo(model, data, grip)
    hands = [hapscene.Renderer(bridge.scene), hapscene.Renderer(bridge.scene)]
    felt, tick = list[list[hapscene.Command]](), itertools.count()

    def places() -> list[tuple[float, float, float]]:
        k = next(tick)
        x, z = 0.0505 - 7e-6 * min(k, 500), 0.05 + 2e-5 * min(max(k - 800, 0), 1500)
        return [(-x, 0.0, z), (x, 0.0, z)]

    while len(felt) < 3000:
        bridge.step(hands, places, felt.append)
    f_N = np.array([[command.f_W_N for command in made] for made in felt])
    assert np.linalg.norm(np.diff(f_N, axis=0), axis=2).max() <= 0.1
    assert f_N[-500:, :, 2].mean(axis=0) == pytest.approx(-0.5 * 0.2 * 9.81, rel=0.02) and data.qpos[2] > 0.075
