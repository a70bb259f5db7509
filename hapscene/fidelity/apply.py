"""Makes a simplified scene: coarser meshes and lower texture orders."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from hapscene.errors import SceneError
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene

__all__ = ["Simplification", "simplified"]


@dataclass(frozen=True)
class Simplification:
    """What is simplified in a scene. Bodies and swatches that are not named are unchanged.

    Attributes:
        meshes: coarser meshes by name of the body, whose groups are the swatches of the scene (`coarser_mesh`). A mesh
            without groups takes the swatch of a body that has only one.
        orders: orders of the texture models by name of the swatch.
    """

    meshes: Mapping[str, Mesh] = field(default_factory=dict)
    orders: Mapping[str, int] = field(default_factory=dict)


def simplified(scene: Scene, what: Simplification) -> Scene:
    """Return the simplified scene, with the same bodies and swatches in the same order and at the same poses.

    A texture of lower order uses the first reflection coefficients of each model (`Texture.truncated`).

    Raises:
        SceneError: a coarser mesh without painting.
        SwatchError: an order below 1.
    """
    made = scene.copy()
    names = tuple(swatch.name for swatch in scene.swatches)
    for body in made.bodies:
        mesh = what.meshes.get(body.name, body.mesh)
        if mesh is body.mesh:
            continue
        if mesh.group is not None and mesh.group_names == names:
            body.face_swatch = mesh.group.copy()
        elif np.all(body.face_swatch == body.face_swatch[0]):
            body.face_swatch = np.full(len(mesh.faces), body.face_swatch[0])
        else:
            raise SceneError(f"the coarser mesh of body {body.name!r} has no painting")
        body.mesh = mesh
    for index, name in enumerate(names):
        texture = scene.swatches[index].texture
        if name in what.orders and texture is not None:
            made.swatches[index] = replace(scene.swatches[index], texture=texture.truncated(what.orders[name]))
            made.swatch_source[index] = None
    return made
