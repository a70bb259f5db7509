"""The scene that one level of a fidelity makes of a scene: coarser meshes, shorter filters, fewer effects."""

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import SceneError, no_such
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch

if TYPE_CHECKING:
    from hapscene.fidelity.fidelity import Level, SwatchFidelity
SILENT: Final[dict[str, dict[str, Any]]] = {
    "lpc_texture": {"texture": None},
    "tap": {"taps": None, "leaving": None},
    "friction": dict.fromkeys(("friction_static", "friction_dynamic", "friction_viscous_s_m", "breakaway_1_kg"), 0.0),
    "life": {},
}
"""What a swatch has that an effect is silent on. Without its wall, a surface is none. Life is of the texture."""

NUMBERS: Final[dict[str, tuple[str, ...]]] = {
    "lpc_texture": ("texture_gain",),
    "tap": (),
    "friction": tuple(SILENT["friction"]),
    "life": ("texture_life",),
}
"""The numbers by which they are."""

TEXTURE: Final = "lpc_texture"
"""The effect whose filter follows force and speed every `update_ticks` ticks."""


def apply_level(scene: Scene, level: "Level") -> Scene:
    """The scene at a level: the same bodies and swatches by name, in the same order, at the same poses.

    A body's coarser mesh is painted as its groups say, where they are the scene's swatches (`coarser_mesh`); else as
    its own mesh is there, see `nearest_faces`. A texture of lower order is that of the first reflection coefficients of
    each model (`Texture.truncated`). What the level does not name is shared.

    Raises:
        SceneError: a body or swatch that the scene does not have, an effect that cannot be left out, a coarser mesh for
            a body that is painted finer than its faces.
        SwatchError: an order below 1.
    """
    at = scene.copy()
    for what, named, known in (
        ("body", level.bodies, [body.name for body in scene.bodies]),
        ("swatch", level.swatches, [swatch.name for swatch in scene.swatches]),
    ):
        if unknown := sorted(set(named) - set(known)):
            raise SceneError(no_such(what, unknown[0], known))
    for body in at.bodies:
        found = level.bodies.get(body.name)
        if found is not None and found.mesh is not None and found.mesh is not body.mesh:
            if body.fine is not None:
                raise SceneError(
                    f"body {body.name!r} is painted finer than its faces, so it has no coarser mesh: leave its mesh "
                    "out of the level, or paint it with finest_m=math.inf"
                )
            if found.mesh.group_names == tuple(swatch.name for swatch in scene.swatches):
                body.face_swatch = found.mesh.group.copy()  # it brings its painting along
            else:
                body.face_swatch = body.face_swatch[nearest_faces(body.mesh, found.mesh)]
            body.mesh = found.mesh
    for index, swatch in enumerate(at.swatches):
        if swatch.name in level.swatches:
            at.swatches[index] = _swatch_at(swatch, level.swatches[swatch.name])
            at.swatch_source[index] = None
    return at


def _swatch_at(swatch: Swatch, fidelity: "SwatchFidelity") -> Swatch:
    """The swatch as that fidelity has it."""
    order, texture = fidelity.order, swatch.texture
    effects = {name: dict(numbers) for name, numbers in swatch.effects.items()}
    fields: dict[str, Any] = {}
    for effect in fidelity.left_out:
        if effect not in SILENT:
            raise SceneError(
                f"swatch {swatch.name!r}: effect {effect!r} cannot be left out; those that can: {', '.join(SILENT)}"
            )
        fields |= SILENT[effect]
        for name in SILENT[effect].keys() & effects.get(effect, {}).keys():
            effects[effect][name] = 0.0
    if order is not None and texture is not None and "texture" not in fields:
        fields["texture"] = texture.truncated(order)
    if "life" in fidelity.left_out:
        effects[TEXTURE] = effects.get(TEXTURE, {}) | {"texture_life": 0.0}
    if fidelity.update_ticks != 1:
        effects[TEXTURE] = effects.get(TEXTURE, {}) | {"update_ticks": float(fidelity.update_ticks)}
    return replace(swatch, effects=effects, **fields)


def nearest_faces(mesh: Mesh, coarse: Mesh) -> NDArray[np.intp]:
    """The face of `mesh` (n,) nearest to the middle of each face of `coarse`, the first of several.

    Where the two have the same faces each is its own, also where faces lie on each other.
    """
    if np.array_equal(mesh.vertices_m, coarse.vertices_m) and np.array_equal(mesh.faces, coarse.faces):
        return np.arange(len(mesh.faces))
    from scipy.spatial import cKDTree
    from trimesh import triangles as faces_of  # without types of its own

    closest_point: Any = faces_of.closest_point
    triangles, points = mesh.triangles_m, coarse.triangles_m.mean(axis=1)
    middle = triangles.mean(axis=1)
    best, nearest = (np.asarray(found) for found in cKDTree(middle).query(points))  # a middle is on its face
    # A face's middle is within its own size of the nearest place on it. Size by size, so that one large face does not
    # have every point look at all the small ones.
    reach = np.linalg.norm(triangles - middle[:, None], axis=2).max(axis=1)
    size = np.ceil(np.log2(np.maximum(reach, 1e-12)))
    for one in np.unique(size):
        faces = np.flatnonzero(size == one)
        within = cKDTree(middle[faces]).query_ball_point(points, best * (1.0 + 1e-9) + reach[faces].max())
        point = np.repeat(np.arange(len(points)), [len(some) for some in within])
        face = faces[np.concatenate([*within, []]).astype(np.intp)]
        away = np.linalg.norm(closest_point(triangles[face], points[point]) - points[point], axis=1)
        order = np.lexsort((face, away, point))
        at, first = np.unique(point[order], return_index=True)
        face, away = face[order][first], away[order][first]
        closer = (away < best[at]) | ((away == best[at]) & (face < nearest[at]))
        nearest[at[closer]], best[at[closer]] = face[closer], away[closer]
    return nearest
