"""Reports of the mesh check: findings, and their presentation as text."""

from dataclasses import dataclass
from typing import Final

from hapscene.errors import printable

__all__ = ["Finding", "Report", "length", "number"]

NAME_SHOWN: Final = 60
"""Maximum length of a group name in the report [characters]."""


@dataclass(frozen=True)
class Finding:
    """A defect of a mesh.

    Attributes:
        kind: stable identifier for programs.
        level: "fault" if the defect affects contact, "note" if it may not.
        count: number of faces, edges or vertices concerned.
        what: description of the defect.
        touch: effect on contact.
        advice: how to correct the defect.
        fixable: whether `hapscene.scene.mesh_doctor.repair` corrects it.
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
    """Result of a mesh check.

    Attributes:
        path: the mesh file, or None.
        unit: unit of length in that file.
        size_m: size of the bounding box (3,) [m].
        skin_m: skin of contact on this mesh [m]; contact ignores narrower details.
        shell_count: number of connected sets of faces.
        closed: whether every edge has exactly two faces.
        volume_m3: enclosed volume of a closed mesh without its cavities [m³]; None for an open mesh.
    """

    path: str | None
    unit: str
    vertex_count: int
    face_count: int
    group_names: tuple[str, ...]
    size_m: tuple[float, ...]
    skin_m: float
    shell_count: int
    closed: bool
    volume_m3: float | None
    findings: tuple[Finding, ...] = ()

    def __repr__(self) -> str:
        words = f"{len(self.findings)} findings" if self.findings else "no findings"
        return f"<Report on {self.path or 'a mesh'}: {self.face_count:,} faces; {words}>"

    @property
    def fault_count(self) -> int:
        """Number of findings that affect contact."""
        return sum(finding.level == "fault" for finding in self.findings)

    @property
    def can_be_touched(self) -> bool:
        """Whether a face has an area."""
        return sum(find.count for find in self.findings if find.kind in ("zero_area", "needles")) < self.face_count

    def text(self) -> str:
        """Return the report as text, faults first."""
        x, y, z = map(length, self.size_m)
        shape = "open" if self.volume_m3 is None else f"closed, {_volume(self.volume_m3)}"
        is_step = (self.path or "").lower().endswith((".step", ".stp"))
        unit = "in m, converted from the unit of the file" if is_step else f"unit of the file: {self.unit}"
        lines = [
            f"{printable(self.path or 'mesh')}: "
            f"{number(self.face_count, 'face')}, {number(self.vertex_count, 'vertex')}, "
            f"{number(self.shell_count, 'shell')}, {shape}",
            f"size {x} × {y} × {z} ({unit})",
        ]
        if len(self.group_names) > 1:
            more = ", …" if len(self.group_names) > 8 else ""
            first = ", ".join(printable(name, NAME_SHOWN) for name in self.group_names[:8])
            lines.append(f"{len(self.group_names)} groups: {first}{more}")
        if not self.findings:
            lines.append("no defects found")
        for finding in sorted(self.findings, key=lambda f: f.level != "fault"):
            fix = " (--fix does this)" if finding.fixable else ""
            lines += ["", f"{finding.level.upper()}: {finding.what}", f"  effect: {finding.touch}"]
            lines += [f"  action: {finding.advice}{fix}"]
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
