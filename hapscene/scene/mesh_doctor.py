"""Mesh checks: find defects of a mesh, explain their effect on contact, and repair those that can be repaired."""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.constants import SKIN_RATIO
from hapscene.errors import MeshError, printable
from hapscene.scene.mesh import Mesh
from hapscene.scene.mesh_structure import MeshStructure, mesh_structure
from hapscene.scene.topology import Index

__all__ = ["examine", "length", "repair"]

# Reports of the mesh check: findings, and their presentation as text.


NAME_SHOWN: Final = 60
"""Maximum length of a group name in the report [characters]."""


class Defect(NamedTuple):
    """A kind of defect.

    Attributes:
        level: "fault" if the defect affects contact, "note" if it may not.
        noun: "face", "edge" or "vertex".
        what: description of the defect.
        touch: effect on contact.
        advice: how to correct the defect.
        fixable: whether `repair` corrects it.
    """

    level: str
    noun: str
    what: str
    touch: str
    advice: str
    fixable: bool = False


@dataclass(frozen=True)
class Finding:
    """A defect of a mesh: a key of `DEFECTS`, the number of faces, edges or vertices concerned, and more about them."""

    kind: str
    count: int
    more: str = ""

    @property
    def defect(self) -> Defect:
        """The kind of defect."""
        return DEFECTS[self.kind]


@dataclass(frozen=True)
class Report:
    """Result of a mesh check.

    Attributes:
        mesh: the mesh.
        shell_count: number of connected sets of faces.
        volume_m3: enclosed volume of a closed mesh without its cavities [m³]; None for an open mesh.
    """

    mesh: Mesh
    shell_count: int
    volume_m3: float | None
    findings: tuple[Finding, ...]

    def __repr__(self) -> str:
        return f"<Report on {self.mesh!r}: {len(self.findings) or 'no'} findings>"

    @property
    def fault_count(self) -> int:
        """Number of findings that affect contact."""
        return sum(finding.defect.level == "fault" for finding in self.findings)

    @property
    def can_be_touched(self) -> bool:
        """Whether a face has an area."""
        flat = sum(find.count for find in self.findings if find.kind in ("zero_area", "needles"))
        return flat < len(self.mesh.faces)

    def text(self) -> str:
        """Return the report as text, faults first."""
        mesh, path = self.mesh, str(self.mesh.path or "mesh")
        x, y, z = map(length, np.ptp(mesh.bounds_m, axis=0).tolist())
        shape = "open" if self.volume_m3 is None else f"closed, {_volume(self.volume_m3)}"
        is_step = path.lower().endswith((".step", ".stp"))
        unit = "in m, converted from the unit of the file" if is_step else f"unit of the file: {mesh.unit}"
        lines = [
            f"{printable(path)}: {number(len(mesh.faces), 'face')}, {number(len(mesh.vertices_m), 'vertex')}, "
            f"{number(self.shell_count, 'shell')}, {shape}",
            f"size {x} × {y} × {z} ({unit})",
        ]
        if len(mesh.group_names) > 1:
            more = ", …" if len(mesh.group_names) > 8 else ""
            first = ", ".join(printable(name, NAME_SHOWN) for name in mesh.group_names[:8])
            lines.append(f"{len(mesh.group_names)} groups: {first}{more}")
        if not self.findings:
            lines.append("no defects found")
        for finding in sorted(self.findings, key=lambda f: f.defect.level != "fault"):
            level, noun, what, touch, advice, fixable = finding.defect
            lines += ["", f"{level.upper()}: {number(finding.count, noun)} {what}{finding.more}", f"  effect: {touch}"]
            lines += [f"  action: {advice}{' (--fix does this)' if fixable else ''}"]
        return "\n".join(printable(line) for line in lines)


def number(count: int, noun: str) -> str:
    """Format a count with its noun: "1 face", "2,000 vertices"."""
    return f"{count:,} {noun if count == 1 else {'vertex': 'vertices'}.get(noun, noun + 's')}"


