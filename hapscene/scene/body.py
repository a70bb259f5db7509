"""A body: a mesh at a pose, with a swatch on every face."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.constants import REACH_MAX_M
from hapscene.errors import SceneError
from hapscene.scene.mesh import Mesh

RIGID_TOLERANCE = 1e-6
"""How far a pose may be from rigid [1]: what a float32 matrix loses, and less than the hand can feel."""


@dataclass(eq=False)
class Body:
    """A mesh at its place in the scene. Several bodies may share one mesh.

    Attributes:
        name: unique in its scene.
        mesh: its shape, in the body's frame B.
        X_WB: (4, 4) float64, pose of B in W.
        two_sided: True where the inside of a face is felt as well as its outside.
        face_swatch: (M,) int16, index into the scene's `swatches`.
        made_of: the swatch that all its faces had before it was painted, which an eraser brings back; None: unknown.
    """

    name: str
    mesh: Mesh
    X_WB: NDArray[np.float64]
    two_sided: bool
    face_swatch: NDArray[np.int16]
    made_of: int | None = None

    def __repr__(self) -> str:
        x, y, z = (f"{v:g}" for v in self.X_WB[:3, 3])
        return f"<Body {self.name!r}: {len(self.mesh.faces):,} faces at ({x}, {y}, {z}) m>"


def rigid(pose: ArrayLike | None, name: str) -> NDArray[np.float64]:
    """A pose (4, 4) float64, checked; the identity for None.

    Raises:
        SceneError: the matrix is not finite, or scales, shears, mirrors, or moves by more than `REACH_MAX_M`.
    """
    if pose is None:
        return np.eye(4)
    try:
        X: NDArray[Any] = np.array(pose, np.float64)
    except (TypeError, ValueError, OverflowError):
        raise SceneError(f"body {name!r}: a pose is a matrix (4, 4) of numbers") from None
    if X.shape != (4, 4):
        raise SceneError(f"body {name!r}: a pose is a matrix (4, 4), not {X.shape}")
    if not np.isfinite(X).all():
        raise SceneError(f"body {name!r}: the pose has a number that is not finite")
    if not np.allclose(X[3], (0, 0, 0, 1), rtol=0, atol=RIGID_TOLERANCE):
        raise SceneError(f"body {name!r}: the last row of a pose is 0 0 0 1, not {X[3].tolist()}")
    R = X[:3, :3]
    if not np.allclose(R @ R.T, np.eye(3), rtol=0, atol=RIGID_TOLERANCE):
        raise SceneError(f"body {name!r}: the pose scales or shears; give a rotation, and scale the mesh by its unit")
    if np.linalg.det(R) < 0:
        raise SceneError(f"body {name!r}: the pose mirrors (determinant -1); give a rotation")
    if np.abs(X[:3, 3]).max() > REACH_MAX_M:
        place = ", ".join(f"{v:g}" for v in X[:3, 3])
        raise SceneError(
            f"body {name!r}: the pose is at ({place}) m; expected at most {REACH_MAX_M:g} m (is it in mm?)"
        )
    X[3] = (0, 0, 0, 1)
    return X
