"""Meshes of MuJoCo geoms. Round geoms are approximated by flat faces that lie inside by at most `SAG` of the
radius.
"""

from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray
from trimesh.creation import box, capsule, cylinder, icosphere

from hapscene.errors import SceneError

if TYPE_CHECKING:
    import mujoco

__all__ = ["SAG", "geom_mesh"]

Array = NDArray[np.float64]

AROUND: Final = 64
"""Number of faces around a cylinder or capsule [count]."""

SUBDIVISIONS: Final = 4
"""Number of subdivisions of a sphere [count]: 5,120 faces."""

SAG: Final = 1.3e-3
"""Largest distance of the faces from a round geom, relative to its radius [1]: 1 − cos(π/64), also for a sphere."""

FIELD_MAX: Final = 4_000_000
"""Most points of a height field [count]; each has four faces of 0.2 kB."""

PLANE_RATIO: Final = 5.0
"""Half the width of an infinite plane, relative to the extent of the model [1]."""


def geom_mesh(model: "mujoco.MjModel", geom: int) -> tuple[Array, NDArray[np.int64]] | None:
    """Vertices (n, 3) [m] in the frame of the geom, and outward faces (m, 3); None for a type without a mesh."""
    import mujoco

    kinds = mujoco.mjtGeom
    kind, size = model.geom_type[geom], model.geom_size[geom]
    if kind == kinds.mjGEOM_MESH:
        return _asset(model, model.geom_dataid[geom])
    if kind == kinds.mjGEOM_PLANE:
        x, y = np.where(size[:2] > 0.0, size[:2], PLANE_RATIO * model.stat.extent)
        return np.array([[-x, -y, 0.0], [x, -y, 0.0], [x, y, 0.0], [-x, y, 0.0]]), np.array([[0, 1, 2], [0, 2, 3]])
    if kind == kinds.mjGEOM_HFIELD:
        return _field(model, model.geom_dataid[geom])
    if kind == kinds.mjGEOM_BOX:
        made = box(2.0 * size)
    elif kind == kinds.mjGEOM_SPHERE:
        made = icosphere(SUBDIVISIONS, size[0])
    elif kind == kinds.mjGEOM_ELLIPSOID:
        made = icosphere(SUBDIVISIONS, 1.0)
        made.apply_scale(size)
    elif kind == kinds.mjGEOM_CYLINDER:
        made = cylinder(size[0], 2.0 * size[1], AROUND)
    elif kind == kinds.mjGEOM_CAPSULE:
        made = capsule(2.0 * size[1], size[0], [AROUND, AROUND])
    else:
        return None
    return np.asarray(made.vertices), np.asarray(made.faces)


def _asset(model: "mujoco.MjModel", mesh: int) -> tuple[Array, NDArray[np.int64]]:
    """A mesh asset, in the principal axes to which MuJoCo has transformed it."""
    vertex, face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
    return (
        model.mesh_vert[vertex : vertex + model.mesh_vertnum[mesh]].astype(np.float64),
        model.mesh_face[face : face + model.mesh_facenum[mesh]].astype(np.int64),
    )


def _field(model: "mujoco.MjModel", field: int) -> tuple[Array, NDArray[np.int64]]:
    """A height field, closed by sides and a base."""
    rows, columns, first = (int(a[field]) for a in (model.hfield_nrow, model.hfield_ncol, model.hfield_adr))
    if rows * columns > FIELD_MAX:
        raise SceneError(f"a height field has {rows:,} × {columns:,} points; expected at most {FIELD_MAX:,}")
    x, y, high, low = model.hfield_size[field]
    z = high * model.hfield_data[first : first + rows * columns].astype(np.float64)
    across, along = np.meshgrid(np.linspace(-x, x, columns), np.linspace(-y, y, rows))
    top = np.column_stack((across.ravel(), along.ravel(), z))
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    b, c, d = a + 1, a + columns, a + columns + 1
    faces = np.vstack((np.column_stack((a, b, d)), np.column_stack((a, d, c))))
    below = top * (1.0, 1.0, 0.0) - (0.0, 0.0, low)
    count = len(top)
    grid = np.arange(count).reshape(rows, columns)
    i = np.concatenate((grid[0, :-1], grid[:-1, -1], grid[-1, :0:-1], grid[:0:-1, 0]))  # border vertices in order
    j = np.roll(i, -1)
    sides = np.vstack((np.column_stack((j, i, i + count)), np.column_stack((j, i + count, j + count))))
    return np.vstack((top, below)), np.vstack((faces, faces[:, ::-1] + count, sides))