def length(length_m: float) -> str:
    """Format a length [m] with a suitable unit."""
    for unit, metres in (("m", 1.0), ("mm", 1e-3), ("µm", 1e-6), ("nm", 1e-9)):
        rounded = float(f"{length_m / metres:.4g}")  # round first: 999.99 nm is 1 µm
        if rounded >= 1.0:
            return f"{rounded:.10g} {unit}"
    return f"{length_m * 1e9:.2g} nm" if length_m >= 1e-11 else "0 mm"


def _volume(volume_m3: float) -> str:
    return f"{volume_m3:.4g} m³" if abs(volume_m3) >= 0.1 else f"{volume_m3 * 1e6:.4g} cm³"


CHUNK: Final = 100_000
"""Number of edges that are processed at once [count]."""


def _on_edges(
    vertices_m: NDArray[np.float64], ends: Index, rim: Index, tree: scipy.spatial.cKDTree, tolerance_m: float
) -> tuple[Index, NDArray[np.float64]]:
    """Return the rim vertices that lie on the inside of edges (n, 2), and their distances from them."""
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
"""Maximum width of a crack in contact skins [1]. Wider openings are assumed to be intended."""


_TWO_SIDED = "add the body with two_sided=True (--two-sided)"

# fmt: off
DEFECTS: Final = {
    "mixed_winding": Defect(
        "fault", "face", "with winding opposite to the rest of the shell",
        "these faces can be touched only from behind; from outside the proxy passes through them",
        f"reverse their winding, or {_TWO_SIDED}", fixable=True),
    "inside_out": Defect(
        "fault", "face", "in closed shells that are wound inward",
        "the proxy enters the shell from outside and is held inside",
        f"reverse the winding of the shells, or {_TWO_SIDED}", fixable=True),
    "one_sided": Defect(
        "fault", "face", "in shells without inside and outside, such as a Möbius strip",
        "neighbouring faces push from opposite sides, and the proxy slips through between them", _TWO_SIDED),
    "open_edges": Defect(
        "note", "edge", "with a face on one side only: the mesh is open",
        "the proxy can pass over the rim; from behind it passes through the faces",
        f"none if the opening is intended; else close it, or {_TWO_SIDED}"),
    "cracks": Defect(
        "fault", "vertex", "on a crack that is wider than the skin of contact",
        "the proxy may fall into the crack", "merge the vertices in a mesh editor (merge by distance)"),
    "nonmanifold_edges": Defect(
        "note", "edge", "where more than two faces meet",
        "each face can be touched on the side that its winding defines; the check of windings stops at these edges",
        "none if the outside is correct; else delete the inner faces in a mesh editor"),
    "zero_area": Defect("note", "face", "without area", "none", "delete them", fixable=True),
    "needles": Defect(
        "note", "face", "without area that fill a T-junction", "none; without them the mesh would be open", "none"),
    "doubled_faces": Defect("note", "face", "that duplicate another face", "none", "delete the copies", fixable=True),
    "opposed_faces": Defect(
        "note", "face", "back to back with another face", "as a sheet without thickness, from both sides", "none"),
    "duplicate_vertices": Defect(
        "note", "vertex", "at exactly the position of another vertex", "none: contact merges equal positions",
        "merge them to save memory", fixable=True),
}
# fmt: on


def examine(mesh: Mesh) -> Report:
    """Check a mesh for defects."""
    body = mesh_structure(mesh)
    masks = {
        "mixed_winding": body.winding.turned,
        "inside_out": body.shells.inside_out,
        "one_sided": body.winding.one_sided,
        "zero_area": body.spare,
        "needles": body.flat & ~body.spare,
        "doubled_faces": body.doubled,
        "opposed_faces": body.opposed,
        "open_edges": body.edges.count == 1,
        "nonmanifold_edges": body.edges.count > 2,
        "duplicate_vertices": body.welded != np.arange(len(body.welded)),
    }
    found = [Finding(kind, int(np.count_nonzero(mask))) for kind, mask in masks.items()] + _cracks(mesh, body)
    closed = bool(body.kept.any() and body.shells.closed[body.kept].all())
    return Report(
        mesh,
        len(np.unique(body.winding.shell[body.kept])),
        body.shells.volume_m3 if closed else None,
        tuple(finding for finding in found if finding.count),
    )


