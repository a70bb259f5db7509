"""`hapscene view`, `hapscene check` and `hapscene convert`: scenes and meshes."""

import json
import math
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from hapscene.cli.console import name_made, say, tell
from hapscene.cli.inputs import check_scene, find_asset, load_input, loading, tell_size
from hapscene.cli.options import AsJson, Dark, Help, InFile, MeshOptions, OutFile, Positive, ReadOptions
from hapscene.cli.paths import SCENES, base_name, check_swatch, check_there, new_file
from hapscene.errors import MeshError, SaveConflict, SceneError, ViewError

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

__all__ = ["check", "convert", "view"]


Frames = Annotated[int | None, Parameter(validator=Number(gte=2, lte=10_000))]
Size = Annotated[tuple[int, int] | None, Parameter(validator=Number(gte=160, lte=4096), metavar="WIDTH HEIGHT")]


def view(
    scene: Annotated[str, Help("Scene (.scene.json), painted scene of another format, mesh, or name of an asset")],
    /,
    *,
    out: Annotated[OutFile, Help("Picture .png, or film .gif or .mp4 (default: NAME.png)")] = None,
    touch: Annotated[InFile | None, Help("Touch of the scene, touch.npz: path and forces are drawn")] = None,
    size: Annotated[Size, Help("Size with the legend, 160 to 4096 [pixels]; of films 800 600 by default")] = None,
    dark: Dark = False,
    frames: Annotated[Frames, Help("Number of a film's frames (default: 12.5 a second as GIF, 25 as MP4)")] = None,
    seconds: Annotated[Positive | None, Help("Length of a film [s] (default: that of the touch, else 6)")] = None,
    turn: Annotated[float, Help("Angle that a film's camera goes around the scene [degrees]")] = 360.0,
    painting: Annotated[bool, Help("Film: show the scene unpainted first, then paint it swatch by swatch")] = False,
    mesh: MeshOptions = MeshOptions(),
) -> None:
    """Draw a scene, and a touch of it, as a picture or a film.

    for example:
      hapscene view demo
      hapscene view bunny.ply --unit m --swatch wood --out bunny.gif --size 480 360
      hapscene view desk.scene.json --touch out/desk/touch.npz --out desk.mp4
    """
    scene, mesh = find_asset(scene, mesh)
    check_scene(scene, mesh)
    out = out or new_file(f"{base_name(scene)}.png")

    from hapscene.files import check_file
    from hapscene.recording import Recording
    from hapscene.touch import step
    from hapscene.view.film import RATES_HZ, Film, write_film
    from hapscene.view.offscreen import started_ahead
    from hapscene.view.palette import DARK, LIGHT
    from hapscene.view.picture import write_picture

    kind = out.suffix.lower()
    if kind not in (".png", *RATES_HZ):
        raise ViewError(f"{out}: unknown kind of picture; end its name with .png, .gif or .mp4")
    if kind == ".png" and (frames or seconds or painting):
        raise ViewError(f"{out}: is a picture; --frames, --seconds and --painting are for films, .gif and .mp4")
    check_file(out, ViewError)
    theme = DARK if dark else LIGHT
    with ExitStack() as stack:
        stack.enter_context(started_ahead())
        loaded = load_input(scene, mesh)
        recording = None if touch is None else Recording.load(touch)
        stack.enter_context(step(say, f"drawing {out}"))
        if kind == ".png":
            write_picture(loaded, recording, out, size=size, theme=theme)
        else:
            film = Film(size or Film.size, seconds, frames, math.radians(turn), painting, theme)
            write_film(loaded, recording, out, film=film, say=say)
    name_made([out])


def check(
    meshes: Annotated[list[str], Help("Mesh files, folders of them, scenes, or name of an asset")],
    /,
    *,
    as_json: AsJson = False,
    fix: Annotated[Path | None, Help("Repair what can be repaired safely, into this .ply file")] = None,
    read: ReadOptions = ReadOptions(),
) -> int:
    """Examine meshes: what is wrong with them, and what that means for touching them.

    Of several meshes, a folder or a scene, each mesh gets one line. Exit codes:
    0 nothing is wrong; 1 a mesh has faults or cannot be felt; 2 a file cannot be
    read; of several meshes the highest.

    for example:
      hapscene check demo
      hapscene check part.stl --unit mm
      hapscene check part.stl --unit mm --fix part_mended.ply
      hapscene check meshes --unit mm
    """
    if len(meshes) == 1 and not Path(meshes[0]).is_dir():
        path, read = find_asset(meshes[0], read)
        check_there(path)
        if not path.endswith(SCENES):
            return _check_one(path, read, fix, as_json)
        meshes = [path]
    if fix is not None:
        raise MeshError("--fix repairs one mesh; name one")
    return _check_all(meshes, read, as_json)


def _check_one(path: str, read: ReadOptions, fix: Path | None, as_json: bool) -> int:
    check_scene(path, read)
    from hapscene.files import check_file
    from hapscene.scene.mesh_check import CODES, verdict_of
    from hapscene.scene.mesh_doctor import examine, repair
    from hapscene.scene.mesh_file import load_mesh
    from hapscene.scene.ply import save_mesh
    from hapscene.scene.size_advice import size_advice
    from hapscene.touch import step

    if fix is not None:
        check_file(fix, MeshError)
    progress = _say_nothing if as_json else say
    with step(progress, loading(path)):
        mesh = load_mesh(path, read.unit, **read.reading())
    with step(progress, f"examining {len(mesh.faces):,} faces"):
        report = examine(mesh)
    if as_json:
        print(json.dumps(json.loads(report.to_json()), indent=2, ensure_ascii=False))
    else:
        tell(report.text().split("\n"))
        if words := size_advice(mesh).words:
            tell(["", f"size: {words}"])
    if fix is None:
        return CODES[verdict_of(report)]
    mended, done = repair(mesh)
    save_mesh(mended, fix)
    if not as_json:
        tell(["", *(f"mended: {line}" for line in done or ["nothing needed it"])])
        name_made([fix])
        print("it is in metres: --unit m")
    return 0


