"""The simplified scene of a fidelity: coarser meshes, lower texture orders, slower filter updates."""

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from hapscene.errors import SceneError, no_such
from hapscene.scene.body import Body
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch

if TYPE_CHECKING:
    from hapscene.fidelity.fidelity import Level, SwatchFidelity

__all__ = ["apply_level"]

TEXTURE: Final = "lpc_texture"
"""The effect whose filter adapts to force and speed every `update_ticks` ticks."""


def apply_level(scene: Scene, level: "Level") -> Scene:
    """Return the scene at a level of detail, with the same bodies and swatches in the same order and at the same poses.

    The groups of a coarser mesh are its painting: the swatches of the scene (`coarser_mesh`). A mesh without groups
    takes the swatch of a body that has only one. A texture of lower order uses the first reflection coefficients of
    each model (`Texture.truncated`). Bodies and swatches that the level does not name are shared with the original
    scene.

    Raises:
        SceneError: a body or swatch that the scene does not have; a coarser mesh without painting, or for a body that
            is painted finer than its faces.
        SwatchError: an order below 1.
    """
    at = scene.copy()
    for what, named, known in (
        ("body", level.bodies, [body.name for body in scene.bodies]),
        ("swatch", level.swatches, [swatch.name for swatch in scene.swatches]),
    ):
        if unknown := sorted(set(named) - set(known)):
            raise SceneError(no_such(what, unknown[0], known))
    names = tuple(swatch.name for swatch in scene.swatches)
    for body in at.bodies:
        found = level.bodies.get(body.name)
        if found is not None and found.mesh is not None and found.mesh is not body.mesh:
            _put_mesh(body, found.mesh, names)
    for index, swatch in enumerate(at.swatches):
        if swatch.name in level.swatches:
            at.swatches[index] = _swatch_at(swatch, level.swatches[swatch.name])
            at.swatch_source[index] = None
    return at


def _put_mesh(body: Body, mesh: Mesh, swatch_names: tuple[str, ...]) -> None:
    """Give a body a coarser mesh with its painting."""
    if body.fine is not None:
        raise SceneError(
            f"body {body.name!r} is painted finer than its faces and cannot have a coarser mesh: remove its mesh from "
            "the level, or paint it with resolution_m=math.inf"
        )
    if mesh.group is not None and mesh.group_names == swatch_names:
        body.face_swatch = mesh.group.copy()
    elif np.all(body.face_swatch == body.face_swatch[0]):
        body.face_swatch = np.full(len(mesh.faces), body.face_swatch[0])
    else:
        raise SceneError(
            f"the coarser mesh of body {body.name!r} has no painting; expected as its groups the swatches of the "
            f"scene, {', '.join(swatch_names)}"
        )
    body.mesh = mesh


def _swatch_at(swatch: Swatch, fidelity: "SwatchFidelity") -> Swatch:
    """The swatch with the order and the updates of a fidelity."""
    texture, effects = swatch.texture, dict(swatch.effects)
    if fidelity.order is not None and texture is not None:
        texture = texture.truncated(fidelity.order)
    if fidelity.update_ticks != 1:
        effects[TEXTURE] = {**effects.get(TEXTURE, {}), "update_ticks": float(fidelity.update_ticks)}
    return replace(swatch, texture=texture, effects=effects)
