"""Questions of the chart: errors against closed forms and SciPy; recommendations are computed from the points."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from hapscene.perception import band_edges_Hz
from hapscene.render.renderer import Renderer
from hapscene.scene.mesh import Mesh
from hapscene.stability.rig import sheet
from hapscene.surface.effect import load_effect
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import Texture
from hapscene_evidence.chart import (
    acceleration_rate,
    force_rate,
    mesh,
    proxy,
    run,
    stabiliser,
    texture,
)
from hapscene_evidence.chart.measuring import stroke_path, texture_bands
from hapscene_evidence.chart.texture_update import followed
from hapscene_evidence.chart.touched_surface import closest_points

EDGES_HZ = band_edges_Hz()


def test_closest_points_equal_exhaustive_search() -> None:
    from trimesh.triangles import closest_point

    rng = np.random.default_rng(3)
    small = rng.uniform(-1.0, 1.0, (300, 1, 3)) + 0.05 * rng.standard_normal((300, 3, 3))
    large = rng.uniform(-1.0, 1.0, (6, 3, 3))
    corners = np.concatenate((small, large))
    made = Mesh(vertices_m=corners.reshape(-1, 3), faces=np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3))
    points = rng.uniform(-1.2, 1.2, (60, 3))
    at, face = closest_points(made, points)
    every = np.array([closest_point(corners, np.tile(p, (len(corners), 1))) for p in points])
    away = np.linalg.norm(every - points[:, None], axis=2)
    assert np.linalg.norm(at - points, axis=1) == pytest.approx(away.min(axis=1), abs=1e-12)
    assert (face == away.argmin(axis=1)).mean() > 0.95  # two triangles may be equally close
    among = np.arange(100)
    assert np.linalg.norm(closest_points(made, points, among)[0] - points, axis=1) == pytest.approx(
        away[:, :100].min(axis=1), abs=1e-12
    )


def recording(force_N: Any, touching: Any, depth_m: Any, **more: Any) -> Any:
    return SimpleNamespace(
        f_W_N=np.asarray(force_N), touching=np.asarray(touching), depth_m=np.asarray(depth_m), **more
    )


def test_errors_of_a_rotated_scaled_and_stepping_force() -> None:
    turn = math.radians(10.0)
    into = np.tile([0.0, 0.0, 2e-3], (200, 1))
    force = 500.0 * 2e-3 * 1.14 * np.tile([math.sin(turn), 0.0, math.cos(turn)], (200, 1))
    found = mesh.force_errors(recording(force, [True] * 200, np.full(200, 2.3e-3)), into, 500.0)
    assert found["direction"] == pytest.approx(10.0)
    assert found["force"] == pytest.approx(2.0)
    assert found["edge"] == pytest.approx(0.0, abs=1e-6)
    force[100:] = 500.0 * 2e-3 * np.array([0.0, 0.0, 1.0])
    assert mesh.force_errors(recording(force, [True] * 200, np.full(200, 2e-3)), into, 500.0)["edge"] == (
        pytest.approx(10.0)
    )


def test_projection_converges_by_the_cosine_and_active_set_is_exact() -> None:
    one, next_ = (proxy.error(20.0, steps)["off"] for steps in (10, 11))
    assert next_ / one == pytest.approx(math.cos(math.radians(20.0)), rel=1e-6)
    assert proxy.error(20.0, 0)["off"] == proxy.ROUNDING_M * 1e3


def test_point_sinks_deeper_into_a_groove_than_a_ball() -> None:
    assert proxy.error(ball=False)["off"] == pytest.approx(2.0 * (math.sqrt(2.0) - 1.0), rel=1e-6)
    assert proxy.error(ball=True)["off"] < 1e-3


@pytest.mark.parametrize("name", run.QUESTIONS)
def test_settings_have_one_default_for_each_lever(name: str) -> None:
    settings = run.question(name).settings(None)
    assert len({(*s[:3], s.case) for s in settings}) == len(settings)
    defaults = [lever for lever, *_ in {(s.lever, s.method, s.label) for s in settings if s.default}]
    assert sorted(defaults) == sorted({s.lever for s in settings})


def test_rising_force_lags_by_its_rise_in_a_tick() -> None:
    """Each force is held for 20 fast ticks; the largest 5 % of the errors are excluded."""
    fast = np.zeros((20_000, 3))
    fast[:, 2] = 10.0 + 1e-4 * np.arange(20_000)
    expected = 0.95 * 19 * 1e-4 / (0.07 * 11.0)
    assert force_rate.off_jnd(fast[::20], fast) == pytest.approx(expected, rel=0.15)
    assert force_rate.off_jnd(fast, fast) == 0.0


def test_virtual_coupling_acts_as_a_spring_in_series() -> None:
    error = stabiliser.error("coupling", "as stated", 2000.0, ["press"])["compliance"]
    felt = 1.0 / 2000.0 + 1.0 / 1020.0  # the wall and the data sheet's structure of an Omni
    assert error == pytest.approx(100.0 * (1.0 / 200.0) / felt, rel=0.02)


def test_simulated_surface_has_the_stated_power() -> None:
    for force, speed in ((0.3, 0.04), (2.0, 0.25)):
        power = np.trapezoid(texture.surface_density(force, speed), texture.FREQUENCY_HZ)
        assert power == pytest.approx(25.0 * force * speed / 0.1, rel=1e-3)
        made = texture.known_texture("lsf", 2).power([force], [speed])
        assert made[0] == pytest.approx(power, rel=1e-3)


@pytest.mark.parametrize("held", [False, True])
def test_bands_of_white_noise_with_and_without_zero_order_hold(held: bool) -> None:
    white = Texture.from_models(2000.0, [1.0], [0.1], a=[[1.0, 0.0]], variance_m2_s4=[3.0])
    found = texture_bands(white, [1.0], [0.1], held=held)[0]
    for low, high, rms in zip(EDGES_HZ[:-1], EDGES_HZ[1:], found, strict=True):
        power = quad(lambda f: 2.0 * 3.0 / 2000.0 * (np.sinc(f / 2000.0) ** 2 if held else 1.0), low, high)[0]
        assert rms == pytest.approx(np.sqrt(power), rel=1e-4)


def test_followed_level_equals_that_of_the_tick() -> None:
    texture = Texture.from_models(10_000.0, [2.0], [0.2], a=[[1.0, -0.5]], variance_m2_s4=[1e2])
    effects = {"lpc_texture": {"update_ticks": 4.0}}
    renderer = Renderer(sheet(Swatch("rough", texture=texture, effects=effects)), ("wall", "lpc_texture"))
    effect, start = load_effect("lpc_texture"), renderer.surface.state_start[1]
    state = renderer.surface.states[start : start + effect.state_dtype.itemsize].view(effect.state_dtype)
    seen, touch = [], renderer.surface.touch
    for place in stroke_path(120):
        renderer.step(place)
        seen.append((touch["force_N"][0], touch["slip_m_s"][0], state["level_m_s2"][0]))
    force, slip, level = np.array(seen[1:]).T  # from the first tick in contact on
    expected = followed(np.sqrt(texture.power(force, slip)), 4)
    np.testing.assert_allclose(level[8:], expected[8:], rtol=0.01)


def test_bands_of_a_tap_hold_its_energy() -> None:
    """A decaying sine has ∫a² = A² ω²/(4β(β² + ω²))."""
    a, beta, omega, rate = 20.0, 60.0, 2.0 * np.pi * 250.0, 10_000.0
    time_s = np.arange(2000) / rate
    tap = a * np.exp(-beta * time_s) * np.sin(omega * time_s)
    energy = a**2 * omega**2 / (4.0 * beta * (beta**2 + omega**2))
    assert np.sum(acceleration_rate.tap_bands(tap, rate) ** 2) * 0.1 == pytest.approx(energy, rel=0.01)