def _check_all(meshes: Sequence[str], read: ReadOptions, as_json: bool) -> int:
    from hapscene.scene.mesh import unit_name
    from hapscene.scene.mesh_check import CODES, examined, mesh_sources

    if read.unit is not None:
        unit_name(read.unit)
    sources = [source for name in meshes for source in mesh_sources(name)]
    if not sources:
        raise MeshError(f"{meshes[0]}: no mesh file in this folder")
    progress = _say_nothing if as_json else say
    results = []
    for file, mesh in sources:
        progress(f"{file}: ")
        results.append(examined(file, mesh, read.unit, **read.reading()))
        progress(f"{results[-1]['verdict']}{results[-1].pop('words')}\n")
    count = Counter(one["verdict"] for one in results)
    if as_json:
        print(json.dumps(results, indent=2, ensure_ascii=False))
    else:
        print(f"{len(results)} meshes: " + ", ".join(f"{count[v]} {v}" for v in CODES if count[v]))
    return max(CODES[verdict] for verdict in count)


def _say_nothing(text: str) -> None:
    """No progress: standard output is for the JSON."""


def convert(
    source: Annotated[str, Help("Scene (.scene.json), .glb, .gltf, .ply, any mesh file, or swatch")],
    target: Annotated[Path | None, Help("File to write (default: NAME.glb, or NAME.scene.json)")] = None,
    /,
    *,
    replace: Annotated[bool, Help("Replace the target if it exists")] = False,
    body: Annotated[str | None, Help("Body that a .png shows, where several have texture coordinates")] = None,
    read: ReadOptions = ReadOptions(),
) -> None:
    """Convert a painted scene or a swatch to or from a file of other programs.

    The direction follows from the file types: a target .scene.json makes a scene
    of a file that hapscene wrote, or of a mesh whose material names match swatch
    names; .glb, .gltf, .ply, .obj and .stl are written from a scene. A target .png
    is a picture over the texture coordinates of a body, a colour for each swatch,
    with a legend beside it; `hapscene paint --map` reads it again. A swatch becomes
    MPEG haptics (.hjif): its texture at 1 N and 0.1 m/s for 2 s, then its taps.

    for example:
      hapscene convert desk.scene.json              # to desk.glb
      hapscene convert desk.scene.json desk.ply
      hapscene convert desk.glb                     # to desk.scene.json
      hapscene convert table.obj table.scene.json --unit mm
      hapscene convert duck.scene.json duck.png     # and its legend, duck.json
      hapscene convert wood wood.hjif
    """
    if target is not None and target.suffix.lower() == ".hjif":
        _export_swatch(source, target, replace)
        return
    check_scene(source, read)
    from hapscene.exchange import export_scene, import_scene, losses
    from hapscene.exchange.format_registry import format_of
    from hapscene.touch import open_scene, step

    target = target or Path(base_name(source) + (".glb" if source.endswith(SCENES) else ".scene.json"))
    name = "" if target.name.endswith(SCENES) else format_of(target)
    if not name and source.endswith(SCENES):
        raise SceneError(f"{source}: is a scene already; name a target of another type, as {base_name(source)}.glb")
    for file in (target, target.with_suffix(".json")) if name == "png" else (target,):
        if file.exists() and not replace:
            raise SaveConflict(f"{file}: is there already; take another name, or replace it (--replace)")
    with step(say, loading(source)):
        opened = open_scene if source.endswith(SCENES) else import_scene
        scene = opened(source, read.unit, **read.reading())
    if not name:
        _save(scene, source, target)
    elif name == "png":
        from hapscene.scene.uv_paint import body_with_uv, save_picture

        name_made(save_picture(scene, body_with_uv(scene, body), target))
    else:
        name_made(export_scene(scene, target, name, replace=replace))
        print("does not come back from this format: " + ("; ".join(losses(scene, name)) or "nothing is lost"))


def _save(scene: "Scene", source: str, target: Path) -> None:
    """Save a scene that was made of another file, and print how much of it is painted."""
    tell_size(scene, source)
    scene.save(target)
    name_made([target])
    faces = sum(len(body.mesh.faces) for body in scene.bodies)
    painted = sum(int((body.face_swatch != 0).sum()) for body in scene.bodies)
    bodies = "1 body" if len(scene.bodies) == 1 else f"{len(scene.bodies)} bodies"
    print(f"{bodies}, {painted:,} of {faces:,} faces painted: " + ", ".join(s.name for s in scene.swatches))


def _export_swatch(source: str, target: Path, replace: bool) -> None:
    """Write a swatch as MPEG haptics: its texture at 1 N and 0.1 m/s for two seconds, then its taps."""
    check_swatch(source)
    from hapscene.capture.io.hjif import export_hjif
    from hapscene.swatches.library import load_swatch

    if target.exists() and not replace:
        raise SaveConflict(f"{target}: is there already; take another name, or replace it (--replace)")
    export_hjif(load_swatch(source), str(target), force_N=1.0, speed_m_s=0.1, seconds=2.0)
    name_made([target])
