"""The mesh doctor: what is odd about a mesh, what that means for touching it, and what to do."""

from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.constants import SKIN_RATIO
from hapscene.errors import MeshError
from hapscene.scene.intersection import crossings
from hapscene.scene.mesh import UNIT_M, Mesh
from hapscene.scene.mesh_report import Finding, Report, length, number
from hapscene.scene.mesh_structure import MeshStructure, mesh_structure
from hapscene.scene.size_advice import HAND_M, LIKELY_M
from hapscene.scene.topology import Index

__all__ = ["examine", "repair"]

# Cracks: places where a mesh is open by less than can be seen.


CHUNK: Final = 100_000
"""Edges that are looked at together [count]."""


@dataclass(frozen=True, eq=False)
class Cracks:
    """Vertices on open edges that lie where other open edges pass or end.

    Attributes:
        on_edge: (n,) vertices on an open edge of another face: T-junctions.
        edge_gap_m: (n,) how far off that edge [m].
        near: (m, 2) vertices that nearly meet, at the ends of different open edges.
        near_gap_m: (m,) how far apart [m].
    """

    on_edge: Index
    edge_gap_m: NDArray[np.float64]
    near: Index
    near_gap_m: NDArray[np.float64]


def cracks(mesh: Mesh, body: MeshStructure, tolerance_m: float) -> Cracks:
    """Cracks no wider than a tolerance [m]."""
    ends = body.edges.ends(np.flatnonzero(body.edges.count == 1))
    rim = np.unique(ends)
    if not len(rim):
        none = np.zeros(0, np.int64)
        return Cracks(none, np.zeros(0), none.reshape(0, 2), np.zeros(0))
    place = mesh.vertices_m[rim]
    tree = scipy.spatial.cKDTree(place)
    near = rim[tree.query_pairs(tolerance_m, output_type="ndarray")]
    size = np.int64(len(mesh.vertices_m))
    side = ends.min(axis=1) * size + ends.max(axis=1)
    near = near[~np.isin(near.min(axis=1) * size + near.max(axis=1), side)]  # not the two ends of one short edge
    gap = np.linalg.norm(mesh.vertices_m[near[:, 0]] - mesh.vertices_m[near[:, 1]], axis=1)
    chunks = (ends[at : at + CHUNK] for at in range(0, len(ends), CHUNK))
    found = [_on_edges(mesh.vertices_m, chunk, rim, tree, tolerance_m) for chunk in chunks]
    which, distance = map(np.concatenate, zip(*found, strict=True))
    order = np.lexsort((distance, which))  # of several edges that a vertex lies on, the nearest
    unique, first = np.unique(which[order], return_index=True)
    return Cracks(unique, distance[order][first], near, gap)


def _on_edges(
    vertices_m: NDArray[np.float64], ends: Index, rim: Index, tree: Any, tolerance_m: float
) -> tuple[Index, NDArray[np.float64]]:
    """Rim vertices on the inside of edges (n, 2), and how far off."""
    start, end = vertices_m[ends[:, 0]], vertices_m[ends[:, 1]]
    length = np.linalg.norm(end - start, axis=1)
    found = tree.query_ball_point((start + end) / 2, length / 2)
    edge = np.repeat(np.arange(len(ends)), [len(f) for f in found])
    vertex = rim[np.concatenate([np.asarray(f, np.int64) for f in found])]
    along = (end - start)[edge] / length[edge, None]
    t = np.einsum("ij,ij->i", vertices_m[vertex] - start[edge], along)
    off = np.linalg.norm(vertices_m[vertex] - start[edge] - t[:, None] * along, axis=1)
    on = (off <= tolerance_m) & (t > tolerance_m) & (t < length[edge] - tolerance_m)
    return vertex[on], off[on]


CRACK_SKINS: Final = 10.0
"""Widest opening that is called a crack, in skins [1]. Wider ones are taken to be meant."""

CROSSING_SKINS: Final = 0.1
"""How far faces must reach into each other to be said to cross, in skins [1]: above float32 rounding."""

CROSSING_FACE_MAX: Final = 500_000
"""Most faces that are examined for crossing each other [count]: some ten seconds and a GB."""

EXAMPLE_COUNT: Final = 10
"""Faces or vertices that a finding names as examples [count]."""


class _Text(NamedTuple):
    level: str
    noun: str
    what: str
    touch: str
    advice: str
    fixable: bool = False


