"""What may be done to a scene, without a browser: every operation is a step that can be undone.

    session = Session(scene, Path("cup.scene.json"))
    wood = session.add_swatch("wood")
    session.begin_stroke(wood, radius_m=0.004)
    session.drag_to(origin_W_m, direction_W)     # as often as the pointer moves
    session.end_stroke()
    session.tune(wood, stiffness_N_m=350.0)
    session.undo()
    session.save()

A swatch is given by its index in `scene.swatches`; `ERASE` stands for the default of each body. A body is given by its
index or its name. All methods may be called from any thread.
"""

import math
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from hapscene.errors import SceneError
from hapscene.paint.paintable_mesh import Hit, Mask, PaintableMesh, WorldBox, WorldSphere
from hapscene.paint.painting import ERASE
from hapscene.paint.stroke import Stroke
from hapscene.paint.swatch_tuning import Tuned
from hapscene.scene.body import Body

__all__ = ["ERASE", "Hit", "Session"]

FACET_RAD: Final = math.radians(10.0)
"""Angle of the bucket unless told otherwise [rad], as `hapscene.scene.region.Facet` has it."""


class Session(Tuned):
    """A scene that is being painted.

    Args:
        scene: painted in place; nobody else should change it meanwhile.
        path: the scene file it was loaded from, or shall be saved to; None where that is not known yet.
        device: whose limits the parameters show, a name of `hapscene.device.model.DEVICES`.
        tick_s: period of the force channel [s].

    Attributes:
        path: where `save` writes.
        device, limits: as chosen; see `choose_device`.
        (and those of `hapscene.paint.painting.Canvas`: scene, shapes, defaults, history, lock)

    Raises:
        SceneError: a scene without bodies.
        HapsceneError: no such device.
    """

    # --- the brush ---

    def begin_stroke(self, swatch: int, radius_m: float) -> None:
        """Put the brush down; nothing is painted until it moves. A stroke in progress ends.

        Raises:
            SceneError: no such swatch, or no radius.
        """
        with self.lock:
            self.settle()
            self._stroke = Stroke(self, swatch, radius_m, "eraser" if swatch == ERASE else "brush")

    def stroke_to(self, hit: Hit | None) -> int:
        """Draw from the last place to this one, on the surface; how many faces became others. None lifts the brush.

        Where the last place was on another body, or none, only this place is painted.

        Raises:
            SceneError: no stroke was begun.
        """
        with self.lock:
            return self._begun().to(hit)

    def drag_to(self, origin_W_m: ArrayLike, direction_W: ArrayLike) -> Hit | None:
        """Draw to where a ray from the eye through the pointer meets the surface; that place, or None beside it.

        A long move is split: rays between the last one and this one find the way on the surface that the eye saw.

        Raises:
            SceneError: no stroke was begun.
        """
        with self.lock:
            return self._begun().drag_to(origin_W_m, direction_W)

    def end_stroke(self) -> int:
        """Lift the brush: the stroke is one step; how many faces it changed."""
        return self.settle()

    def _begun(self) -> Stroke:
        if self._stroke is None:
            raise SceneError("no stroke to go on with: begin one first")
        return self._stroke

    # --- fill: each returns how many faces became others ---

    def fill_body(self, body: int | str, swatch: int) -> int:
        """Paint a whole body."""
        return self._fill("whole body", body, swatch, lambda found, shape: np.ones(len(shape.normal), np.bool_))

    def fill_facet(self, hit: Hit, swatch: int, angle_rad: float = FACET_RAD) -> int:
        """Paint all faces connected with a place over edges that bend by at most an angle.

        Raises:
            SceneError: the angle is not between 0 and π.
        """
        degrees = math.degrees(angle_rad)
        if not 0.0 <= angle_rad <= math.pi:
            raise SceneError(f"a facet's angle must be between 0° and 180°, is {degrees:g}°")
        where = f"facet within {degrees:.3g}°"
        return self._fill(where, hit.body, swatch, lambda found, shape: shape.facet(hit.face, angle_rad))

    def fill_group(self, body: int | str, name: str, swatch: int) -> int:
        """Paint the faces of a group, material or object of the mesh's file, by its name or a part of that.

        Raises:
            MeshError: no face has that name.
        """
        return self._fill(repr(name), body, swatch, lambda found, shape: shape.mesh.faces_of(name))

    def fill_group_at(self, hit: Hit, swatch: int) -> int:
        """Paint the faces of the very group that a place is in."""
        where = repr(self.group_at(hit))
        return self._fill(where, hit.body, swatch, lambda found, shape: shape.mesh.group == shape.mesh.group[hit.face])

    def fill_swatch(self, body: int | str | None, old: int, swatch: int) -> int:
        """Paint what is painted with one swatch with another: of one body, or (None) of all."""
        return self._fill("swatch for swatch", body, swatch, lambda found, shape: found.face_swatch == old)

    def fill_sphere(self, centre_W_m: ArrayLike, radius_m: float, swatch: int, body: int | str | None = None) -> int:
        """Paint the faces whose centroid is within a distance of a point in W: of one body, or (None) of all.

        Raises:
            SceneError: the centre is not three finite numbers, or the radius not positive.
        """
        return self._fill("sphere", body, swatch, WorldSphere(centre_W_m, radius_m).pick)

    def fill_box(self, X_WK: ArrayLike, size_m: ArrayLike, swatch: int, body: int | str | None = None) -> int:
        """Paint the faces whose centroid is in a box: of one body, or (None) of all.

        Args:
            X_WK: (4, 4) pose of the box in W: its middle, and its axes.
            size_m: (3,) its edges [m].
            swatch: what to paint with.
            body: of which body; None for all.

        Raises:
            SceneError: the pose is not rigid, or an edge not positive.
        """
        return self._fill("box", body, swatch, WorldBox(X_WK, size_m).pick)

    def _fill(
        self, where: str, body: int | str | None, swatch: int, pick: Callable[[Body, PaintableMesh], Mask]
    ) -> int:
        with self.lock:
            chosen = range(len(self.shapes)) if body is None else [self.body_index(body)]
            masks = {i: pick(self.scene.bodies[i], self.shapes[i]) for i in chosen}
            return self.paint(f"{'erase' if swatch == ERASE else 'fill'} {where}", masks, swatch)

    # --- what is there ---

    def swatch_at(self, hit: Hit) -> int:
        """The swatch that a place is painted with."""
        return int(self.scene.bodies[hit.body].face_swatch[hit.face])

    def groups(self, body: int | str) -> list[tuple[str, int]]:
        """Names of a body's groups, materials and objects, and how many faces each has."""
        mesh = self.scene.bodies[self.body_index(body)].mesh
        counts = np.bincount(mesh.group, minlength=len(mesh.group_names))
        return [(name, int(n)) for name, n in zip(mesh.group_names, counts, strict=True) if n]

    def group_at(self, hit: Hit) -> str:
        """Name of the group that a place is in."""
        mesh = self.scene.bodies[hit.body].mesh
        return str(mesh.group_names[mesh.group[hit.face]])
