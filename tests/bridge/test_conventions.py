"""Coordinate conventions of four programs, against rotations of SciPy."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hapscene.bridge.conventions import Convention
from hapscene.bridge.packets import PacketError

FRAMES = [("z", "right", 1.0), ("y", "right", 1.0), ("y", "left", 1.0), ("z", "left", 0.01)]


@pytest.mark.parametrize(("up", "handed", "metres"), FRAMES)
def test_vectors_and_angular_quantities(up: str, handed: str, metres: float) -> None:
    frame = Convention.of({"up": up, "handed": handed, "metres": metres})
    axis = np.array([0.0, 0.0, 1.0] if up == "z" else [0.0, 1.0, 0.0])
    np.testing.assert_allclose(frame.position(axis), [0, 0, metres])
    assert np.linalg.det(frame.C) == pytest.approx(1.0 if handed == "right" else -1.0)
    rng = np.random.default_rng(4)
    p, f, L, v = rng.normal(size=(4, 3))
    for there, back in ((frame.position, frame.client_position), (frame.vector, frame.client_vector)):
        np.testing.assert_allclose(back(there(v)), v)
    np.testing.assert_allclose(frame.client_angular(frame.angular(L)), L)
    # a moment is the product of arm and force, whatever the hand
    np.testing.assert_allclose(frame.angular(np.cross(p, f)) * metres, np.cross(frame.position(p), frame.vector(f)))


@pytest.mark.parametrize(("up", "handed", "metres"), FRAMES)
def test_pose(up: str, handed: str, metres: float) -> None:
    """The rotation matrix of a quaternion maps the points of the client to its points."""
    frame = Convention.of({"up": up, "handed": handed, "metres": metres})
    R, p, x = Rotation.from_rotvec([0.3, -0.7, 1.1]), np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.2, -0.4])
    X_WB = frame.pose(p, 3.0 * R.as_quat())  # of any length
    np.testing.assert_allclose((X_WB @ [*frame.position(x), 1.0])[:3], frame.position(R.apply(x) + p), atol=1e-12)
    inertia = np.diag([1.0, 2.0, 3.0])
    np.testing.assert_allclose(frame.inertia([1.0, 2.0, 3.0]), frame.C @ inertia @ frame.C.T)


def test_an_invalid_quaternion_gives_nan() -> None:
    frame = Convention.of({})
    assert np.isnan(frame.pose((0, 0, 0), (0, 0, 0, 0))).any()
    assert np.isnan(frame.pose((0, 0, 0), (np.nan, 0, 0, 1))).any()


@pytest.mark.parametrize("hello", [{"up": "x"}, *({"metres": bad} for bad in (True, "1", 9e-7, 1.1e6))])
def test_invalid_conventions(hello: dict) -> None:
    with pytest.raises(PacketError):
        Convention.of(hello)
    assert [Convention.of({"metres": ends}).metre for ends in (1e-6, 1e6)] == [1e-6, 1e6]
