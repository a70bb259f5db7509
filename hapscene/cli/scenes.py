"""`hapscene view`, `hapscene check` and `hapscene convert`: commands for scenes and meshes."""

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from hapscene.cli.console import print_files, print_lines, print_progress
from hapscene.cli.inputs import (
    SCENES,
    base_name,
    check_scene,
    find_asset,
    load_input,
    loading,
    new_file,
    print_size_advice,
)
from hapscene.cli.options import Dark, Help, InFile, MeshOptions, OutFile, Positive, ReadOptions
from hapscene.errors import MeshError, SaveConflict, SceneError, ViewError

if TYPE_CHECKING:
    from hapscene.scene.mesh import Mesh

__all__ = ["check", "convert", "view"]


ShowLayers = Literal["look", "feel", "both"]
Size = Annotated[tuple[int, int] | None, Parameter(validator=Number(gte=160, lte=4096), metavar="WIDTH HEIGHT")]


def view(
    scene: Annotated[str, Help("Scene (.scene.json), painted scene of another format, mesh, or name of an asset")],
    /,
    *,
    out: Annotated[OutFile, Help("Image .png, or video .gif or .mp4 (default: NAME.png)")] = None,
    touch: Annotated[InFile | None, Help("Recorded touch.npz, whose path and forces are drawn")] = None,
    size: Annotated[Size, Help("Size with the legend, 160 to 4096 [pixels] (default of videos: 800 600)")] = None,
    dark: Dark = False,
    seconds: Annotated[
        Positive | None, Help("Duration of a video [s] (default: duration of the touch, without one 6)")
    ] = None,
    show: Annotated[ShowLayers, Help("Layers shown: materials of the meshes, paint, or both")] = "both",
    mesh: MeshOptions = MeshOptions(),
) -> None:
    """Draw a scene, with or without a recorded touch of it, as an image or video.

    examples:
      hapscene view demo
      hapscene view bunny.ply --unit m --swatch wood --out bunny.gif --size 480 360
      hapscene view desk.scene.json --touch out/desk/touch.npz --out desk.mp4
    """
    scene, mesh = find_asset(scene, mesh)
    check_scene(scene, mesh)
    out = out or new_file(f"{base_name(scene)}.png")

    from hapscene.io.files import check_file
    from hapscene.render.recording import Recording
    from hapscene.touch import step
    from hapscene.view.offscreen import started_ahead
    from hapscene.view.palette import DARK, LIGHT
    from hapscene.view.picture import RATES_HZ, write_picture

    kind = out.suffix.lower()
    if kind not in (".png", *RATES_HZ):
        raise ViewError(f"{out}: unknown image format {kind!r}; expected a name that ends with .png, .gif or .mp4")
    if kind == ".png" and seconds:
        raise ViewError(f"{out}: --seconds is only valid for videos; expected a name that ends with .gif or .mp4")
    check_file(out, ViewError)
    theme = DARK if dark else LIGHT
    with ExitStack() as stack:
        stack.enter_context(started_ahead())
        loaded = load_input(scene, mesh)
        recording = None if touch is None else Recording.load(touch)
        stack.enter_context(step(print_progress, f"drawing {out}"))
        write_picture(loaded, recording, out, size=size, seconds=seconds, theme=theme, show=show)
    print_files([out])


def check(
    meshes: Annotated[list[str], Help("Mesh files, scenes, or name of an asset")],
    /,
    *,
    fix: Annotated[Path | None, Help("File for the repaired mesh, .ply")] = None,
    read: ReadOptions = ReadOptions(),
) -> int:
    """Check meshes for defects, and report how each defect affects haptic rendering.

    All meshes of a scene are checked. --fix repairs the defects of a single mesh
    that can be repaired safely. Exit codes: 0 no defects; 1 a mesh has defects or
    cannot be touched; 2 a file cannot be read.

    examples:
      hapscene check demo
      hapscene check part.stl --unit mm
      hapscene check part.stl --unit mm --fix part_mended.ply
    """
    files = [find_asset(name, read) for name in meshes]
    for path, options in files:
        check_scene(path, options)
    from hapscene.io.files import check_file
    from hapscene.scene.mesh_doctor import repair
    from hapscene.scene.ply import save_mesh

    if fix is not None:
        check_file(fix, MeshError)
    found = [mesh for path, options in files for mesh in _meshes_of(path, options)]
    if fix is not None and len(found) != 1:
        raise MeshError(f"--fix repairs a single mesh; got {len(found)}")
    sound = list[bool]()
    for mesh in found:
        print("\n" if sound else "", end="")
        sound.append(_report_on(mesh))
    if fix is None:
        return 0 if all(sound) else 1
    mended, done = repair(found[0])
    save_mesh(mended, fix)
    print_lines(["", *(f"repaired: {line}" for line in done or ["nothing; the mesh has no defects to repair"])])
    print_files([fix])
    print("its unit is the metre: read it with --unit m")
    return 0


