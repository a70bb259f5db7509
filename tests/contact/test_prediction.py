"""Prediction of moving bodies: agrees with closed forms, without jumps."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import hapscene
from hapscene.clock import new_clock
from hapscene.contact.prediction import FRAME, HORIZON_S, LAG_FRAMES, PREDICTED, predict_bodies
from hapscene.records import records
from hapscene.surface.swatch import Swatch

TICK_S, FRAME_S = 1e-3, 1.0 / 60.0
START_NS = 10**12


class Line:
    """Frames of one body and their prediction in each tick."""

    def __init__(self, mass_kg: float = np.inf, inertia: float = 1e-4, com_B_m=(0.0, 0.0, 0.0)) -> None:
        self.frames, self.predicted = records(1, FRAME), records(1, PREDICTED)
        frame = self.frames[0]
        frame.inverse_mass, frame.com_B_m = 1.0 / mass_kg, com_B_m
        frame.inverse_inertia_B = np.eye(3) / inertia if np.isfinite(mass_kg) else 0.0
        self.impulse, self.clock = np.zeros((1, 6)), new_clock()
        self.X, self.teleported = np.eye(4)[None, None].copy(), np.zeros(1, np.int64)

    def send(self, tick: int, p=(0, 0, 0), R=None, v=(0, 0, 0), w=(0, 0, 0), applied=None) -> None:
        frame = self.frames[0]
        frame.count += 1
        frame.X_WB = np.eye(4)
        frame.X_WB[:3, 3] = p
        if R is not None:
            frame.X_WB[:3, :3] = R
        frame.v, frame.applied = np.r_[v, w], self.impulse[0] if applied is None else applied
        frame.time_ns, frame.lifetime_s = START_NS + round(tick * 1e6), HORIZON_S
        frame.count += 1

    def tick(self, tick: int) -> np.ndarray:
        now = START_NS + round(tick * 1e6)
        moving = np.zeros(1, np.int64)
        predict_bodies(
            self.frames, self.predicted, moving, self.impulse, self.X, self.teleported, now, self.clock, TICK_S
        )
        return self.X[0, 0].copy()


def frames_at(ticks: int) -> set[int]:
    return set(np.ceil(np.arange(0.0, ticks * TICK_S, FRAME_S) / TICK_S).astype(int).tolist())


def test_without_velocities_poses_are_interpolated() -> None:
    line = Line()
    line.send(0, (0, 0, 0))
    line.tick(0)
    line.send(20, (0.02, 0, 0), Rotation.from_rotvec([0, 0, 0.4]).as_matrix())
    seen = np.array([line.tick(20 + k) for k in range(30)])
    np.testing.assert_allclose(seen[:, 0, 3], np.minimum(np.arange(1, 31), 20) * 1e-3, atol=1e-12)
    turned = Rotation.from_matrix(seen[:, :3, :3]).as_rotvec()[:, 2]
    np.testing.assert_allclose(turned, np.minimum(np.arange(1, 31), 20) * 0.02, atol=1e-12)


TURNED, COM_B_M = Rotation.from_rotvec((0.3, -0.7, 1.1)), np.array((0.02, -0.05, 0.1))


def test_with_velocities_motion_continues_for_the_horizon() -> None:
    line, v, w = Line(com_B_m=COM_B_M), np.array((0.3, -0.1, 0.2)), np.array((0.5, -1.0, 2.0))
    line.send(0, (0.1, 0.2, 0.3), TURNED.as_matrix(), v, w)
    seen = np.array([line.tick(k) for k in range(200)])
    t = np.minimum(np.arange(200), HORIZON_S / TICK_S - 1)[:, None] * TICK_S
    com = seen[:, :3, :3] @ COM_B_M + seen[:, :3, 3]
    np.testing.assert_allclose(com, (0.1, 0.2, 0.3) + TURNED.apply(COM_B_M) + v * t, atol=1e-12)
    np.testing.assert_allclose(seen[:, :3, :3], (Rotation.from_rotvec(w * t) * TURNED).as_matrix(), atol=1e-12)


def test_impulse_turns_a_body_by_its_inertia() -> None:
    """v = J/m and ω = R Y Rᵀ (L − c × J), with the impulses J and L about the origin of the body."""
    rng, line, R = np.random.default_rng(4), Line(0.2, com_B_m=COM_B_M), TURNED.as_matrix()
    Y = np.cov(rng.normal(size=(3, 9))) * 1e3
    line.frames[0].inverse_inertia_B = Y
    line.send(0, (0.1, 0.2, 0.3), R)
    line.tick(0)
    J, L = 1e-3 * rng.normal(size=(2, 3))
    line.impulse[0] += np.r_[J, L]
    X, c = line.tick(1), R @ COM_B_M
    w = R @ Y @ R.T @ (L - np.cross(c, J))
    np.testing.assert_allclose(Rotation.from_matrix(X[:3, :3] @ R.T).as_rotvec(), w * TICK_S, rtol=1e-9)
    np.testing.assert_allclose(X[:3, :3] @ COM_B_M + X[:3, 3] - c - (0.1, 0.2, 0.3), J / 0.2 * TICK_S, rtol=1e-9)


def test_a_late_frame_is_extrapolated_with_the_acceleration_between_frames_for_the_horizon() -> None:
    """Steady accelerations: x = x₀ + v t + a t²/2, the rotation likewise about a fixed axis."""
    start, v, a = np.array((0.1, 0.2, 0.3)), np.array((0.3, -0.1, 0.2)), np.array((1.0, 2.0, -3.0))
    for age_s in (0.0, 0.004, 0.03, 0.15):
        line, seen = Line(0.2), np.eye(4)
        for tick in (0, 20, 40):
            t = tick * TICK_S
            turn = Rotation.from_rotvec((0.0, 0.0, 0.5 * t + 2.0 * t * t)).as_matrix()
            line.send(tick, start + v * t + a * t * t / 2, turn, v + a * t, (0.0, 0.0, 0.5 + 4.0 * t))
            seen = line.tick(tick + (round(age_s / TICK_S) if tick == 40 else 0))
        body, t = line.predicted[0], 0.04 + min(age_s, HORIZON_S)
        np.testing.assert_allclose(body.other, (*a, 0.0, 0.0, 4.0), atol=1e-9)
        np.testing.assert_allclose(body.v, (*(v + a * t), 0.0, 0.0, 0.5 + 4.0 * t), atol=1e-9)
        np.testing.assert_allclose(body.com_W_m, start + v * t + a * t * t / 2, atol=1e-12)
        turned = Rotation.from_matrix(body.R_WB).as_rotvec()
        np.testing.assert_allclose(turned, (0.0, 0.0, 0.5 * t + 2.0 * t * t), atol=1e-12)
        assert np.isfinite(seen).all()
    line = Line()
    line.send(5, start, v=v)
    np.testing.assert_array_equal(line.tick(3)[:3, 3], start)  # a frame of the future is taken as it is


def test_of_two_accelerations_with_the_same_sign_the_smaller_is_used() -> None:
    line = Line(0.2)
    v, w = np.array([[0, 0, 0], [1, 3, 1], [3, 5, 0]]), np.array([[0, 0, 0], [-1, 0, -2], [-3, 1, -3]])
    for k in range(3):
        line.send(20 * k, v=0.02 * v[k], w=0.02 * w[k])
        line.tick(20 * k)
    np.testing.assert_allclose(line.predicted[0].other, (1, 2, 0, -1, 0, -1), atol=1e-9)


def test_difference_to_a_frame_that_lacks_half_of_the_impulse_is_removed_slowly() -> None:
    line, J = Line(0.2), 0.03 * np.array((2, -1, 2, 0, 0, 0)) / 3
    for tick, given, contained, frames in ((0, 0, 0, 1), (20, 1, 0, 1), (40, 2, 1, LAG_FRAMES), (60, 2.4, 2, 1)):
        line.impulse[0] = given * J
        line.send(tick, applied=contained * J)
        line.tick(tick)
        period_s = 0.02 if tick > 0 else FRAME_S
        assert line.predicted[0].left_s == pytest.approx(frames * period_s - TICK_S)


@pytest.mark.parametrize("lags", [False, True])
def test_support_force_is_estimated_from_frames(lags: bool) -> None:
    """A body in contact with a wall is pushed with 1 N; its frames state that it is at rest, also one frame later."""
    line, away, frames, contained = Line(0.2), [], frames_at(1000), np.zeros(6)
    for k in range(1000):
        if k in frames:
            line.send(k, applied=contained if lags else None)
            contained = line.impulse[0].copy()
        line.impulse[0, 0] += TICK_S * 1.0
        away.append(line.tick(k)[0, 3])
    assert max(np.abs(away[:50])) > 5e-4  # moves before the estimate converges
    assert max(np.abs(away[200:])) < (1.2e-3 if lags else 1e-4)  # the force over 16 or 17 ms differs


def test_delayed_frames_cause_no_jump() -> None:
    """Steady motion at 60 Hz, where some frames are delayed and arrive with the next one."""
    line, way = Line(), []
    due = {round(k * 1000 / 60): k for k in range(60)}
    for k in list(due)[10:50:7]:
        due[k + 15] = due.pop(k)
    for k in range(1000):
        if k in due:
            line.send(k, (0.1 * due[k] / 60, 0, 0))
        way.append(line.tick(k)[0, 3])
    steps = np.abs(np.diff(way))[50:]
    assert steps.max() < 3 * 0.1 * TICK_S


def test_new_pose_is_smoothed_and_teleport_jumps() -> None:
    line = Line(0.2)
    line.send(0)
    line.tick(0)
    line.send(17, (0.01, 0, 0))
    way = [line.tick(17 + k)[0, 3] for k in range(40)]
    assert max(np.diff([0.0, *way])) < 0.01 / 16 and way[-1] == pytest.approx(0.01, abs=1e-15)
    line.frames[0].teleport_count += 1
    line.send(70, (0.5, 0, 0))
    assert line.tick(70)[0, 3] == 0.5 and line.teleported[0] == 1


def test_invalid_frame_is_reported_and_prediction_continues() -> None:
    line = Line()
    line.send(0, v=(0.1, 0, 0))
    assert line.tick(0)[0, 3] == 0.0
    line.send(1, (np.nan, 0, 0))
    assert np.isnan(line.tick(1)[0, 3])  # the tick rejects and flags it
    line.send(2, (0.0002, 0, 0), R=2.0 * np.eye(3))
    assert np.isnan(line.tick(2)[0, 3])
    line.send(3, (0.0003, 0, 0), v=(0.1, 0, 0))
    assert [line.tick(k)[0, 3] for k in range(3, 40)] == pytest.approx([1e-4 * k for k in range(3, 40)], abs=3e-4)


def test_overflow_is_recovered_by_the_next_frame() -> None:
    line = Line()
    line.send(0, w=(1e300, 0, 0))
    assert not np.isfinite([line.tick(0), line.tick(1)]).all()
    for k in (17, 34):
        line.send(k, (0.1, 0, 0))
        np.testing.assert_array_equal(line.tick(k)[:3, 3], (0.1, 0, 0))


def test_incomplete_frame_is_ignored() -> None:
    line = Line()
    line.send(0, (0.1, 0, 0))
    line.tick(0)
    line.frames[0].X_WB[0, 3] = 9.0
    line.frames[0].count += 1
    assert line.tick(1)[0, 3] == 0.1


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_prediction_keeps_contact_with_a_pushed_box(friction: float) -> None:
    """0.2 kg at 650 N/m: without prediction, contact is lost and made again with force steps of up to 1 N."""
    scene, mass_kg = hapscene.Scene(), 0.2
    scene.add(trimesh.creation.box((0.05,) * 3), name="crate", unit="m", swatch=Swatch("s", stiffness_N_m=650.0))
    changes, steps = {}, {}
    for held in (True, False):
        renderer, line = hapscene.Renderer(scene, ["wall"]), Line(mass_kg)
        slots, frames = renderer.moving_bodies(["crate"]), frames_at(3000)
        line.impulse = renderer.world.impulse
        x = v = last = 0.0
        forces, touching = [], []
        for k in range(3000):
            if k in frames:
                given, last = renderer.world.impulse[0, 0] - last, renderer.world.impulse[0, 0]
                v += given / mass_kg
                v -= np.sign(v) * min(friction * 9.81 * FRAME_S, abs(v))
                x += v * FRAME_S
                line.send(k, (x, 0, 0), v=(v, 0, 0))
            slots.X_WB[0] = line.tick(k)
            if held:
                slots.X_WB[0, 0, 3] = x
            command = renderer.step((-0.026 + 0.05 * max(0.0, (k - 50) * TICK_S), 0, 0), slots)
            forces.append(command.f_W_N)
            touching.append(command.contact is not None)
        changes[held] = int(np.abs(np.diff(touching, axis=0)).sum())
        steps[held] = np.abs(np.diff(forces, axis=0)).max()
    assert steps[False] < 0.1 < steps[True] and changes[False] <= 2 < changes[True]


def test_new_centre_of_mass_does_not_move_the_body() -> None:
    line = Line(0.2)
    line.send(0, (0.3, 0, 0))
    line.tick(0)
    line.frames[0].com_B_m = (0.1, 0.2, 0.0)
    for tick in range(1, 40):
        if tick == 17:
            line.send(tick, (0.3, 0, 0))
        np.testing.assert_allclose(line.tick(tick)[:3, 3], (0.3, 0, 0), atol=1e-12)


def test_teleport_waits_for_a_complete_valid_frame() -> None:
    line = Line()
    line.send(0)
    line.tick(0)
    frame = line.frames[0]
    frame.count += 1  # incomplete
    frame.teleport_count += 1
    frame.X_WB[0, 3] = np.nan
    assert line.tick(1)[0, 3] == 0.0 and not line.teleported[0]
    frame.count += 1
    line.tick(2)
    assert not line.teleported[0]  # invalid pose: the teleport is still pending
    line.send(3, (0.5, 0, 0))
    assert line.tick(3)[0, 3] == 0.5 and line.teleported[0] == 1