_INSIDE = "from outside both are felt, as where two bodies touch; inside, the tool meets walls that are not seen"
_UNITE = "nothing, if only the outside is touched; else unite the parts in a mesh editor (boolean union)"
_BRIDGED = "not at all: contact reaches over cracks narrower than its skin"
_TWO_SIDED = "add the body with two_sided=True (--two-sided)"

# fmt: off
_TEXT: Final = {
    "mixed_winding": _Text(
        "fault", "face", "wound against the rest of the shell",
        "outward-only contact holds these from inside alone: the tool sinks through them",
        f"turn them, or {_TWO_SIDED}", fixable=True),
    "inside_out": _Text(
        "fault", "face", "in closed shells that are wound inward as a whole",
        "outward-only contact lets the tool in everywhere, and holds it inside",
        f"turn the shells, or {_TWO_SIDED}", fixable=True),
    "one_sided": _Text(
        "fault", "face", "in shells that have no inside and outside, as a Möbius strip",
        "somewhere two neighbours hold from opposite sides, and the tool slips through between them", _TWO_SIDED),
    "open_edges": _Text(
        "note", "edge", "with a face on one side alone: the mesh is open",
        "the tool can pass over the rim; from behind, outward-only contact lets it through",
        f"nothing, if the opening is meant; else fill it, or {_TWO_SIDED}"),
    "cracks": _Text(
        "fault", "vertex", "on a crack that is wider than the skin of contact",
        "the tool may fall in", "join the vertices in a mesh editor (merge by distance)"),
    "t_junctions": _Text("note", "vertex", "on another face's open edge: T-junctions", _BRIDGED, "nothing"),
    "near_vertices": _Text(
        "note", "vertex", "on a rim, closer to another than the skin of contact", _BRIDGED, "nothing"),
    "nonmanifold_edges": _Text(
        "note", "edge", "where more than two faces meet",
        "each face is felt by its own winding; which side is out cannot be checked across such an edge",
        "nothing, if the outside feels right; else take out what lies inside, in a mesh editor"),
    "zero_area": _Text("note", "face", "without area, of no use", "never", "drop them", fixable=True),
    "needles": _Text(
        "note", "face", "without area that fill a T-junction", "never; without them the mesh would open", "nothing"),
    "slivers": _Text("note", "face", "narrower than the skin of contact", "as part of their neighbours", "nothing"),
    "doubled_faces": _Text("note", "face", "there twice", "once", "drop the copies", fixable=True),
    "opposed_faces": _Text(
        "note", "face", "back to back with another", "as a sheet without thickness, from both sides", "nothing"),
    "duplicate_vertices": _Text(
        "note", "vertex", "at exactly the place of another", "not at all: what counts is the place",
        "merge them, to save memory", fixable=True),
    "self_intersections": _Text("note", "pair", "of faces that go through each other", _INSIDE, _UNITE),
    "overlapping_faces": _Text("note", "pair", "of faces that overlap in one plane", _INSIDE, _UNITE),
}
# fmt: on


def examine(mesh: Mesh) -> Report:
    """Examine a mesh. 80,000 faces take a second, most of it to look for faces that cross each other."""
    body = mesh_structure(mesh)
    findings = _size(mesh) + _faces(mesh, body) + _edges(body) + _cracks(mesh, body) + _vertices(body)
    examined = len(mesh.faces) <= CROSSING_FACE_MAX
    if examined:
        findings += _crossings(mesh, body)
    low, high = mesh.bounds_m
    closed = bool(body.kept.any() and body.shells.closed[body.kept].all())
    return Report(
        path=str(mesh.path) if mesh.path else None,
        unit=mesh.unit,
        vertex_count=len(mesh.vertices_m),
        face_count=len(mesh.faces),
        group_names=mesh.group_names,
        low_m=tuple(low.tolist()),
        high_m=tuple(high.tolist()),
        size_m=tuple((high - low).tolist()),
        skin_m=_skin_m(mesh),
        shell_count=len(np.unique(body.winding.shell[body.kept])),
        closed=closed,
        volume_m3=body.shells.volume_m3 if closed else None,
        examined_crossing=examined,
        findings=tuple(findings),
    )


def _skin_m(mesh: Mesh) -> float:
    return SKIN_RATIO * mesh.diagonal_m


