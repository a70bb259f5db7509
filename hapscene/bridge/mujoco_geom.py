"""Geoms of MuJoCo as meshes. Round ones are of flat faces that lie inside, by at most `SAG` of their radius."""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from trimesh.creation import box, capsule, cylinder, icosphere

from hapscene.errors import SceneError

__all__ = ["SAG", "geom_mesh"]

Array = NDArray[np.float64]

AROUND: Final = 64
"""Faces around a cylinder or capsule [count]."""

SUBDIVISIONS: Final = 4
"""Of a sphere: 5,120 faces."""

SAG: Final = 1.3e-3
"""Most by which the faces of a round geom lie inside it, of its radius [1]: 1 − cos(π/64) around, a sphere's too."""

FIELD_MAX: Final = 4_000_000
"""Most points of a height field [count]: four faces each, 0.2 kB a face."""

PLANE_RATIO: Final = 5.0
"""Half the width that an endless plane is given, of the model's extent [1]."""


def geom_mesh(model: Any, geom: int) -> tuple[Array, NDArray[np.int64]] | None:
    """Vertices (n, 3) [m], in the geom's frame, and faces (m, 3), outward; None for a kind that has no mesh."""
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


def _asset(model: Any, mesh: int) -> tuple[Array, NDArray[np.int64]]:
    """A mesh as MuJoCo keeps it: turned and moved to its own axes, which the geom's frame takes back."""
    vertex, face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
    return (
        model.mesh_vert[vertex : vertex + model.mesh_vertnum[mesh]].astype(np.float64),
        model.mesh_face[face : face + model.mesh_facenum[mesh]].astype(np.int64),
    )


def _field(model: Any, field: int) -> tuple[Array, NDArray[np.int64]]:
    """A height field, closed by its sides and base."""
    rows, columns, first = (int(a[field]) for a in (model.hfield_nrow, model.hfield_ncol, model.hfield_adr))
    if rows * columns > FIELD_MAX:
        raise SceneError(f"a height field of {rows:,} × {columns:,} points; at most {FIELD_MAX:,} are felt")
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
    i = np.concatenate((grid[0, :-1], grid[:-1, -1], grid[-1, :0:-1], grid[:0:-1, 0]))  # around, seen from above
    j = np.roll(i, -1)
    sides = np.vstack((np.column_stack((j, i, i + count)), np.column_stack((j, i + count, j + count))))
    return np.vstack((top, below)), np.vstack((faces, faces[:, ::-1] + count, sides))
