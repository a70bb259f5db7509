"""The scene: bodies at their poses, and the swatches painted on them."""

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import MeshError, SceneError, no_such, printable, warn
from hapscene.geometry import rigid
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import paint_faces, paint_region
from hapscene.scene.mesh import Mesh, MeshWarning
from hapscene.scene.mesh_file import load_mesh
from hapscene.scene.mesh_structure import FLAT_RATIO, height_of, mesh_structure
from hapscene.scene.region import Region, Volume
from hapscene.scene.topology import volume_of
from hapscene.surface.swatch import PLAIN, Swatch, SwatchLike

if TYPE_CHECKING:
    import trimesh

__all__ = ["SWATCH_MAX", "Scene", "load_scene"]

SWATCH_MAX: Final = np.iinfo(np.int16).max
"""Most swatches of one scene [count], by the type of `Body.face_swatch`."""


class Scene:
    """Bodies and their swatches.

    Attributes:
        bodies: in the order they were added; a recording's `body` counts through them.
        swatches: those in use; number 0 is `PLAIN`, which every face has until it is painted.
        pose_count: how often a body was put at another pose.
    """

    def __init__(self) -> None:
        self.bodies: list[Body] = []
        self.swatches: list[Swatch] = [PLAIN]
        self.pose_count = 0
        # Where each swatch was loaded from: a shipped name, a file, or None where it was handed over.
        self.swatch_source: list[str | Path | None] = [PLAIN.name]
        self._loaded: dict[tuple[Any, ...], Mesh] = {}
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
            mesh: a file, a `Mesh`, or a `trimesh.Trimesh`. The same file and unit, or the same `Mesh`, added
                again makes an instance: the bodies share the mesh.
            name: unique in the scene; without one, that of the file, made unique.
            unit: of the mesh's numbers, for files and trimesh objects: see `hapscene.load_mesh`.
            swatch: what all its faces are painted with: a shipped swatch's name, a .swatch file, or a
                `Swatch`.
            pose: X_WB (4, 4), rigid; the identity without one.
            two_sided: feel the inside of faces too; for open sheets, and meshes of mixed winding.
            up, scale: the axis that is up in a file or trimesh object, and how much larger to make it: see
                `hapscene.load_mesh`.

        Raises:
            MeshError: the mesh cannot be loaded.
            SceneError: the name is taken, the pose not rigid.
            SwatchError: the swatch is unknown or broken.

        Warns:
            MeshWarning: no face has an area; or, with `two_sided` off, some are wound against their neighbours, or all
                of a closed mesh inward.
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
                f"body {name!r}: none of its {len(shape.faces):,} faces has an area, so it can never be touched: is "
                "its file complete, and not scaled flat?",
                MeshWarning,
            )
        elif not body.two_sided and not any(b.mesh is shape and not b.two_sided for b in self.bodies):
            _warn_of_winding(body)
        self.bodies.append(body)
        return body

    def body(self, name: str) -> Body:
        """The body of that name.

        Raises:
            SceneError: there is none.
        """
        found = next((body for body in self.bodies if body.name == name), None)
        if found is None:
            raise SceneError(no_such("body", name, (body.name for body in self.bodies)))
        return found

    def pose(self, body: str, X_WB: ArrayLike) -> None:
        """Put a body at a pose X_WB (4, 4); those that hang on it go with it.

        A renderer of this scene has it appear there in its next tick, moving nothing on its way; a servo, which has a
        copy, does not see it: give poses to `Renderer.step` for bodies that move.

        Raises:
            SceneError: no such body, or the pose is not rigid.
        """
        moved = self.body(body)
        X_WB = rigid(X_WB, f"body {body!r}")
        step = X_WB @ np.linalg.inv(moved.X_WB)
        for child in self.hanging_on(body):
            child.X_WB = rigid(step @ child.X_WB, f"body {child.name!r}")
        moved.X_WB = X_WB
        self.pose_count += 1

    def hang(self, body: str, parent: str | None) -> None:
        """Hang a body on another, with which it moves from now on in `pose`; None takes it off. It stays where it is.

        Raises:
            SceneError: no such body; or the parent is that body, or hangs on it.
        """
        child = self.body(body)
        above = None if parent is None else self.body(parent).name
        held = {known.name: known.parent for known in self.bodies}  # looked up: a file may have a long chain of them
        while above is not None:
            if above == body:
                raise SceneError(f"body {body!r} cannot hang on {parent!r}, which is itself or hangs on it")
            above = held[above]
        child.parent = parent

    def hanging_on(self, body: str) -> list[Body]:
        """The bodies that hang on a body, and those that hang on these."""
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
        where: "str | Region | Sequence[int] | NDArray[Any] | None" = None,
        *,
        soft_m: float = 0.0,
        finest_m: float | None = None,
    ) -> int:
        """Paint a swatch onto a body; returns how many faces it reaches.

        `Box`, `Sphere`, `PlaneSide` and `Tube` cut through faces: their border lies where they end, however large
        the mesh's triangles are. All else paints whole faces.

        Args:
            body: its name.
            swatch: a shipped swatch's name, a .swatch file, or a `Swatch`.
            where: None for all faces; the name of a group, material or object in the mesh's file; indices of
                faces, or a bool for each; or a region of `hapscene.scene.region`, in the body's frame.
            soft_m: width of a border that goes over from what was there to the swatch [m], half on either side of
                where the region ends; 0 is a sharp one. For regions that cut through faces.
            finest_m: how far from its place the border may lie [m]; infinity paints whole faces, by their centroids.
                None: 0.1 mm, or the body's diagonal / 4096 where that is more.

        Raises:
            SceneError: no such body, a face index out of range, an invalid width, or a soft border of whole faces.
            MeshError: no such group.
            SwatchError: the swatch is unknown or broken.
        """
        painted = self.body(body)
        if isinstance(where, Volume):
            return len(paint_region(painted, where, self.swatch_index(swatch), finest_m=finest_m, soft_m=soft_m))
        if soft_m != 0:
            raise SceneError(
                f"soft_m needs a region that cuts through faces (Box, Sphere, PlaneSide, Tube), not {where!r}"
            )
        chosen = _faces(painted, where)
        paint_faces(painted, chosen, self.swatch_index(swatch))
        return int(np.count_nonzero(chosen))

    def copy(self) -> "Scene":
        """The scene as it is now; meshes and swatches, which nobody changes, are shared."""
        copy = Scene()
        copy.bodies = [replace(body, face_swatch=body.face_swatch.copy()) for body in self.bodies]
        copy.swatches[:] = self.swatches
        copy.swatch_source[:] = self.swatch_source
        return copy

    def rename(self, index: int, name: str) -> None:
        """Give a body another name, which the caller knows to be free."""
        self._names.discard(self.bodies[index].name)
        self.bodies[index].name = name

    def swatch_index(self, swatch: SwatchLike) -> int:
        """Index of a swatch in `swatches`, where it is put if new.

        Raises:
            SwatchError: the swatch is unknown or broken.
            SceneError: another swatch of its name is in the scene.
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
                    f"another swatch named {swatch.name!r} is in the scene; recordings tell them by name: "
                    "rename one of them"
                )
        if len(self.swatches) >= SWATCH_MAX:
            raise SceneError(f"a scene has at most {SWATCH_MAX:,} swatches")
        self.swatches.append(swatch)
        self.swatch_source.append(source)
        return len(self.swatches) - 1

    def save(self, path: str | os.PathLike[str]) -> None:
        """Save as one readable file, NAME.scene.json, next to its meshes: see `hapscene.scene.scene_file`.

        Raises:
            SceneError: the suffix is another, or the file cannot be written.
        """
        from hapscene.scene.scene_file import save_scene

        save_scene(self, Path(path))

    def mesh_of(
        self,
        mesh: Any,
        unit: str | None = None,
        accept_damaged: bool = False,
        *,
        up: str | None = None,
        scale: float = 1.0,
    ) -> Mesh:
        """The mesh of what `add` takes, with no body made of it yet; a file is loaded once.

        Raises:
            MeshError: the mesh cannot be loaded.
        """
        if isinstance(mesh, Mesh):
            if up is not None or scale != 1.0:
                raise MeshError("a Mesh has z up and its size: give up= and scale= to load_mesh or Mesh.from_trimesh")
            return mesh
        if not isinstance(mesh, str | os.PathLike):
            return Mesh.from_trimesh(mesh, unit, up=up, scale=scale)
        key = (Path(mesh).resolve(), unit, accept_damaged, up, scale)
        if key not in self._loaded:
            self._loaded[key] = load_mesh(Path(mesh), unit, up=up, scale=scale, accept_damaged=accept_damaged)
        return self._loaded[key]

    def _name(self, name: str | None, mesh: Mesh) -> str:
        if len(self._names) != len(self.bodies):
            self._names = {body.name for body in self.bodies}
        taken = self._names
        if name is not None:
            if not isinstance(name, str) or not name.strip() or not name.isprintable():
                raise SceneError(f"a body's name is a printable text, not {name!r}")
            if name in taken:
                raise SceneError(f"a body {name!r} is in the scene already; names are unique")
            return name
        stem = (printable(mesh.path.stem).strip() if mesh.path else "") or "body"
        return next(n for n in (stem, *(f"{stem}_{i}" for i in range(2, len(taken) + 3))) if n not in taken)


def load_scene(path: str | os.PathLike[str], accept_changed: bool = False) -> Scene:
    """Load a scene as `Scene.save` wrote it.

    Args:
        path: the file, NAME.scene.json; or all in one, NAME.scene.zip (`hapscene.scene.scene_bundle`).
        accept_changed: take a mesh that has changed since, if it still has as many faces; the painting stays
            on faces of the same number.

    Raises:
        SceneError: the file is missing, damaged or of a later version, or a mesh has changed.
        MeshError: a mesh cannot be loaded.
        SwatchError: a swatch is unknown or broken.
    """
    from hapscene.scene.scene_file import read_scene

    if str(path).endswith(".scene.zip"):
        from hapscene.scene.scene_bundle import read_bundle

        return read_bundle(Path(path), lambda file: load_scene(file, accept_changed))
    scene = Scene()
    read_scene(scene, Path(path), accept_changed)
    return scene


def _source(swatch: str | os.PathLike[str]) -> str | Path:
    """What tells two swatches apart before they are loaded: a shipped one's name, or a file's whole path."""
    text = os.fspath(swatch)
    named = isinstance(swatch, str) and not text.endswith(".swatch") and "/" not in text and os.sep not in text
    return text if named else Path(text).resolve()


def _same(a: Swatch, b: Swatch) -> bool:
    from hapscene.surface.swatch_file import swatch_to_json

    return swatch_to_json(a) == swatch_to_json(b)


def _faces(body: Body, where: Any) -> NDArray[np.bool_]:
    """Chosen faces (M,) bool."""
    count = len(body.mesh.faces)
    if where is None:
        return np.ones(count, np.bool_)
    if isinstance(where, str):
        return body.mesh.faces_of(where)
    if isinstance(where, Region):
        return where.pick(body.mesh)
    chosen = np.asarray(where)
    if chosen.dtype == np.bool_ and chosen.shape == (count,):
        return chosen
    if chosen.ndim != 1 or (chosen.size and chosen.dtype.kind not in "iu"):
        raise SceneError(
            f"body {body.name!r}: faces are given as indices (n,), bool ({count},), a group's name or region"
        )
    mask = np.zeros(count, np.bool_)
    if chosen.size:
        if chosen.min() < 0 or chosen.max() >= count:
            bad = int(chosen[(chosen < 0) | (chosen >= count)][0])
            raise SceneError(f"body {body.name!r}: no face {bad}; its faces are 0 to {count - 1}")
        mask[chosen] = True
    return mask


def _is_flat(mesh: Mesh) -> bool:
    """Whether no face has an area."""
    # most often one of the first has, and the others need no look
    parts = (mesh.faces[:1000], mesh.faces)
    return not any((height_of(mesh.vertices_m[part]) > FLAT_RATIO * mesh.diagonal_m).any() for part in parts)


def _warn_of_winding(body: Body) -> None:
    mesh = body.mesh
    _, mixed, closed = mesh.neighbours
    turned, what = 0, ""
    if mixed:
        # none, where they are copies, or have no area
        turned = int(np.count_nonzero(mesh_structure(mesh).winding.turned))
        what = "wound against their neighbours, so they are felt from inside alone"
    elif closed and volume_of(mesh.vertices_m, mesh.faces) < 0:
        turned = len(mesh.faces)
        what = "wound inward, so the tool goes in from outside unfelt, and is held inside"
    if turned:
        warn(
            f"body {body.name!r}: {turned:,} of {len(mesh.faces):,} faces are {what}; two_sided=True (--two-sided) "
            f"feels both sides, `hapscene check {mesh.path or 'MESH'} --fix FIXED.ply` turns them",
            MeshWarning,
        )