def _size(mesh: Mesh) -> list[Finding]:
    """A size that is not a hand's, and the units that would make it one."""
    size_m = mesh.diagonal_m
    if HAND_M[0] <= size_m <= HAND_M[1]:
        return []
    told = mesh.path is not None and mesh.path.suffix.lower() in (".step", ".stp")  # no other unit is taken
    units = {} if told else UNIT_M
    sizes_m = {unit: size_m * metres / UNIT_M[mesh.unit] for unit, metres in units.items()}
    likely = [f"--unit {u} makes it {length(m)}" for u, m in sizes_m.items() if LIKELY_M[0] <= m <= LIKELY_M[1]]
    advice = f"check the unit: {', '.join(likely)}" if likely else "scale it in a mesh editor"
    what = f"{length(size_m)} across: no size for a hand"
    if size_m < HAND_M[0]:
        return [Finding("tiny", "fault", 1, what, "hardly: the tool passes over it within a tick or two", advice)]
    return [Finding("huge", "note", 1, what, "a small piece of it, where the device reaches", advice)]


def _finding(kind: str, examples: NDArray[Any], count: int | None = None, more: str = "") -> list[Finding]:
    """A finding of so many, or of as many as there are examples; nothing of none."""
    count = len(examples) if count is None else count
    if not count:
        return []
    text = _TEXT[kind]
    what = f"{number(count, text.noun)} {text.what}{more}"
    first = tuple(examples[:EXAMPLE_COUNT].tolist())
    return [Finding(kind, text.level, count, what, text.touch, text.advice, text.fixable, first)]


def _faces(mesh: Mesh, body: MeshStructure) -> list[Finding]:
    kinds = {
        "mixed_winding": body.winding.turned,
        "inside_out": body.shells.inside_out,
        "one_sided": body.winding.one_sided,
        "zero_area": body.spare,
        "needles": body.flat & ~body.spare,
        "slivers": ~body.flat & (body.height_m < _skin_m(mesh)),
        "doubled_faces": body.doubled,
        "opposed_faces": body.opposed,
    }
    return [finding for kind, mask in kinds.items() for finding in _finding(kind, np.flatnonzero(mask))]


def _edges(body: MeshStructure) -> list[Finding]:
    findings = []
    for kind, chosen in (("open_edges", body.edges.count == 1), ("nonmanifold_edges", body.edges.count > 2)):
        faces = np.unique(body.edges.order[body.edges.start[chosen]] // 3)
        findings += _finding(kind, faces, int(np.count_nonzero(chosen)))
    return findings


def _cracks(mesh: Mesh, body: MeshStructure) -> list[Finding]:
    skin_m = _skin_m(mesh)
    crack = cracks(mesh, body, CRACK_SKINS * skin_m)
    near = crack.near[:, 0]
    wide = np.concatenate([crack.on_edge[crack.edge_gap_m > skin_m], near[crack.near_gap_m > skin_m]])
    gap_m = max((0.0, *crack.edge_gap_m, *crack.near_gap_m))
    return [
        *_finding("cracks", np.unique(wide), more=f" ({length(skin_m)}), at most {length(gap_m)} wide"),
        *_finding("t_junctions", crack.on_edge[crack.edge_gap_m <= skin_m]),
        *_finding("near_vertices", np.unique(near[crack.near_gap_m <= skin_m])),
    ]


def _vertices(body: MeshStructure) -> list[Finding]:
    return _finding("duplicate_vertices", np.flatnonzero(body.welded != np.arange(len(body.welded))))


def _crossings(mesh: Mesh, body: MeshStructure) -> list[Finding]:
    faces = np.flatnonzero(body.kept & ~body.flat)
    if len(faces) == 0:
        return []
    found = crossings(mesh.triangles_m[faces], CROSSING_SKINS * _skin_m(mesh))
    findings = []
    for kind, pairs in (("self_intersections", found.crossing), ("overlapping_faces", found.lying)):
        findings += _finding(kind, faces[np.unique(pairs)], len(pairs))
    return findings


# What can be mended in a mesh without moving a vertex or guessing what was meant.


PASS_MAX: Final = 4
"""Most times that a mesh is gone through [count]. Meshes seen so far need one, badly broken ones two."""


def repair(mesh: Mesh) -> tuple[Mesh, list[str]]:
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
    body = mesh_structure(mesh)
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
