"""What the mesh doctor says: findings, and the report that gathers them."""

import json
from dataclasses import asdict, dataclass
from typing import Final

from hapscene.errors import printable

__all__ = ["Finding", "Report", "length", "number"]

VERSION: Final = 1
"""Version of the report's JSON."""

NAME_SHOWN: Final = 60
"""Most of a group's name that is told [characters]."""


@dataclass(frozen=True)
class Finding:
    """One thing that is odd about a mesh.

    Attributes:
        kind: a short name that does not change, for programs.
        level: "fault" where it will be felt, "note" where it need not.
        count: how many.
        what: what was found.
        touch: what that means for touching the mesh.
        advice: what to do.
        fixable: whether `hapscene.scene.mesh_doctor.repair` does it.
        examples: indices of the first faces or vertices concerned.
    """

    kind: str
    level: str
    count: int
    what: str
    touch: str
    advice: str
    fixable: bool = False
    examples: tuple[int, ...] = ()


@dataclass(frozen=True)
class Report:
    """What the doctor says of a mesh.

    Attributes:
        path: the mesh's file, or None.
        unit: of the numbers in that file.
        low_m: lowest corner of the bounding box (3,) [m]; high_m the highest, size_m its edges.
        skin_m: the skin of contact on this mesh [m]: what is narrower is not felt.
        shell_count: connected sets of faces.
        closed: whether every edge has just two faces.
        volume_m3: what a closed mesh encloses, without its cavities; None for an open one.
        examined_crossing: whether it was examined for faces that cross each other.
    """

    path: str | None
    unit: str
    vertex_count: int
    face_count: int
    group_names: tuple[str, ...]
    low_m: tuple[float, ...]
    high_m: tuple[float, ...]
    size_m: tuple[float, ...]
    skin_m: float
    shell_count: int
    closed: bool
    volume_m3: float | None
    examined_crossing: bool
    findings: tuple[Finding, ...] = ()

    def __repr__(self) -> str:
        words = f"{len(self.findings)} findings" if self.findings else "nothing odd"
        return f"<Report of {self.path or 'a mesh'}: {self.face_count:,} faces; {words}>"

    @property
    def fault_count(self) -> int:
        """How many findings will be felt."""
        return sum(finding.level == "fault" for finding in self.findings)

    def to_json(self) -> str:
        """The report as JSON, with its version."""
        return json.dumps({"format": "hapscene mesh report", "version": VERSION, **asdict(self)}, indent=2)

    def text(self) -> str:
        """The report to read: faults first."""
        x, y, z = map(length, self.size_m)
        held = "open" if self.volume_m3 is None else f"closed, {_volume(self.volume_m3)}"
        is_step = (self.path or "").lower().endswith((".step", ".stp"))
        unit = "in m, from the unit that its file says" if is_step else f"unit of the file: {self.unit}"
        lines = [
            f"{printable(self.path or 'mesh')}: "
            f"{number(self.face_count, 'face')}, {number(self.vertex_count, 'vertex')}, "
            f"{number(self.shell_count, 'shell')}, {held}",
            f"size {x} × {y} × {z} ({unit})",
        ]
        if len(self.group_names) > 1:
            more = ", …" if len(self.group_names) > 8 else ""
            first = ", ".join(printable(name, NAME_SHOWN) for name in self.group_names[:8])
            lines.append(f"{len(self.group_names)} groups: {first}{more}")
        if not self.examined_crossing:
            lines.append("not examined for faces that cross each other: too many faces")
        if not self.findings:
            lines.append("nothing odd was found")
        for finding in sorted(self.findings, key=lambda f: f.level != "fault"):
            fix = " (--fix does it)" if finding.fixable else ""
            lines += ["", f"{finding.level.upper()}: {finding.what}", f"  felt: {finding.touch}"]
            lines += [f"  do:   {finding.advice}{fix}"]
        return "\n".join(printable(line) for line in lines)


def number(count: int, noun: str) -> str:
    """A count with its noun: "1 face", "2,000 vertices"."""
    return f"{count:,} {noun if count == 1 else {'vertex': 'vertices'}.get(noun, noun + 's')}"


def length(length_m: float) -> str:
    """A length [m] in the unit that reads best."""
    for unit, metres in (("m", 1.0), ("mm", 1e-3), ("µm", 1e-6), ("nm", 1e-9)):
        rounded = float(f"{length_m / metres:.4g}")  # first of all: 999.99 nm are 1 µm
        if rounded >= 1.0:
            return f"{rounded:.10g} {unit}"
    return f"{length_m * 1e9:.2g} nm" if length_m >= 1e-11 else "0 mm"


def _volume(volume_m3: float) -> str:
    return f"{volume_m3:.4g} m³" if abs(volume_m3) >= 0.1 else f"{volume_m3 * 1e6:.4g} cm³"
