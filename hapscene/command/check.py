"""`hapscene check`."""

import argparse
import json
import warnings
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hapscene.command.console import name_made, say, tell
from hapscene.command.options import (
    UNITLESS,
    add_command,
    add_reading_options,
    check_scene,
    check_there,
    find_asset,
    loading,
    reading,
)
from hapscene.errors import HapsceneError, MeshError, SceneError, printable

if TYPE_CHECKING:
    from hapscene.scene.mesh import Mesh
    from hapscene.scene.mesh_report import Report

SCENES: Final = (".scene.json", ".scene.zip")
"""Ends of the names of scene files."""

VERDICTS: Final = ("felt", "felt with notes", "felt with faults", "not felt", "not readable")
"""What is said of a mesh, from good to bad."""

FELT, NOTES, FAULTS, NOT_FELT, UNREADABLE = VERDICTS

CODES: Final = {FELT: 0, NOTES: 0, FAULTS: 1, NOT_FELT: 1, UNREADABLE: 2}
"""Exit codes."""


def add_check(commands: Any) -> None:
    command = add_command(commands, "check", _check)
    command.add_argument("mesh", nargs="+", metavar="MESH", help="a mesh file, several, a folder of them, or a scene")
    add_reading_options(command)
    command.add_argument("--json", action="store_true", help="print JSON; a list of several meshes, or a folder's")
    command.add_argument("--fix", metavar="OUT", help="mend what can be mended safely, and write it here")


def _check(options: argparse.Namespace) -> int:
    """Examine meshes: what is wrong with them, and what that means for touching them.

    Of several, a folder's or a scene's, each is told in a line. Exit codes: 0 nothing is wrong; 1 a mesh has faults,
    or cannot be felt; 2 a file cannot be read; of several the highest.

    for example:
      hapscene check demo
      hapscene check part.stl --unit mm
      hapscene check part.stl --unit mm --fix part_mended.ply
      hapscene check meshes --unit mm
    """
    if len(options.mesh) == 1 and not Path(options.mesh[0]).is_dir():
        path, options.unit = find_asset(options.mesh[0], options.unit)
        if not path.endswith(SCENES):
            return _check_one(path, options)
        options.mesh = [path]
    if options.fix is not None:
        raise MeshError("--fix mends one mesh; name one")
    if options.unit is not None:
        from hapscene.scene.mesh import unit_name

        unit_name(options.unit)
    sources = [source for name in options.mesh for source in _sources(name)]
    if not sources:
        raise MeshError(f"{options.mesh[0]}: no mesh file in this folder")
    return _check_all(sources, options)


def _check_one(path: str, options: argparse.Namespace) -> int:
    check_scene(path, options.unit)
    from hapscene.files import check_file
    from hapscene.scene.mesh_doctor import examine
    from hapscene.scene.mesh_file import load_mesh
    from hapscene.scene.size_advice import size_advice
    from hapscene.touch import step

    if options.fix is not None:
        check_file(Path(options.fix), MeshError)
    progress = _say_nothing if options.json else say
    with step(progress, loading(path)):
        mesh = load_mesh(path, options.unit, **reading(options))
    with step(progress, f"examining {len(mesh.faces):,} faces"):
        report = examine(mesh)
    done: list[str] = []
    if options.fix is not None:
        from hapscene.scene.mesh_doctor import repair
        from hapscene.scene.ply import save_mesh

        mended, done = repair(mesh)
        save_mesh(mended, options.fix)
    code = 0 if options.fix is not None else CODES[_verdict(report)]
    if options.json:
        fixed = {} if options.fix is None else {"fixed": done, "written": options.fix}
        print(json.dumps(json.loads(report.to_json()) | fixed, indent=2, ensure_ascii=False))
        return code
    tell(report.text().split("\n"))
    if words := size_advice(mesh).words:
        tell(["", f"size: {words}"])
    if options.fix is not None:
        tell(["", *(f"mended: {line}" for line in done or ["nothing needed it"])])
        name_made([Path(options.fix)])
        print("it is in metres: --unit m")
    return code


def _sources(name: str) -> "list[tuple[Path, Mesh | None]]":
    """The mesh files of a folder, by their suffixes; a scene's meshes, each under the name of its body; or the file."""
    from hapscene.scene.mesh_file import FORMATS

    path = Path(name)
    if name.endswith(SCENES):
        from hapscene.scene.scene import load_scene

        check_there(path, SceneError)
        return [(Path(body.name), body.mesh) for body in load_scene(path).bodies]
    if not path.is_dir():
        return [(path, None)]
    files = sorted(file for file in path.iterdir() if file.suffix.lower().lstrip(".") in FORMATS)
    return [(file, None) for file in files if not file.name.startswith(".")]


def _check_all(sources: "list[tuple[Path, Mesh | None]]", options: argparse.Namespace) -> int:
    progress = _say_nothing if options.json else say
    told: list[dict[str, Any]] = []
    for file, mesh in sources:
        progress(f"{file}: ")
        told.append(_examined(file, mesh, options))
        progress(f"{told[-1]['verdict']}{told[-1].pop('words')}\n")
    count = Counter(one["verdict"] for one in told)
    if options.json:
        print(json.dumps(told, indent=2, ensure_ascii=False))
    else:
        print(f"{len(told)} meshes: " + ", ".join(f"{count[v]} {v}" for v in VERDICTS if count[v]))
    return max(CODES[verdict] for verdict in count)


def _examined(file: Path, mesh: "Mesh | None", options: argparse.Namespace) -> dict[str, Any]:
    """What is said of a mesh, loaded from its file unless it is given: as JSON, with its `verdict`, and `words`."""
    from hapscene.scene.mesh_doctor import examine
    from hapscene.scene.mesh_file import load_mesh

    prefix = printable(f"{file}: ")  # as errors have it
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            if mesh is None:
                check_there(file, MeshError, "file or folder")
                own = file.suffix.lower().lstrip(".") not in (*UNITLESS, "zip")
                mesh = load_mesh(file, None if own else options.unit, **reading(options))
            report = examine(mesh)
        except (HapsceneError, OSError, MemoryError) as error:
            reason = " ".join(str(error).removeprefix(prefix).split()) or "not enough memory"
            return {"path": str(file), "verdict": UNREADABLE, "error": reason, "words": f": {reason}"}
    verdict = _verdict(report)
    warned = [printable(str(warning.message)).removeprefix(prefix) for warning in caught]
    words = [*warned, *(finding.what for finding in sorted(report.findings, key=lambda f: f.level != "fault"))]
    return {
        **json.loads(report.to_json()),
        "verdict": NOTES if warned and verdict == FELT else verdict,
        "warnings": warned,
        "words": ": " + "; ".join(words) if words else "",
    }


def _verdict(report: "Report") -> str:
    flat = sum(finding.count for finding in report.findings if finding.kind in ("zero_area", "needles"))
    if flat >= report.face_count:
        return NOT_FELT
    return FAULTS if report.fault_count else NOTES if report.findings else FELT


def _say_nothing(text: str) -> None:
    """Standard output is for the JSON."""
