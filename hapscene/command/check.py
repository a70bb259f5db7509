"""`hapscene check`."""

import argparse
import json
from pathlib import Path
from typing import Any

from hapscene.command.console import name_made, say, tell
from hapscene.command.options import UNIT_HELP, add_command, check_scene, loading
from hapscene.errors import MeshError


def add_check(commands: Any) -> None:
    command = add_command(commands, "check", _check)
    command.add_argument("mesh", metavar="MESH", help="a mesh file")
    command.add_argument("--unit", help=UNIT_HELP)
    command.add_argument("--json", action="store_true", help="print JSON")
    command.add_argument("--fix", metavar="OUT", help="mend what can be mended safely, and write it here")


def _check(options: argparse.Namespace) -> int:
    """Examine a mesh: what is wrong with it, and what that means for touching it.

    for example:
      hapscene check part.stl --unit mm
      hapscene check part.stl --unit mm --fix part_mended.ply
    """
    check_scene(options.mesh, options.unit)
    from hapscene.files import check_file
    from hapscene.scene.mesh_doctor import examine
    from hapscene.scene.mesh_file import load_mesh
    from hapscene.touch import step

    if options.fix is not None:
        check_file(Path(options.fix), MeshError)
    progress = _say_nothing if options.json else say
    with step(progress, loading(options.mesh)):
        mesh = load_mesh(options.mesh, options.unit)
    with step(progress, f"examining {len(mesh.faces):,} faces"):
        report = examine(mesh)
    done: list[str] = []
    if options.fix is not None:
        from hapscene.scene.mesh_doctor import repair
        from hapscene.scene.ply import save_mesh

        mended, done = repair(mesh)
        save_mesh(mended, options.fix)
    if options.json:
        fixed = {} if options.fix is None else {"fixed": done, "written": options.fix}
        print(json.dumps(json.loads(report.to_json()) | fixed, indent=2, ensure_ascii=False))
        return 0
    tell(report.text().split("\n"))
    if options.fix is not None:
        tell(["", *(f"mended: {line}" for line in done or ["nothing needed it"])])
        name_made([Path(options.fix)])
        print("it is in metres: --unit m")
    return 0


def _say_nothing(text: str) -> None:
    """Standard output is for the JSON."""
