"""The scene: bodies with their poses, and the swatches that are painted on them."""

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import MeshError, SceneError, no_such, printable, warn
from hapscene.geometry import rigid
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import paint_faces, paint_region
from hapscene.scene.mesh import Mesh, MeshWarning
from hapscene.scene.mesh_file import load_mesh
from hapscene.scene.mesh_structure import FLAT_RATIO, height_of, mesh_structure
from hapscene.scene.region import Region
from hapscene.scene.topology import volume_of
from hapscene.surface.swatch import PLAIN, Swatch, SwatchLike

if TYPE_CHECKING:
    import trimesh

__all__ = ["SWATCH_MAX", "Scene", "load_scene"]

SWATCH_MAX: Final = np.iinfo(np.int16).max
"""Maximum number of swatches in a scene [count]: the range of `Body.face_swatch`."""


class Scene:
    """Bodies and the swatches that are painted on them.

    Attributes:
        bodies: in the order in which they were added; `body` in a recording is an index into this list.
        swatches: the swatches in use; index 0 is `PLAIN`, the swatch of all faces that are not painted.
        pose_count: number of calls of `pose`; renderers use it to detect that a body was moved.
    """

    def __init__(self) -> None:
        self.bodies: list[Body] = []
        self.swatches: list[Swatch] = [PLAIN]
        self.pose_count = 0
        # Source of each swatch: a library name, a file, or None for a `Swatch` object.
        self.swatch_source: list[str | Path | None] = [PLAIN.name]
        self._loaded: dict[tuple[object, ...], Mesh] = {}
        self._names: set[str] = set()

    def __repr__(self) -> str:
        faces = sum(len(body.mesh.faces) for body in self.bodies)
        names = ", ".join(swatch.name for swatch in self.swatches[:6]) + (", …" if len(self.swatches) > 6 else "")
        count = len(self.bodies)
        return f"<Scene: {count} {'body' if count == 1 else 'bodies'} of {faces:,} faces; swatches: {names}>"

    def add(
        self,
        mesh: "Mesh | str | os.PathLike[str] | trimesh.Trimesh | trimesh.Scene",
        name: str | None = None,
        *,
        unit: str | None = None,
        swatch: SwatchLike | None = None,
        pose: ArrayLike | None = None,
        two_sided: bool = False,
        up: str | None = None,
        scale: float = 1.0,
    ) -> Body:
        """Add a body.

        Args:
            mesh: a file, a `Mesh`, or a `trimesh.Trimesh`. If the same file (with the same unit) or the same `Mesh` is
                added again, the bodies share the mesh.
            name: unique in the scene. Default: a unique name made from the file name.
            unit: unit of length of the mesh coordinates, for files and trimesh objects; see `hapscene.load_mesh`.
            swatch: initial swatch of all faces: a name from the swatch library, a .swatch file, or a `Swatch`.
            pose: X_WB, the rigid pose of the body in the world frame (4, 4). Default: the identity.
            two_sided: whether faces can be touched from both sides; for open sheets and meshes with mixed winding.
            up, scale: vertical axis and scale factor for files and trimesh objects; see `hapscene.load_mesh`.

        Raises:
            MeshError: the mesh cannot be loaded.
            SceneError: the name is already used, or the pose is not rigid.
            SwatchError: the swatch is unknown or invalid.

        Warns:
            MeshWarning: all faces have zero area; or, without `two_sided`, the winding of some faces differs from that
                of their neighbours, or a closed mesh is wound inward.
        """
        shape = self.mesh_of(mesh, unit, up=up, scale=scale)
        name = self._name(name, shape)
        X_WB = np.eye(4) if pose is None else rigid(pose, f"body {name!r}")
        body = Body(name, shape, X_WB, bool(two_sided), np.zeros(len(shape.faces), np.int16))
        if swatch is not None:
            body.made_of = self.swatch_index(swatch)
            body.face_swatch[:] = body.made_of
        if _is_flat(shape):
            warn(
                f"body {name!r}: all {len(shape.faces):,} faces have zero area, so it cannot be touched; check that "
                "the file is complete and that the mesh is not scaled to zero along an axis",
                MeshWarning,
            )
        elif not body.two_sided and not any(b.mesh is shape and not b.two_sided for b in self.bodies):
            _warn_of_winding(body)
        self.bodies.append(body)
        return body

    def body(self, name: str) -> Body:
        """Return the body with this name.

        Raises:
            SceneError: there is no such body.
        """
        found = next((body for body in self.bodies if body.name == name), None)
        if found is None:
            raise SceneError(no_such("body", name, (body.name for body in self.bodies)))
        return found

    def pose(self, body: str, X_WB: ArrayLike) -> None:
        """Set the pose X_WB (4, 4) of a body. Bodies that are attached to it move with it.

        A renderer of this scene uses the new pose from its next tick on; the body does not push the proxy on its way.
        A servo renders a copy of the scene and does not see the change: pass poses to `Renderer.step` for bodies that
        move during rendering.

        Raises:
            SceneError: there is no such body, or the pose is not rigid.
        """
        moved = self.body(body)
        X_WB = rigid(X_WB, f"body {body!r}")
        step = X_WB @ np.linalg.inv(moved.X_WB)
        for child in self.descendants(body):
            child.X_WB = rigid(step @ child.X_WB, f"body {child.name!r}")
        moved.X_WB = X_WB
        self.pose_count += 1

    def attach(self, body: str, parent: str | None) -> None:
        """Attach a body to a parent body, so that `pose` moves them together; `parent` None detaches it.

        The pose of the body does not change.

        Raises:
            SceneError: there is no such body; or `parent` is the body itself or one of its descendants.
        """
        child = self.body(body)
        above = None if parent is None else self.body(parent).name
        held = {known.name: known.parent for known in self.bodies}  # a dict, since chains in files may be long
        while above is not None:
            if above == body:
                raise SceneError(
                    f"body {body!r} cannot be attached to {parent!r}: that is the same body or attached to it"
                )
            above = held[above]
        child.parent = parent

    def descendants(self, body: str) -> list[Body]:
        """Return all bodies that are attached to a body, directly or indirectly."""
        found: list[Body] = []
        names = {body}
        while more := [b for b in self.bodies if b.parent in names and b.name not in names]:
            found += more
            names |= {b.name for b in more}
        return found

    def paint(
        self,
        body: str,
        swatch: SwatchLike,
        where: "str | Region | Sequence[int] | NDArray[np.generic] | None" = None,
        *,
        falloff_m: float = 0.0,
        resolution_m: float | None = None,
    ) -> int:
        """Paint a swatch on a body.

        `Box`, `Sphere` and `Tube` subdivide faces, so the border follows the region even on large
        triangles. All other values of `where` select whole faces.

        Args:
            body: name of the body.
            swatch: a name from the swatch library, a .swatch file, or a `Swatch`.
            where: None for all faces; the name of a group, material or object in the mesh file; face indices or a
                bool mask; or a region from `hapscene.scene.region`, in the frame of the body.
            falloff_m: width of the transition to the swatch, centred on the border of the region [m]; 0 is a sharp
                border. Only for regions that subdivide faces.
            resolution_m: maximum error of the border [m]; infinity selects whole faces by their centroids. Default:
                0.1 mm, or 1/4096 of the diagonal of the body if that is larger.

        Returns:
            Number of faces that are painted wholly or partly.

        Raises:
            SceneError: no such body, a face index out of range, an invalid width, or a falloff with whole faces.
            MeshError: no such group.
            SwatchError: the swatch is unknown or invalid.
        """
        painted = self.body(body)
        if isinstance(where, Region):
            index = self.swatch_index(swatch)
            return len(paint_region(painted, where, index, resolution_m=resolution_m, falloff_m=falloff_m))
        if falloff_m != 0:
            raise SceneError(f"falloff_m needs a region that subdivides faces (Box, Sphere, Tube), not {where!r}")
        chosen = _faces(painted, where)
        paint_faces(painted, chosen, self.swatch_index(swatch))
        return int(np.count_nonzero(chosen))

    def copy(self) -> "Scene":
        """Return a copy of the scene. Meshes and swatches are immutable and shared."""
        copy = Scene()
        copy.bodies = [replace(body, face_swatch=body.face_swatch.copy()) for body in self.bodies]
        copy.swatches[:] = self.swatches
        copy.swatch_source[:] = self.swatch_source
        return copy

    def rename(self, index: int, name: str) -> None:
        """Rename a body. The caller guarantees that the name is unused."""
        self._names.discard(self.bodies[index].name)
        self.bodies[index].name = name

    def swatch_index(self, swatch: SwatchLike) -> int:
        """Return the index of a swatch in `swatches`; append it if it is new.

        Raises:
            SwatchError: the swatch is unknown or invalid.
            SceneError: the scene has a different swatch with the same name, or too many swatches.
        """
        source = None
        if not isinstance(swatch, Swatch):
            source = _source(swatch)
            if source in self.swatch_source:
                return self.swatch_source.index(source)
            from hapscene.swatches.library import load_swatch

            swatch = load_swatch(swatch)
        for index, known in enumerate(self.swatches):
            if known is swatch or (known.name == swatch.name and _same(known, swatch)):
                return index
            if known.name == swatch.name:
                raise SceneError(
                    f"the scene has a different swatch named {swatch.name!r}; recordings refer to swatches by name: "
                    "rename one of the two"
                )
        if len(self.swatches) >= SWATCH_MAX:
            raise SceneError(f"too many swatches: a scene has at most {SWATCH_MAX:,}")
        self.swatches.append(swatch)
        self.swatch_source.append(source)
        return len(self.swatches) - 1

    def save(self, path: str | os.PathLike[str]) -> None:
        """Save the scene as NAME.scene.json beside its mesh files; `hapscene.scene.scene_file` has the format.

        Raises:
            SceneError: the suffix is not .scene.json, or the file cannot be written.
        """
        from hapscene.scene.scene_file import save_scene

        save_scene(self, Path(path))

    def mesh_of(
        self,
        mesh: "Mesh | str | os.PathLike[str] | trimesh.Trimesh | trimesh.Scene",
        unit: str | None = None,
        *,
        up: str | None = None,
        scale: float = 1.0,
    ) -> Mesh:
        """Load a mesh as `add` does, without adding a body. A file is loaded once per scene.

        Raises:
            MeshError: the mesh cannot be loaded.
        """
        if isinstance(mesh, Mesh):
            if up is not None or scale != 1.0:
                raise MeshError("a Mesh has z up and a fixed size: pass up= and scale= to load_mesh or from_trimesh")
            return mesh
        if not isinstance(mesh, str | os.PathLike):
            return Mesh.from_trimesh(mesh, unit, up=up, scale=scale)
        key = (Path(mesh).resolve(), unit, up, scale)
        if key not in self._loaded:
            self._loaded[key] = load_mesh(Path(mesh), unit, up=up, scale=scale)
        return self._loaded[key]

    def _name(self, name: str | None, mesh: Mesh) -> str:
        if len(self._names) != len(self.bodies):
            self._names = {body.name for body in self.bodies}
        taken = self._names
        if name is not None:
            if not isinstance(name, str) or not name.strip() or not name.isprintable():
                raise SceneError(f"invalid body name {name!r}: expected printable text")
            if name in taken:
                raise SceneError(f"the scene already has a body {name!r}: choose another name")
            return name
        stem = (printable(mesh.path.stem).strip() if mesh.path else "") or "body"
        return next(n for n in (stem, *(f"{stem}_{i}" for i in range(2, len(taken) + 3))) if n not in taken)


