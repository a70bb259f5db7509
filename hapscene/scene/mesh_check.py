"""Examining many meshes: a verdict on each, in one word and as JSON."""

import json
import warnings
from pathlib import Path
from typing import Any, Final

from hapscene.constants import SCENE_SUFFIXES
from hapscene.errors import HapsceneError, printable
from hapscene.scene.mesh import Mesh
from hapscene.scene.mesh_doctor import examine
from hapscene.scene.mesh_file import FORMATS, load_mesh
from hapscene.scene.mesh_report import Report
from hapscene.scene.scene import load_scene

__all__ = ["CODES", "examined", "mesh_sources", "verdict_of"]

VERDICTS: Final = ("felt", "felt with notes", "felt with faults", "not felt", "not readable")
"""The verdicts about a mesh, from good to bad."""

FELT, NOTES, FAULTS, NOT_FELT, UNREADABLE = VERDICTS

CODES: Final = {FELT: 0, NOTES: 0, FAULTS: 1, NOT_FELT: 1, UNREADABLE: 2}
"""How bad a verdict is: 0 felt, 1 with faults or not felt, 2 not readable."""


def mesh_sources(name: str) -> list[tuple[Path, Mesh | None]]:
    """The mesh files of a folder, by their suffixes; a scene's meshes, by the names of their bodies; or the file."""
    path = Path(name)
    if name.endswith(SCENE_SUFFIXES):
        return [(Path(body.name), body.mesh) for body in load_scene(path).bodies]
    if not path.is_dir():
        return [(path, None)]
    files = sorted(file for file in path.iterdir() if file.suffix.lower().lstrip(".") in FORMATS)
    return [(file, None) for file in files if not file.name.startswith(".")]


def examined(file: Path, mesh: Mesh | None, unit: str | None, **reading: Any) -> dict[str, Any]:
    """The report on a mesh, loaded from its file unless it is given: as JSON, with its `verdict`, and `words`."""
    prefix = printable(f"{file}: ")  # as errors have it
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            if mesh is None:
                own = file.suffix.lower().lstrip(".") not in ("stl", "obj", "ply", "off", "zip")
                mesh = load_mesh(file, None if own else unit, **reading)
            report = examine(mesh)
        except (HapsceneError, OSError, MemoryError) as error:
            reason = " ".join(str(error).removeprefix(prefix).split()) or "not enough memory"
            return {"path": str(file), "verdict": UNREADABLE, "error": reason, "words": f": {reason}"}
    verdict = verdict_of(report)
    warned = [printable(str(warning.message)).removeprefix(prefix) for warning in caught]
    words = [*warned, *(finding.what for finding in sorted(report.findings, key=lambda f: f.level != "fault"))]
    return {
        **json.loads(report.to_json()),
        "verdict": NOTES if warned and verdict == FELT else verdict,
        "warnings": warned,
        "words": ": " + "; ".join(words) if words else "",
    }


def verdict_of(report: Report) -> str:
    flat = sum(finding.count for finding in report.findings if finding.kind in ("zero_area", "needles"))
    if flat >= report.face_count:
        return NOT_FELT
    return FAULTS if report.fault_count else NOTES if report.findings else FELT