def _meshes_of(path: str, read: ReadOptions) -> "list[Mesh]":
    """Load a mesh, or the meshes of a scene."""
    from hapscene.scene.mesh_file import load_mesh
    from hapscene.scene.scene import load_scene
    from hapscene.touch import step

    if path.endswith(SCENES):
        return list({id(body.mesh): body.mesh for body in load_scene(path).bodies}.values())
    with step(print_progress, loading(path)):
        return [load_mesh(path, read.unit, **read.reading())]


def _report_on(mesh: "Mesh") -> bool:
    """Print the report on a mesh; return whether it has no defects."""
    from hapscene.scene.mesh_doctor import examine
    from hapscene.scene.size_advice import size_advice

    report = examine(mesh)
    print_lines(report.text().split("\n"))
    if words := size_advice(mesh).words:
        print_lines(["", f"size: {words}"])
    if not report.can_be_touched:
        print_lines(["", "the mesh cannot be touched: no face has an area"])
    return report.can_be_touched and not report.fault_count


def convert(
    source: Annotated[str, Help("Scene (.scene.json), .glb, .ply, or any mesh file")],
    target: Annotated[
        Path | None, Help("File to write (default: NAME.glb for a scene, NAME.scene.json for other files)")
    ] = None,
    /,
    *,
    replace: Annotated[bool, Help("Replace the target if it exists")] = False,
    show: Annotated[ShowLayers, Help("Layers shown by .glb: materials of the meshes, paint, or both")] = "both",
    cut: Annotated[bool, Help("Cut faces at painted borders in .glb, to paint on in Blender")] = False,
    read: ReadOptions = ReadOptions(),
) -> None:
    """Convert a painted scene to or from the format of another program.

    The type of the target file selects the conversion:

      .scene.json                     import of a file written by hapscene, or of a
                                      mesh whose material names match swatch names
      .glb .ply .obj                  export of a scene
      .html                           page that anyone can touch and listen to:
                                      one file, for any browser, also on a phone

    examples:
      hapscene convert desk.scene.json              # to desk.glb
      hapscene convert desk.scene.json desk.ply
      hapscene convert desk.scene.json desk.html    # to touch in a browser
      hapscene convert desk.glb                     # to desk.scene.json
    """
    check_scene(source, read)
    from hapscene.exchange import export_scene, import_scene, losses
    from hapscene.exchange.format_registry import format_of
    from hapscene.touch import open_scene, step

    target = target or Path(base_name(source) + (".glb" if source.endswith(SCENES) else ".scene.json"))
    name = "" if target.name.endswith(SCENES) else format_of(target)
    if not name and source.endswith(SCENES):
        raise SceneError(
            f"{source}: is already a scene file; name a target of another type, as in {base_name(source)}.glb"
        )
    if target.exists() and not replace:
        raise SaveConflict(f"{target}: exists already; choose another name, or add --replace")
    with step(print_progress, loading(source)):
        opened = open_scene if source.endswith(SCENES) else import_scene
        scene = opened(source, read.unit, **read.reading())
    if not name:
        print_size_advice(scene, source)
        scene.save(target)
        print_files([target])
    else:
        print_files(export_scene(scene, target, replace=replace, show=show, cut=cut))
        lost = (*losses(scene, name), *(["faces before they were cut"] if cut else []))
        print("not read again from this format: " + ("; ".join(lost) or "nothing; all data is kept"))