def load_scene(path: str | os.PathLike[str], accept_changed: bool = False) -> Scene:
    """Load a scene file.

    Args:
        path: NAME.scene.json, or a bundle NAME.scene.zip (see `hapscene.scene.scene_bundle`).
        accept_changed: accept mesh files whose vertices changed since the scene was saved, if the number of faces is
            the same; paint is assigned by face index.

    Raises:
        SceneError: the file is missing, damaged or of a later version, or a mesh has changed.
        MeshError: a mesh cannot be loaded.
        SwatchError: a swatch is unknown or invalid.
    """
    from hapscene.scene.scene_file import read_scene

    if str(path).endswith(".scene.zip"):
        from hapscene.scene.scene_bundle import read_bundle

        return read_bundle(Path(path), lambda file: load_scene(file, accept_changed))
    scene = Scene()
    read_scene(scene, Path(path), accept_changed)
    return scene


def _source(swatch: str | os.PathLike[str]) -> str | Path:
    """Return the key of a swatch source: the name of a library swatch, or the absolute path of a file."""
    text = os.fspath(swatch)
    named = isinstance(swatch, str) and not text.endswith(".swatch") and "/" not in text and os.sep not in text
    return text if named else Path(text).resolve()


def _same(a: Swatch, b: Swatch) -> bool:
    from hapscene.surface.swatch_file import swatch_to_json

    return swatch_to_json(a) == swatch_to_json(b)


