"""MuJoCo models: a scene of their geoms, and the contact forces of the tool on their bodies."""

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray
from trimesh.creation import box, capsule, cylinder, icosphere

from hapscene.bridge.mujoco_file import check_installed, load_model
from hapscene.bridge.simulation import Bridge, crosses
from hapscene.errors import SceneError, no_such, warn
from hapscene.io.files import refusing
from hapscene.scene.mesh import Mesh, MeshWarning
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import SwatchLike

if TYPE_CHECKING:
    import mujoco

__all__ = ["MuJoCo", "load_mujoco"]

Array = NDArray[np.float64]

STEP_MIN_S: Final = 1e-5
STEP_MAX_S: Final = 1.0
"""Range of the timestep [s]. Shorter steps would take too long; with longer ones nothing moves."""

AROUND: Final = 64
"""Number of faces around a cylinder or capsule [count]. They lie inside it by at most 1 − cos(π/64) = 0.13 % of the
radius, as those of a sphere."""

SUBDIVISIONS: Final = 4
"""Number of subdivisions of a sphere [count]: 5,120 faces."""

FIELD_MAX: Final = 4_000_000
"""Most points of a height field [count]; each has four faces of 0.2 kB."""

PLANE_RATIO: Final = 5.0
"""Half the width of an infinite plane, relative to the extent of the model [1]."""


def load_mujoco(
    path: str | os.PathLike[str], swatches: Mapping[str, SwatchLike] | SwatchLike | None = None
) -> "MuJoCo":
    """Load a model from an MJCF or URDF file, in its initial state.

    Args:
        path: the file.
        swatches: as in `MuJoCo`.

    Raises:
        SceneError: MuJoCo is not installed, or refuses the file; or as for `MuJoCo`.
    """
    model = load_model(path)
    import mujoco

    with refusing(SceneError, path):
        return MuJoCo(model, mujoco.MjData(model), swatches)


class MuJoCo(Bridge):
    """A MuJoCo model that a tool can touch: the scene has a body for each of its bodies with geoms.

    `step`, `run`, `run_twin` and `teleport` are inherited from `Bridge`. The wrench of the tool is added to
    `data.xfrc_applied` for one step, and removed afterwards. `mj_resetData` is detected: bodies reappear at their start
    without contact on the way.

    Contact is rendered with the exact surface of each geom, and with the faces of a mesh, while MuJoCo collides bodies
    by their convex hulls. Static geoms, such as those of the body "world", are rendered as well. The name of a geom, or
    of its material, is the name of its face group (`scene.paint("table", "oak", "top")`). Flexes, skins and signed
    distance fields are not rendered, nor are geoms without collisions (contype and conaffinity 0).

    Args:
        model, data: `mujoco.MjModel` and its `MjData`; the caller keeps them.
        swatches: swatches by name of geom, material or body, in this order of precedence, and "default" for the others;
            or one swatch for all.

    Attributes:
        model, data: as given.
        scene: the bodies at their present poses.
        names: names of the bodies that can move.
        step_s: timestep of the model [s].

    Raises:
        SceneError: MuJoCo is not installed, the data belongs to another model, a swatch is given for an unknown name
            or for geoms that are not rendered, or no geom can be touched.
        SwatchError: an unknown or invalid swatch.

    Warns:
        MeshWarning: a geom of a type that has no mesh.
    """

    def __init__(
        self,
        model: "mujoco.MjModel",
        data: "mujoco.MjData",
        swatches: Mapping[str, SwatchLike] | SwatchLike | None = None,
    ) -> None:
        check_installed("")
        import mujoco

        self.model, self.data = model, data
        if not (isinstance(model, mujoco.MjModel) and isinstance(data, mujoco.MjData)):
            given = f"{type(model).__name__} and {type(data).__name__}"
            raise SceneError(f"got {given}; expected mujoco.MjModel and mujoco.MjData")
        if (len(data.qpos), len(data.xpos), len(data.geom_xpos)) != (model.nq, model.nbody, model.ngeom):
            raise SceneError("the data belongs to another model; create it by mujoco.MjData(model)")
        self.step_s = float(model.opt.timestep)
        if not STEP_MIN_S <= self.step_s <= STEP_MAX_S:  # also true for NaN
            raise SceneError(
                f"the timestep of the model is {self.step_s:g} s; expected {STEP_MIN_S:g} to {STEP_MAX_S:g} s"
            )
        mujoco.mj_forward(model, data)
        worn = swatches if isinstance(swatches, Mapping) else {"default": swatches} if swatches else {}
        self.scene, moving = _scene(model, data, worn)
        self.names, self._ids = tuple(moving), np.array(list(moving.values()), np.intp)
        super().__init__(self)
        self._time_s = float(data.time)

    def __repr__(self) -> str:
        count = len(self.names)
        return f"<MuJoCo: {count} moving {'body' if count == 1 else 'bodies'}; {self.scene!r}>"

    def read(self, X_WB: Array) -> None:
        """Write the present poses of the moving bodies to X_WB (n, 4, 4)."""
        import mujoco

        model, data = self.model, self.data
        if data.time < self._time_s:
            self._jumps.update(self.names)
        self._time_s = float(data.time)
        mujoco.mj_kinematics(model, data)
        X_WB[:, :3, :3] = data.xmat[self._ids].reshape(-1, 3, 3)
        X_WB[:, :3, 3] = data.xpos[self._ids]

    def mobility(self, body: int) -> Array:
        """The mobility (6, 6) of a body, including its joints and constraints but not its contacts."""
        import mujoco

        model, data = self.model, self.data
        if model.nv == 0:
            return np.zeros((6, 6))
        jacobian, response = np.zeros((6, model.nv)), np.zeros((6, model.nv))
        mujoco.mj_comPos(model, data)
        mujoco.mj_jacBody(model, data, jacobian[:3], jacobian[3:], self._ids[body])
        mujoco.mj_solveM(model, data, response, jacobian)
        return np.asarray(jacobian @ response.T)

    def advance(self, wrench_W: Array) -> None:
        """Run one `mj_step` with wrenches (n, 6) on the moving bodies: forces, and torques about their origins."""
        import mujoco

        data, bodies, theirs = self.data, self._ids, self.data.xfrc_applied.copy()
        force, torque = wrench_W[:, :3], wrench_W[:, 3:]
        data.xfrc_applied[bodies, :3] += force  # MuJoCo applies it at the centre of mass
        data.xfrc_applied[bodies, 3:] += torque
        data.xfrc_applied[bodies, 3:] -= (crosses(data.xipos[bodies] - data.xpos[bodies]) @ force[:, :, None])[:, :, 0]
        ours = data.xfrc_applied.copy()
        mujoco.mj_step(self.model, data)
        untouched = data.xfrc_applied == ours  # if the model diverges, MuJoCo resets it together with the forces
        data.xfrc_applied[untouched] = theirs[untouched]

    def contact(self, body: int) -> Array:
        """Force (3,) of other bodies of the model on a body in the last step, in W [N]."""
        import mujoco

        force_N, total_N = np.zeros(6), np.zeros(3)
        for i in range(self.data.ncon):
            contact = self.data.contact[i]
            sides = self.model.geom_bodyid[[contact.geom1, contact.geom2]] == self._ids[body]
            if sides.any():
                mujoco.mj_contactForce(self.model, self.data, i, force_N)  # force of geom1 on geom2
                total_N += (int(sides[1]) - int(sides[0])) * (force_N[:3] @ contact.frame.reshape(3, 3))
        return total_N


