"""What can be mended in a mesh without moving a vertex or guessing what was meant."""

from typing import Final

import numpy as np

from hapscene.errors import MeshError
from hapscene.scene.anatomy import anatomy
from hapscene.scene.mesh import Mesh

PASS_MAX: Final = 4
"""Most times that a mesh is gone through [count]. Meshes seen so far need one, badly broken ones two."""


def mend(mesh: Mesh) -> tuple[Mesh, list[str]]:
    """Merge vertices at one place, drop spare and doubled faces, wind shells alike and closed ones outward.

    Vertices are not moved. Faces keep their order, group and colour. Cracks, holes and faces that cross each
    other are left: what was meant there only their maker knows.

    Returns:
        The mended mesh, without a path, in metres, or the same mesh if there was nothing to do; and a line for
        each thing done.

    Raises:
        MeshError: no face would be left.
    """
    done: list[str] = []
    for _ in range(PASS_MAX):  # turned faces may turn out to be copies of others
        mended, lines = _mend_once(mesh)
        if not lines:
            break
        mesh, done = mended, done + lines
    return mesh, done


def _mend_once(mesh: Mesh) -> tuple[Mesh, list[str]]:
    body = anatomy(mesh)
    done: list[str] = []
    kept = ~(body.spare | body.doubled)
    if not kept.any():
        raise MeshError(f"{mesh.path or 'mesh'}: no face has an area: nothing is left to mend")
    faces = body.welded[mesh.faces]
    used = body.welded == np.arange(len(body.welded))
    place = np.cumsum(used) - 1
    if not used.all():
        done.append(f"merged {np.count_nonzero(~used):,} vertices into others at exactly their place")
    for mask, what in ((body.spare, "without area"), (body.doubled, "that were there twice")):
        if mask.any():
            done.append(f"dropped {np.count_nonzero(mask):,} faces {what}")
    turned = body.winding.turned & kept
    if turned.any():
        done.append(f"turned {np.count_nonzero(turned):,} faces that were wound against the rest of their shell")
    if body.shells.inside_out.any():
        done.append(f"turned closed shells of {np.count_nonzero(body.shells.inside_out):,} faces that were inside out")
    turned = turned ^ body.shells.inside_out
    faces[turned] = faces[turned][:, ::-1]
    mended = Mesh(
        vertices_m=mesh.vertices_m[used],
        faces=place[faces[kept]],
        group=mesh.group[kept],
        group_names=mesh.group_names,
        colour_rgb=None if mesh.colour_rgb is None else mesh.colour_rgb[kept],
    )
    return mended, done
