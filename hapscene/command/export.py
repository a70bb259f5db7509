"""`hapscene export` and `hapscene import`."""

import argparse
from pathlib import Path
from typing import Any

from hapscene.command.console import name_made, say
from hapscene.command.options import (
    add_command,
    add_out_file,
    add_reading_options,
    base_name,
    check_scene,
    loading,
    reading,
    tell_size,
)
from hapscene.errors import SaveConflict, SceneError


def add_export(commands: Any) -> None:
    command = add_command(commands, "export", _export)
    command.add_argument("scene", metavar="SCENE", help="a scene file (.scene.json), or a file that import reads")
    add_out_file(command, "FILE", ".glb, .gltf, .ply, .obj, .stl or .png (default NAME.glb, as desk.glb)")
    add_reading_options(command)
    command.add_argument("--replace", action="store_true", help="take the place of a file that is there")
    command.add_argument("--body", metavar="NAME", help="in .png: of which body, where several could be meant")


def _export(options: argparse.Namespace) -> int:
    """Write a painted scene for other programs: GLB, glTF, PLY, OBJ, STL.

    As .png it is a picture over the texture coordinates of a body, a colour for each swatch, with its legend beside it;
    `hapscene paint --map` reads it again.

    for example:
      hapscene export desk.scene.json                                 # as desk.glb
      hapscene export desk.scene.json --out desk.ply
      hapscene export desk.scene.json --out desk.glb --replace
      hapscene export duck.scene.json --out duck.png                  # and its legend, duck.json
    """
    check_scene(options.scene, options.unit)
    options.out = options.out or f"{base_name(options.scene)}.glb"
    from hapscene.exchange import export_scene, losses
    from hapscene.exchange.format_registry import format_of
    from hapscene.scene.scene import Scene
    from hapscene.touch import step

    name = format_of(options.out)
    with step(say, loading(options.scene)):
        scene: Scene = _open(options)
    if options.out.lower().endswith(".png"):
        name_made(_export_picture(scene, Path(options.out), options))
        return 0
    if scene.bodies:
        say("does not come back from this format: " + ("; ".join(losses(scene, name)) or "nothing is lost") + "\n")
    try:
        made = export_scene(scene, options.out, name, replace=options.replace)
    except SaveConflict as conflict:
        raise SaveConflict(f"{conflict} (--replace)") from None
    name_made(made)
    return 0


def _export_picture(scene: Any, path: Path, options: argparse.Namespace) -> list[Path]:
    from hapscene.files import check_file
    from hapscene.scene.uv_paint import body_with_uv, save_picture

    check_file(path, SceneError)
    for file in (path, path.with_suffix(".json")):
        if file.exists() and not options.replace:
            raise SaveConflict(f"{file}: is there already; take another name, or replace it (--replace)")
    return save_picture(scene, body_with_uv(scene, options.body), path)


def _open(options: argparse.Namespace) -> Any:
    if options.scene.endswith((".scene.json", ".scene.zip")):
        from hapscene.touch import open_scene  # which refuses the options

        return open_scene(options.scene, options.unit, **reading(options))
    from hapscene.exchange import import_scene

    return import_scene(options.scene, options.unit, **reading(options))


def add_import(commands: Any) -> None:
    command = add_command(commands, "import", _import)
    command.add_argument("file", metavar="FILE", help=".glb, .gltf, .ply, or any mesh file")
    add_out_file(command, "SCENE", "scene file to write (default NAME.scene.json, as desk.scene.json)")
    command.add_argument("--replace", action="store_true", help="take the place of a scene that is there")
    add_reading_options(command)


def _import(options: argparse.Namespace) -> int:
    """Make a scene file of what export wrote, or of a mesh whose materials are called as swatches.

    for example:
      hapscene import desk.glb                                        # as desk.scene.json
      hapscene import table.obj --unit mm --out table.scene.json
    """
    check_scene(options.file, options.unit)
    options.out = options.out or f"{base_name(options.file)}.scene.json"
    from hapscene.exchange import import_scene
    from hapscene.touch import step

    with step(say, loading(options.file)):
        scene = import_scene(options.file, options.unit, **reading(options))
    if Path(options.out).exists() and not options.replace:
        raise SaveConflict(f"{options.out}: is there already; take another name, or replace it (--replace)")
    tell_size(scene, options.file)
    scene.save(options.out)
    name_made([Path(options.out)])
    faces = sum(len(body.mesh.faces) for body in scene.bodies)
    painted = sum(int((body.face_swatch != 0).sum()) for body in scene.bodies)
    bodies = "1 body" if len(scene.bodies) == 1 else f"{len(scene.bodies)} bodies"
    print(f"{bodies}, {painted:,} of {faces:,} faces painted: " + ", ".join(s.name for s in scene.swatches))
    return 0