def _scene(
    model: "mujoco.MjModel", data: "mujoco.MjData", swatches: Mapping[str, SwatchLike]
) -> tuple[Scene, dict[str, int]]:
    """The scene of a model's geoms, and the indices of the bodies that can move."""
    import mujoco

    kinds = mujoco.mjtObj

    def name_of(kind: "mujoco.mjtObj", index: int, otherwise: str) -> str:
        return mujoco.mj_id2name(model, kind, index) or otherwise

    known, hidden = {"default"}, set[str]()
    scene, moving, taken = Scene(), {}, set[str]()
    for body in range(model.nbody):
        body_name = name_of(kinds.mjOBJ_BODY, body, f"body_{body}")
        while body_name in taken:  # a named body may have the default name of this one
            body_name += "_"
        taken.add(body_name)
        parts, chosen = [], []
        for geom in range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body]):
            material = model.geom_matid[geom]
            names = [
                name_of(kinds.mjOBJ_GEOM, geom, f"geom_{geom}"),
                *([name_of(kinds.mjOBJ_MATERIAL, material, f"material_{material}")] if material >= 0 else []),
            ]
            if not (model.geom_contype[geom] or model.geom_conaffinity[geom]):
                hidden |= {body_name, *names}
                continue
            known |= {body_name, *names}
            made = geom_mesh(model, geom)
            if made is None:
                warn(f"geom {names[0]!r} of body {body_name!r} is not rendered: its type has no mesh", MeshWarning)
                continue
            R = np.zeros(9)
            mujoco.mju_quat2Mat(R, model.geom_quat[geom])
            parts.append((made[0] @ R.reshape(3, 3).T + model.geom_pos[geom], made[1], "/".join(names)))
            chosen.append(next((swatches[n] for n in (*names, body_name, "default") if n in swatches), None))
        if not parts:
            continue
        X_WB = np.eye(4)
        X_WB[:3, :3], X_WB[:3, 3] = data.xmat[body].reshape(3, 3), data.xpos[body]
        mesh = _merged(parts)
        scene.add(mesh, name=body_name, pose=X_WB)
        for index, swatch in enumerate(chosen):
            if swatch is not None:
                scene.paint(body_name, swatch, mesh.group == index)
        if model.body_weldid[body] != 0 or model.body_mocapid[model.body_rootid[body]] >= 0:
            moving[body_name] = body
    for name in swatches.keys() - known:
        if name in hidden:
            raise SceneError(
                f"the swatch of {name!r} is not used: its geoms do not collide (contype and conaffinity 0) and are not "
                "rendered; remove this swatch"
            )
        raise SceneError(no_such("geom, material or body", name, known))
    if not scene.bodies:
        raise SceneError("the model has no geom that collides, and only these are rendered")
    return scene, moving


def _merged(parts: list[tuple[Array, NDArray[np.int64], str]]) -> Mesh:
    """Merge parts, each with vertices, faces and a name, to one mesh with a group per part."""
    first = np.cumsum([0, *(len(vertices) for vertices, _, _ in parts[:-1])])
    return Mesh(
        np.vstack([vertices for vertices, _, _ in parts]),
        np.vstack([faces + offset for (_, faces, _), offset in zip(parts, first, strict=True)]).astype(np.int32),
        np.repeat(np.arange(len(parts)), [len(faces) for _, faces, _ in parts]).astype(np.int16),
        tuple(name for _, _, name in parts),
    )


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
