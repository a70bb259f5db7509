"""Effects of the scene: called in every tick, with settings and poses of bodies."""

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.errors import EffectError
from hapscene.surface.effect import Effect, Param, State, field_setting

BOX = trimesh.creation.box((0.1, 0.1, 0.1))


def _pull(touch, p, table, s, out):
    """Pull towards points in the frame of the first body, and count calls."""
    s.count += 1.0
    for k in range(12, len(table), 3):
        for i in range(3):
            to = table[9 + i] - touch.p_WT_m[i]
            for j in range(3):
                to += table[3 * i + j] * table[k + j]
            out.f_W_N[i] += p.stiffness_N_m * to


def _points(settings, rate_Hz):
    if settings["points_m"] is None:
        raise EffectError("pull needs points_m, (n, 3)")
    return np.asarray(settings["points_m"], float)


PULL = Effect(
    "pull",
    "Pulls to points.",
    _pull,
    params=(Param("stiffness_N_m", 10.0, "N/m", "stiffness", 0.0, 100.0),),
    state=(State("count"),),
    table=_points,
    scope="scene",
    arrays=("points_m",),
)


def scene() -> hapscene.Scene:
    built = hapscene.Scene()
    built.add(BOX, name="box", unit="m", swatch="wood")
    built.add(BOX, name="crate", unit="m", pose=[[1, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    return built


def renderer(**setting) -> hapscene.Renderer:
    return hapscene.Renderer(scene(), ["wall", PULL], settings={"pull": setting})


def test_field_acts_from_the_first_tick():
    r = renderer(points_m=[[0.0, 0.0, 0.1]])
    np.testing.assert_allclose(r.step((0.0, 0.01, 0.3)).f_W_N, [0.0, -0.1, -2.0], atol=1e-12)
    r.tune_field("pull", stiffness_N_m=20.0)
    np.testing.assert_allclose(r.step((0.0, 0.01, 0.3)).f_W_N, [0.0, -0.2, -4.0], atol=1e-12)


def test_field_adds_to_contact_but_not_to_the_reaction():
    r, bare = renderer(points_m=[[0.0, 0.0, 0.1]]), hapscene.Renderer(scene(), ["wall"])
    for p in ((0, 0, 0.06), (0, 0, 0.049)):
        a, b = r.step(p), bare.step(p)
    np.testing.assert_allclose(a.f_W_N - b.f_W_N, [0.0, 0.0, 10.0 * (0.1 - 0.049)], atol=1e-12)
    assert a.contact.f_body_W_N.tolist() == b.contact.f_body_W_N.tolist()


def test_the_poses_of_named_bodies_are_those_of_the_tick():
    r = renderer(points_m=[[0.0, 0.0, 0.1]], bodies="crate")
    np.testing.assert_allclose(r.step((0.5, 0.0, 0.3)).f_W_N, [0.0, 0.0, -2.0], atol=1e-12)
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], (0.0, 0.2, 0.0)
    np.testing.assert_allclose(r.step((0.0, 0.2, 0.3), {"crate": X}).f_W_N, [1.0, 0.0, -3.0], atol=1e-12)


def test_settings_of_a_field():
    """Defaults, checked numbers, indices of bodies, and a pose for each before its own table."""
    points = {"points_m": [[1.0, 2.0, 3.0]]}
    plain = field_setting(PULL, points, ("box", "crate"), 1e4)
    pose = [1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0]
    assert plain.numbers == {"stiffness_N_m": 10.0} and plain.bodies == ()
    assert plain.table.tolist() == [*pose, 1.0, 2.0, 3.0]
    tied = field_setting(PULL, points | {"bodies": ["crate", "box"], "stiffness_N_m": 100}, ("box", "crate"), 1e4)
    assert tied.bodies == (1, 0) and tied.table.tolist() == [*pose, *pose, 1.0, 2.0, 3.0]
    assert type(tied.numbers["stiffness_N_m"]) is float and tied.numbers["stiffness_N_m"] == 100.0


def test_fields_and_contact_effects_are_tuned_separately():
    r = renderer(points_m=[[0.0, 0.0, 0.1]])
    with pytest.raises(EffectError, match="count"):
        hapscene.Renderer(scene(), [PULL], settings={"pull": {"points_m": [[0, 0, 0]]}}).tune("wood", count=1.0)
    with pytest.raises(EffectError, match="wall"):
        r.tune_field("wall", damping_Ns_m=1.0)
    with pytest.raises(EffectError, match="mass_kg"):
        r.tune_field("pull", mass_kg=1.0)
    with pytest.raises(EffectError, match="stiffness_N_m"):
        r.tune_field("pull", stiffness_N_m=101.0)
    with pytest.raises(EffectError, match="'wall' acts at contacts"):
        hapscene.Renderer(scene(), ["wall"], settings={"wall": {}})
    with pytest.raises(EffectError, match="'weight' is in use; add it"):
        hapscene.Renderer(scene(), ["wall"], settings={"weight": {"mass_kg": 0.1}})
    with pytest.raises(EffectError, match="50 kg; expected 0 to 10 kg"):
        hapscene.Renderer(scene(), ["wall", "weight"], settings={"weight": {"mass_kg": 50}})


@pytest.mark.parametrize(
    ("setting", "field"),
    [
        ({}, "points_m"),
        ({"points_m": [[0, 0, np.nan]]}, "pull"),
        ({"points_m": [[0, 0, 0]], "stifness_N_m": 1.0}, "stifness_N_m"),
        ({"points_m": [[0, 0, 0]], "stiffness_N_m": -1.0}, "stiffness_N_m"),
        ({"points_m": [[0, 0, 0]], "stiffness_N_m": "hard"}, "stiffness_N_m"),
        ({"points_m": [[0, 0, 0]], "bodies": ["lid"]}, "lid"),
    ],
)
def test_an_invalid_setting_is_refused(setting, field):
    with pytest.raises(EffectError, match=field):
        renderer(**setting)


@pytest.mark.parametrize(("effects", "settings"), [([PULL], {"pull": 3}), ([PULL], [3]), (["weight", "weight"], None)])
def test_settings_of_another_type_are_refused(effects, settings):
    with pytest.raises(EffectError):
        hapscene.Renderer(scene(), effects, settings=settings)


def test_field_damping_is_limited_to_the_device():
    viscous = {"viscosity": {"damping_Ns_m": 90.0, "center_m": (0.0, 0.0, 0.0)}}
    with pytest.warns(hapscene.device.DeviceWarning, match="viscosity"):
        r = hapscene.Renderer(scene(), ["viscosity"], device="omni", settings=viscous)
    (clip,) = (clip for clip in r.clips if clip.whose == "effect")
    assert clip.given == r.limits.damping_Ns_m < 90.0


def test_field_stiffness_is_limited_with_a_warning():
    def on(device, **setting):
        return hapscene.Renderer(
            scene(), [PULL], device=device, settings={"pull": {"points_m": [[0, 0, 0.1]], **setting}}
        )

    soft = hapscene.device.PointMass(0.05, 0.01)  # limit 2 b/T = 20 N/m, with a margin of 2
    with pytest.warns(hapscene.device.DeviceWarning, match="swatch"):
        r = on(soft)
    assert {clip.whose for clip in r.clips} == {"swatch"}
    with pytest.warns(hapscene.device.DeviceWarning, match="pull"):
        r.tune_field("pull", stiffness_N_m=50.0)
    (clip,) = (clip for clip in r.clips if clip.whose == "effect")
    assert (clip.swatch, clip.number, clip.asked) == ("pull", "stiffness_N_m", 50.0)
    r.repaint(scene())
    np.testing.assert_allclose(r.step((0.0, 0.01, 0.3)).f_W_N, clip.given * np.array([0.0, -0.01, -0.2]), atol=1e-12)
    assert clip.given == pytest.approx(10.0, rel=0.01)
    with pytest.warns(hapscene.device.DeviceWarning, match=r"Renderer\.clips"):
        on(soft, stiffness_N_m=60.0)


def test_invalid_scope_is_rejected():
    with pytest.raises(EffectError, match="scope"):
        Effect("x", "", _pull, scope="world")  # type: ignore[arg-type]