def _faces(body: Body, where: object) -> NDArray[np.bool_]:
    """Return the mask (M,) of the faces that `where` selects."""
    count = len(body.mesh.faces)
    if where is None:
        return np.ones(count, np.bool_)
    if isinstance(where, str):
        return body.mesh.faces_of(where)
    chosen = np.asarray(where)
    if chosen.dtype == np.bool_ and chosen.shape == (count,):
        return chosen
    if chosen.ndim != 1 or (chosen.size and chosen.dtype.kind not in "iu"):
        raise SceneError(
            f"body {body.name!r}: expected face indices (n,), a bool mask ({count},), a group name or a region"
        )
    mask = np.zeros(count, np.bool_)
    if chosen.size:
        if chosen.min() < 0 or chosen.max() >= count:
            bad = int(chosen[(chosen < 0) | (chosen >= count)][0])
            raise SceneError(f"body {body.name!r}: face index {bad} out of range; expected 0 to {count - 1}")
        mask[chosen] = True
    return mask


def _is_flat(mesh: Mesh) -> bool:
    """Return whether all faces have zero area."""
    # usually one of the first faces has an area, and the others need not be computed
    parts = (mesh.faces[:1000], mesh.faces)
    return not any((height_of(mesh.vertices_m[part]) > FLAT_RATIO * mesh.diagonal_m).any() for part in parts)


def _warn_of_winding(body: Body) -> None:
    mesh = body.mesh
    _, mixed, closed = mesh.neighbours
    turned, what = 0, ""
    if mixed:
        # may be 0: doubled faces and faces without area also count as mixed
        turned = int(np.count_nonzero(mesh_structure(mesh).winding.turned))
        what = "wound opposite to their neighbours, so they can be touched only from behind"
    elif closed and volume_of(mesh.vertices_m, mesh.faces) < 0:
        turned = len(mesh.faces)
        what = "wound inward, so the proxy enters the body from outside and is held inside"
    if turned:
        warn(
            f"body {body.name!r}: {turned:,} of {len(mesh.faces):,} faces are {what}; pass two_sided=True "
            f"(--two-sided) or repair the mesh with `hapscene check {mesh.path or 'MESH'} --fix FIXED.ply`",
            MeshWarning,
        )