def _cracks(mesh: Mesh, body: MeshStructure) -> list[Finding]:
    """Find vertices of open edges that nearly lie on another open edge or vertex: openings too narrow to see."""
    skin_m = SKIN_RATIO * mesh.diagonal_m
    most_m = CRACK_SKINS * skin_m
    ends = body.edges.ends(np.flatnonzero(body.edges.count == 1))
    rim = np.unique(ends)
    if not len(rim):
        return []
    tree = scipy.spatial.cKDTree(mesh.vertices_m[rim])
    near = rim[tree.query_pairs(most_m, output_type="ndarray")]
    size = np.int64(len(mesh.vertices_m))
    side = ends.min(axis=1) * size + ends.max(axis=1)
    near = near[~np.isin(near.min(axis=1) * size + near.max(axis=1), side)]  # the two ends of one edge are no crack
    gap_m = np.linalg.norm(mesh.vertices_m[near[:, 0]] - mesh.vertices_m[near[:, 1]], axis=1)
    chunks = (ends[at : at + CHUNK] for at in range(0, len(ends), CHUNK))
    found = [_on_edges(mesh.vertices_m, chunk, rim, tree, most_m) for chunk in chunks]
    vertex, distance_m = map(np.concatenate, zip(*found, strict=True))
    nearest_m = np.full(size, np.inf)  # distance of each vertex from the nearest edge that it does not belong to
    np.minimum.at(nearest_m, vertex, distance_m)
    on_edge = np.unique(vertex)
    wide = np.concatenate([on_edge[nearest_m[on_edge] > skin_m], near[gap_m > skin_m, 0]])
    widest_m = max((0.0, *nearest_m[on_edge], *gap_m))
    return [Finding("cracks", len(np.unique(wide)), f" ({length(skin_m)}), up to {length(widest_m)} wide")]


# Repairs that neither move a vertex nor guess what was intended.


PASS_MAX: Final = 4
"""Maximum number of repair passes [count]. Meshes seen so far need one, badly damaged ones two."""


def repair(mesh: Mesh) -> tuple[Mesh, list[str]]:
    """Repair a mesh: merge equal vertices, delete faces without area and duplicates, and make the winding consistent.

    Closed shells are wound outward. Vertices are not moved. Faces keep their order, group and colour. Cracks and holes
    are not repaired, since the intended shape is not known.

    Returns:
        The repaired mesh in metres, without a path (the same object if nothing was repaired), and one line for each
        repair.

    Raises:
        MeshError: no face would remain.
    """
    done: list[str] = []
    for _ in range(PASS_MAX):  # reversed faces may become duplicates of others
        repaired, lines = _repair_once(mesh)
        if not lines:
            break
        mesh, done = repaired, done + lines
    return mesh, done


def _repair_once(mesh: Mesh) -> tuple[Mesh, list[str]]:
    body = mesh_structure(mesh)
    done: list[str] = []
    kept = ~(body.spare | body.doubled)
    if not kept.any():
        raise MeshError(f"{mesh.path or 'mesh'}: cannot be repaired: no face has an area")
    faces = body.welded[mesh.faces]
    used = body.welded == np.arange(len(body.welded))
    place = np.cumsum(used) - 1
    if not used.all():
        done.append(f"merged {np.count_nonzero(~used):,} vertices at equal positions")
    for mask, what in ((body.spare, "without area"), (body.doubled, "that were duplicates")):
        if mask.any():
            done.append(f"deleted {np.count_nonzero(mask):,} faces {what}")
    turned = body.winding.turned & kept
    if turned.any():
        done.append(f"reversed {np.count_nonzero(turned):,} faces with winding opposite to their shell")
    if body.shells.inside_out.any():
        done.append(
            f"reversed closed shells of {np.count_nonzero(body.shells.inside_out):,} faces that were inside out"
        )
    turned = turned ^ body.shells.inside_out
    faces[turned] = faces[turned][:, ::-1]
    repaired = Mesh(
        vertices_m=mesh.vertices_m[used],
        faces=place[faces[kept]],
        group=mesh.group[kept],
        group_names=mesh.group_names,
        colour_rgb=None if mesh.colour_rgb is None else mesh.colour_rgb[kept],
    )
    return repaired, done
