"""Checks of many meshes: a verdict and a report for each."""

import json
import warnings
from pathlib import Path
from typing import Any, Final

from hapscene.constants import SCENE_SUFFIXES
from hapscene.errors import HapsceneError, printable
from hapscene.scene.mesh import Mesh
from hapscene.scene.mesh_doctor import examine
from hapscene.scene.mesh_file import FORMATS, UNITLESS, load_mesh
from hapscene.scene.mesh_report import Report
from hapscene.scene.scene import load_scene
from hapscene.scene.size_advice import size_advice

__all__ = ["CODES", "examined", "mesh_sources", "verdict_of"]

VERDICTS: Final = ("ok", "ok, with notes", "has faults", "cannot be touched", "cannot be loaded")
"""Verdicts on a mesh, from best to worst."""

OK, NOTES, FAULTS, UNTOUCHABLE, UNREADABLE = VERDICTS

CODES: Final = {OK: 0, NOTES: 0, FAULTS: 1, UNTOUCHABLE: 1, UNREADABLE: 2}
"""Exit code for each verdict."""


def mesh_sources(name: str) -> list[tuple[Path, Mesh | None]]:
    """Return the mesh files of a folder; the meshes of a scene, with body names as paths; or the file itself."""
    path = Path(name)
    if name.endswith(SCENE_SUFFIXES):
        return [(Path(body.name), body.mesh) for body in load_scene(path).bodies]
    if not path.is_dir():
        return [(path, None)]
    files = sorted(file for file in path.iterdir() if file.suffix.lower().lstrip(".") in FORMATS)
    return [(file, None) for file in files if not file.name.startswith(".")]


def examined(file: Path, mesh: Mesh | None, unit: str | None, **reading: Any) -> dict[str, Any]:
    """Check a mesh (loaded from `file` if None); return a JSON report with `verdict`, `warnings` and `words`."""
    prefix = printable(f"{file}: ")  # errors start with it
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            if mesh is None:
                has_unit = file.suffix.lower().lstrip(".") not in UNITLESS
                mesh = load_mesh(file, None if has_unit else unit, **reading)
            report = examine(mesh)
        except (HapsceneError, OSError, MemoryError) as error:
            reason = " ".join(str(error).removeprefix(prefix).split()) or "not enough memory"
            return {"path": str(file), "verdict": UNREADABLE, "error": reason, "words": f": {reason}"}
    verdict = verdict_of(report)
    warned = [printable(str(warning.message)).removeprefix(prefix) for warning in caught]
    words = [
        *warned,
        *filter(None, [size_advice(mesh).words]),
        *(finding.what for finding in sorted(report.findings, key=lambda f: f.level != "fault")),
    ]
    return {
        **json.loads(report.to_json()),
        "verdict": NOTES if warned and verdict == OK else verdict,
        "warnings": warned,
        "words": ": " + "; ".join(words) if words else "",
    }


def verdict_of(report: Report) -> str:
    """Return the verdict of a report."""
    flat = sum(finding.count for finding in report.findings if finding.kind in ("zero_area", "needles"))
    if flat >= report.face_count:
        return UNTOUCHABLE
    return FAULTS if report.fault_count else NOTES if report.findings else OK
