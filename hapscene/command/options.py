"""What the commands share: how one is declared, kinds of arguments, what is read and where results go by default."""

import argparse
import inspect
import json
import math
import os
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from difflib import get_close_matches
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

from hapscene.command.console import say, size_words
from hapscene.errors import HapsceneError, MeshError, SceneError, SwatchError

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

_Number = TypeVar("_Number", int, float)


def add_command(commands: Any, name: str, function: Callable[[argparse.Namespace], int]) -> argparse.ArgumentParser:
    """A sub-command whose help is its function's docstring: what it does, and examples as the last paragraph."""
    about, _, examples = (inspect.getdoc(function) or "").rpartition("\n\n")
    summary, gap, more = about.partition("\n\n")
    summary = " ".join(summary.split())
    command: argparse.ArgumentParser = commands.add_parser(
        name,
        help=f"{summary[:1].lower()}{summary[1:].removesuffix('.')}",
        description=summary + gap + more,
        epilog=examples,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(command=function)
    # also after the command's name, where it is typed when something went wrong
    command.add_argument("--debug", action="store_true", default=argparse.SUPPRESS, help=argparse.SUPPRESS)
    return command


def add_group(commands: Any, name: str, summary: str, *adds: Callable[[Any], None], metavar: str = "COMMAND") -> None:
    """A word that further words follow, each added by one of `adds`; alone it prints its help."""
    group: argparse.ArgumentParser = commands.add_parser(
        name, help=summary, description=f"{summary[0].upper()}{summary[1:]}."
    )
    group.epilog = f"{group.prog} {metavar} --help says more."
    group.set_defaults(command=lambda options: print_help(group))
    words = group.add_subparsers(metavar=metavar)
    for add in adds:
        add(words)


def print_help(parser: argparse.ArgumentParser) -> int:
    """What a word does that needs another one after it."""
    parser.print_help()
    return 0


HOST: Final = "127.0.0.1"
"""This machine alone: where what can be reached over a network listens unless told otherwise."""

# What is read: a file that is there, a mesh whose unit is known. Asked for before anything else is done or imported.


UNIT_HELP: Final = "of the mesh, where its file carries none: m, mm, in, …"

UNITLESS: Final = ("stl", "obj", "ply", "off")  # as in scene.mesh_file, which is heavy to import
UNITS: Final = ("m", "cm", "mm", "um", "in", "ft")  # as in scene.mesh

STEM_NEAR: Final = 0.75
"""How alike a file's name up to its first dot is to the one that was typed, to be suggested: difflib's ratio [1]. Names
of one suffix are alike already: none.scene.json does not mean demo.scene.json."""

NAME_MAX: Final = 10_000
"""Most files of a folder that are held against the name that was typed [count]."""


def add_reading_options(command: Any) -> None:
    """How a mesh file is read."""
    command.add_argument("--unit", help=UNIT_HELP)
    command.add_argument(
        "--up", choices=["y", "z"], help="axis that is up in the mesh's file (default: y in glTF, z in all others)"
    )
    command.add_argument(
        "--scale",
        type=number("a scale is a number", above=0.0),
        default=1.0,
        metavar="FACTOR",
        help="how much larger to make the mesh, as 0.1 (default 1)",
    )
    command.add_argument(
        "--accept-damaged",
        action="store_true",
        help="take what can be read of a damaged STEP file; what is missing is told",
    )


def add_mesh_options(command: Any, two_sided: bool = True) -> None:
    """How a mesh on the command line is taken up."""
    add_reading_options(command)
    command.add_argument("--swatch", help="of the whole mesh: a name, or a .swatch file")
    if two_sided:
        command.add_argument("--two-sided", action="store_true", help="feel the mesh's inner side as well")


def reading(options: argparse.Namespace) -> dict[str, Any]:
    """What `add_reading_options` found, beside the unit, for who opens a file."""
    return {name: getattr(options, name) for name in ("up", "scale", "accept_damaged")}


def check_evidence(command: str) -> None:
    """Check that the benchmarks and studies are installed, which the wheel does not contain.

    Raises:
        HapsceneError: they are not.
    """
    if find_spec("hapscene_evidence") is None:
        raise HapsceneError(
            f"hapscene {command} needs the folder `evidence` of a checkout, which an installed package does not have: "
            "clone the repository and run `pip install -e .` in it"
        )


def check_there(
    path: str | Path | None, error: type[HapsceneError] = HapsceneError, what: str = "file", prefix: str = ""
) -> None:
    """Refuse with `error`, in the same words whatever is read, a path that leads to no `what`; None is no path.

    Args:
        path: where it should be.
        error: what the command's room raises.
        what: "file", "folder", or "file or folder".
        prefix: what stands before the path in the message, as "--docs ".
    """
    if path is None:
        return
    path = Path(path)
    if path.is_dir():
        if "folder" not in what:
            raise error(f"{prefix}{path}: is a folder; expected a {what}")
    elif not path.exists():
        place = path.parent
        if not place.is_dir():
            raise error(f"{prefix}{path}: no such {what}: there is no folder {place}")
        stem = path.name.split(".")[0]
        names = [name for name in islice(_names(place), NAME_MAX) if nearest(stem, [name.split(".")[0]], STEM_NEAR)]
        near = nearest(path.name, set(names) - {path.name})  # which a link that leads nowhere has
        raise error(f"{prefix}{path}: no such {what}" + (f"; did you mean {path.with_name(near)}?" if near else ""))
    elif not path.is_file():
        raise error(f"{prefix}{path}: is no {what}: what is sent through it is not waited for")
    elif what == "folder":
        raise error(f"{prefix}{path}: is a file; expected a folder")


def _names(folder: Path) -> Iterable[str]:
    with suppress(OSError):  # a folder that may not be listed
        yield from (file.name for file in folder.iterdir() if not file.name.startswith("."))


def nearest(word: str, known: Iterable[str], alike: float = 0.6) -> str | None:
    """The one that may have been meant: the most alike, from that ratio of difflib on."""
    return next(iter(get_close_matches(word, list(known), 1, alike)), None)


def find_asset(scene: str, unit: str | None) -> tuple[str, str | None]:
    """A scene or mesh and its unit; where `scene` is the name of an asset, and no file, the asset's file and unit.

    Raises:
        SceneError: it is a bare name, and there is neither a file nor an asset of this name.
    """
    if Path(scene).suffix or Path(scene).name != scene or Path(scene).exists():
        return scene, unit
    from hapscene import assets

    try:
        return str(assets.path(scene)), unit or assets.unit(scene)
    except SceneError as unknown:
        try:
            check_there(scene, SceneError)
        except SceneError as error:
            raise SceneError(f"{error}; {unknown}") from None
        raise


def check_swatch(name: str | None) -> None:
    """Refuse what is a .swatch file by its name, and is not there; other names are looked up later."""
    if name is not None and (name.endswith(".swatch") or "/" in name or os.sep in name):
        check_there(name, SwatchError)


def check_scene(path: str, unit: str | None = None, swatch: str | None = None) -> None:
    """Refuse a scene or mesh that is not there, or whose file says no unit where none was given."""
    check_there(path, SceneError)
    suffix = Path(path).suffix.lower().lstrip(".")
    if unit is not None:
        if unit not in UNITS:
            from hapscene.scene.mesh import unit_name

            unit_name(unit)
    elif suffix in UNITLESS and not _is_painted(path, suffix):
        raise MeshError(
            f"{path}: {suffix.upper()} files carry no unit of length: say which one its numbers are in, as --unit mm; "
            f"known are {', '.join(UNITS)}"
        )
    check_swatch(swatch)
    if swatch is not None:
        from hapscene.swatches.library import load_swatch

        load_swatch(swatch)  # a mesh may take a while to load


def _is_painted(path: str, suffix: str) -> bool:
    """Whether a PLY is a painted scene of ours, which says its unit."""
    if suffix != "ply":
        return False
    with Path(path).open("rb") as file:
        return b"comment hapscene" in file.read(4096)


def tell_size(scene: "Scene", path: str, device: str = "omni") -> None:
    """Say of a scene that was opened, where its size is none for a hand and a device, what mends it; else nothing."""
    from hapscene.scene.size_advice import size_advice

    files = {body.mesh.path for body in scene.bodies}
    of_meshes = len(files) == len(scene.bodies) and not path.endswith((".scene.json", ".scene.zip"))
    for what in [body.mesh for body in scene.bodies] if of_meshes else [scene]:
        if words := size_advice(what, device).words:
            say(f"{words}\n")


def load_input(
    path: str,
    unit: str | None = None,
    swatch: str | None = None,
    two_sided: bool = False,
    device: str = "omni",
    **read: Any,
) -> "Scene":
    """A scene from its file or around a mesh, told while it is loaded; `read` is what `reading` gives.

    Where it has no size for a hand and a device, that is told too.

    Raises:
        HapsceneError: it is not there, or cannot be loaded.
    """
    check_scene(path, unit, swatch)
    from hapscene.touch import open_scene, step

    with step(say, loading(path)):
        scene = open_scene(path, unit, swatch, two_sided, say, **read)
    tell_size(scene, path, device)
    return scene


def loading(path: str | Path) -> str:
    """What is said while a file is loaded: "loading bunny.stl (65.5 MB)"."""
    return f"loading {path} ({size_words(Path(path).stat().st_size)})"


# Where results go unless it is said: into out/NAME, or into a file of this folder that is not there yet.


def add_workers(command: Any) -> None:
    """Processes here, or on a cluster."""
    command.add_argument(
        "--jobs", type=whole("a number of processes", 1), metavar="N", help="processes here (default: one per core)"
    )
    command.add_argument("--scheduler", metavar="ADDRESS", help="work on a Dask cluster instead: tcp://host:8786")


def add_out_folder(command: Any, default: str | None, told: str = "") -> None:
    """Adds --out, a folder; a default that depends on what is read is None, and told in words."""
    command.add_argument(
        "-o", "--out", type=folder, default=default, metavar="DIR",
        help=f"folder to write into (default {told or default})",
    )  # fmt: skip


def add_out_file(command: Any, metavar: str, told: str) -> None:
    """Adds --out, a file; None where it is not given."""
    command.add_argument("-o", "--out", metavar=metavar, help=told)


def check_out_folder(path: str) -> None:
    """Refuse, before the work is done, a folder to write into that is a file."""
    if Path(path).is_file():
        raise HapsceneError(f"{path}: is a file; expected a folder, or a name that is free")


def base_name(path: str | Path) -> str:
    """The name of what a file holds, "bunny" of meshes/bunny.ply and of bunny.scene.json."""
    name = Path(path).name
    end = next((end for end in (".scene.json", ".scene.zip") if name.endswith(end)), None)
    return name.removesuffix(end) if end else Path(path).stem


def new_file(name: str, option: str = "--out") -> str:
    """The file that is written where none was named: one that is not there yet.

    Raises:
        HapsceneError: it is there.
    """
    if Path(name).exists():
        raise HapsceneError(f"{name}: is there already; {option} {name} takes its place, another name keeps it")
    return name


# Kinds of arguments.


def folder(text: str) -> str:
    """A folder to write into: its name may not be empty."""
    if not text.strip():
        raise argparse.ArgumentTypeError("a folder needs a name")
    return text


def whole(what: str, low: int | None = None, high: int | None = None) -> Callable[[str], int]:
    """A kind of argument: a whole number within bounds, where there are any.

    Args:
        what: it is, for who typed something else: "a port".
        low, high: the least and the largest.
    """
    return _kind(f"{what} is a whole number", int, low, high, None)


def number(
    told: str, low: float | None = None, high: float | None = None, above: float | None = None
) -> Callable[[str], float]:
    """A kind of argument: a finite number within bounds, where there are any.

    Args:
        told: what it is, for who typed something else: "a rate is a number of Hz".
        low, high: the least and the largest.
        above: what it must exceed.
    """
    return _kind(told, float, low, high, above)


def _kind(
    told: str, read: Callable[[str], _Number], low: float | None, high: float | None, above: float | None
) -> Callable[[str], _Number]:
    if low is not None and high is not None:
        told += f" from {low:.10g} to {high:.10g}"
    else:
        bounds = {"{:.10g} or more": low, "above {:.10g}": above, "at most {:.10g}": high}
        said = [text.format(bound) for text, bound in bounds.items() if bound is not None]
        told += f", {' and '.join(said)}" if said else ""
    least, most = -math.inf if low is None else low, math.inf if high is None else high
    more_than = -math.inf if above is None else above

    def value_of(text: str) -> _Number:
        with suppress(ValueError):
            value = read(text)
            if least <= value <= most and more_than < value < math.inf:
                return value
        raise argparse.ArgumentTypeError(f"{told}, not {text[:40]!r}")

    return value_of


baud = whole("a port's speed in bits a second", 1)
port = whole("a port", 0, 65535)
seed = whole("a seed", 0)
force = number("a force is a number of N")
rate = number("a rate is a number of Hz", above=0.0)
seconds = number("a duration is a number of seconds", above=0.0)


def setting(text: str) -> tuple[str, str, Any]:
    """An effect's setting as in "weight.mass_kg=0.2" or "guide.points_m=[[0, 0, 0.1]]": effect, name, value."""
    where, equals, value = text.partition("=")
    effect, dot, name = where.strip().partition(".")
    if not (effect and dot and name and equals and value.strip()):
        raise argparse.ArgumentTypeError(f"{text[:40]!r}: expected EFFECT.NAME=VALUE, as in weight.mass_kg=0.2")
    with suppress(ValueError, RecursionError):
        return effect, name, json.loads(value)
    return effect, name, value.strip()  # the name of a body


# The options that say what a recording file does not: its rate, its columns, its units.


def add_recording_options(command: argparse.ArgumentParser) -> None:
    """Adds --rate, --columns and --units; they end up as `rate`, `columns` and `units` of the options."""
    group = command.add_argument_group("what a recording's file does not state")
    group.add_argument("--rate", type=rate, metavar="HZ", help="sample rate [Hz]")
    group.add_argument(
        "--columns", type=pairs, default={}, metavar="Q=COLUMN,…",
        help="which column holds which quantity, as in acceleration=accel,speed=v",
    )  # fmt: skip
    group.add_argument(
        "--units", type=pairs, default={}, metavar="Q=UNIT,…",
        help="units of the quantities, as in acceleration=g,force=N,speed=mm/s",
    )  # fmt: skip


def rates(text: str) -> list[float]:
    """Rates as in "10000,1000"."""
    return [rate(part) for part in text.split(",")]


def pairs(text: str) -> Mapping[str, str]:
    """Pairs as in "force=N,speed=mm/s"."""
    found: dict[str, str] = {}
    for item in text.split(","):
        key, equals, value = item.partition("=")
        if not (equals and key.strip() and value.strip()):
            raise argparse.ArgumentTypeError(f"{item!r}: expected QUANTITY=VALUE pairs, as in force=N,speed=mm/s")
        if key.strip() in found:
            raise argparse.ArgumentTypeError(f"{key.strip()!r} stands twice")
        found[key.strip()] = value.strip()
    return found


def vector(text: str) -> tuple[float, float, float]:
    """Three numbers as in "0,0.1,0.02"."""
    try:
        x, y, z = map(float, text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: expected three numbers, as in 0,0.1,0.02") from None
    if not all(map(math.isfinite, (x, y, z))):
        raise argparse.ArgumentTypeError(f"{text!r}: expected finite numbers")
    return x, y, z


def add_pairs(command: Any, name: str, told: str) -> None:
    """Adds an option that takes KEY=VALUE, any number of times."""
    command.add_argument(name, type=key_value, action="append", default=[], metavar="KEY=VALUE", help=told)


def key_value(text: str) -> tuple[str, str]:
    """An option of a plugin as in "firmware=falcon.bin"."""
    key, equals, value = text.partition("=")
    if not (key and equals):
        raise argparse.ArgumentTypeError(f"{text!r}: expected KEY=VALUE, as in firmware=falcon.bin")
    return key, value


def recording_options(options: argparse.Namespace) -> dict[str, Any]:
    """What `load_recording` takes of them."""
    return {"rate_Hz": options.rate, "columns": options.columns, "units": options.units}
