"""Where the simulated Phantom Omni stands."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.device.omni_kinematics import NOMINAL_RAD, forward
from hapscene.errors import HapsceneError


def stand(p_WT_m: Sequence[float]) -> NDArray[np.float64]:
    """X_WD (4, 4) of a device whose tip is at `p_WT_m` (3,) in the nominal posture; z of W is up, its user at −y."""
    X = np.eye(4)
    X[:3, :3] = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]
    X[:3, 3] = np.asarray(p_WT_m, float) - X[:3, :3] @ forward(NOMINAL_RAD)
    return X


def checked_pose(X_WD: ArrayLike) -> NDArray[np.float64]:
    """X_WD (4, 4) as an array.

    Raises:
        HapsceneError: it is no pose.
    """
    X = np.asarray(X_WD, float)
    if X.shape != (4, 4) or not np.all(np.isfinite(X)):
        raise HapsceneError(f"omni: X_WD must be a finite (4, 4) pose, has shape {X.shape}")
    R = X[:3, :3]
    if not np.allclose(R.T @ R, np.eye(3), atol=1e-9) or np.linalg.det(R) < 0.0:
        raise HapsceneError("omni: X_WD must be a pose: its upper left (3, 3) is no rotation")
    return X


def out_of_reach(p_WT_m: Sequence[float], p_DT_m: NDArray[np.float64]) -> str:
    """The one sentence for a start that the arm cannot reach."""
    middle = ", ".join(f"{v:.3f}" for v in forward(NOMINAL_RAD))
    there = ", ".join(f"{v:.3f}" for v in p_DT_m)
    return (
        f"omni: p_WT_m {tuple(float(v) for v in p_WT_m)} is ({there}) m in the device's frame, out of its reach; "
        f"the middle of its workspace is ({middle}) m, about which it reaches 80, 60, 35 mm along x, y, z"
    )
