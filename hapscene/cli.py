"""The command line: reads the words, calls the room that does the work, prints what it gives. Thin."""

import argparse
import json
import os
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hapscene import __version__
from hapscene.constants import ACCELERATION_RATE_HZ, TICK_S
from hapscene.errors import HapsceneError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return the exit code: 0 done, 2 bad input (one line on stderr), 130 interrupted."""
    _speak_utf8()
    options = _parser().parse_args(arguments)
    warnings.showwarning = _show_warning
    try:
        code: int = options.command(options)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        if options.debug:
            raise
        print("hapscene: interrupted; nothing was written", file=sys.stderr)
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the reader left: say no more
        return 1
    except (HapsceneError, OSError, MemoryError) as error:
        if options.debug:
            raise
        print(f"hapscene: {_sentence(error)}", file=sys.stderr)
        return 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="hapscene",
        description="Haptic rendering with a 3-D scene.",
        epilog="hapscene COMMAND --help says more.",
    )
    parser.add_argument("--version", action="version", version=f"hapscene {__version__}")
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for add in (_add_touch, _add_demo, _add_check, _add_plugins, _add_bench):
        add(commands)
    return parser


def _add_touch(commands: Any) -> None:
    command = _command(
        commands,
        "touch",
        _touch,
        "touch a scene or a mesh along a path, and write what was felt",
        "hapscene touch demo.scene.json --path hand.csv --out out/touch",
        "hapscene touch bunny.ply --unit m --swatch wood --out out/bunny",
    )
    command.add_argument("scene", metavar="SCENE", help="a scene file (.scene.json), or a mesh file")
    command.add_argument(
        "--path",
        metavar="CSV",
        help="path of the tool: columns t,x,y,z in s and m; else a hand feels it from above",
    )
    command.add_argument("--out", required=True, metavar="DIR", help="folder to write into")
    command.add_argument("--unit", help="of the mesh, where its file carries none: m, mm, in, …")
    command.add_argument("--swatch", help="of the whole mesh: a name, or a .swatch file")
    command.add_argument("--two-sided", action="store_true", help="feel the mesh's inner side as well")
    command.add_argument("--effects", metavar="A,B,…", help="effects to sum; `hapscene plugins` lists them")
    command.add_argument("--seed", type=_seed, default=0, help="of what effects draw at random (default 0)")
    command.add_argument(
        "--rate",
        type=_rate,
        default=ACCELERATION_RATE_HZ,
        metavar="HZ",
        help=f"of the acceleration channel (default {ACCELERATION_RATE_HZ:g})",
    )
    command.add_argument("--no-picture", action="store_true", help="leave scene.png out")


def _touch(options: argparse.Namespace) -> int:
    from hapscene.path import load_path
    from hapscene.touch import open_scene, speak, touch

    effects = None if options.effects is None else [name for name in options.effects.split(",") if name]
    t_s, p_WT = (None, None) if options.path is None else load_path(options.path, TICK_S)
    speak(f"loading {options.scene}\n")
    scene = open_scene(options.scene, options.unit, options.swatch, options.two_sided)
    if p_WT is None:
        from hapscene.gesture import explore

        speak("no --path: a hand feels it from above\n")
        p_WT = explore(scene, TICK_S)
    made = touch(
        scene,
        options.out,
        p_WT,
        t_s=t_s,
        effects=effects,
        seed=options.seed,
        a_rate_Hz=options.rate,
        title=Path(options.scene).name,
        with_picture=not options.no_picture,
        say=speak,
    )
    _name_made(made)
    return 0


def _add_demo(commands: Any) -> None:
    command = _command(
        commands,
        "demo",
        _demo,
        "touch the shipped scene: three bodies, four real surfaces, a hand that taps, presses and strokes",
        "hapscene demo",
    )
    command.add_argument("--out", default="out/demo", metavar="DIR", help="folder to write into (default out/demo)")


def _demo(options: argparse.Namespace) -> int:
    from importlib.resources import as_file, files

    from hapscene.gesture import explore
    from hapscene.touch import open_scene, speak, touch

    speak("loading the demo scene\n")
    with as_file(files("hapscene_assets")) as folder:
        scene = open_scene(folder / "demo.scene.json")
    path = explore(scene, TICK_S)
    _name_made(touch(scene, options.out, path, title="demo.scene.json", say=speak))
    return 0


def _add_check(commands: Any) -> None:
    command = _command(
        commands,
        "check",
        _check,
        "examine a mesh: what is wrong with it, and what that means for touching it",
        "hapscene check part.stl --unit mm",
        "hapscene check part.stl --unit mm --fix part_mended.ply",
    )
    command.add_argument("mesh", metavar="MESH", help="a mesh file")
    command.add_argument("--unit", help="of the mesh, where its file carries none: m, mm, in, …")
    command.add_argument("--json", action="store_true", help="print JSON")
    command.add_argument("--fix", metavar="OUT", help="mend what can be mended safely, and write it here")


def _check(options: argparse.Namespace) -> int:
    from hapscene.scene.doctor import examine
    from hapscene.scene.mesh import load_mesh

    mesh = load_mesh(options.mesh, options.unit)
    report = examine(mesh)
    done: list[str] = []
    if options.fix is not None:
        from hapscene.scene.mend import mend
        from hapscene.scene.ply import write_mesh

        mended, done = mend(mesh)
        write_mesh(mended, options.fix)
    if options.json:
        fixed = {} if options.fix is None else {"fixed": done, "written": options.fix}
        print(json.dumps(json.loads(report.to_json()) | fixed, indent=2, ensure_ascii=False))
        return 0
    print(report.text())
    if options.fix is not None:
        print("", *(f"mended: {line}" for line in done or ["nothing needed it"]), sep="\n")
        print(f"made:\n  {options.fix}  (in metres)")
    return 0


def _add_plugins(commands: Any) -> None:
    command = _command(
        commands,
        "plugins",
        _plugins,
        "list the effects there are: parameters, units, defaults, and where they come from",
        "hapscene plugins --json",
    )
    command.add_argument("--json", action="store_true", help="print JSON")


def _plugins(options: argparse.Namespace) -> int:
    from hapscene.surface.registry import listed

    effects = listed()
    if options.json:
        print(json.dumps([_described(item) for item in effects.values()], indent=2, ensure_ascii=False))
        return 0
    for item in effects.values():
        print(f"{item.name}  ({item.distribution} {item.version}, {item.module})")
        if item.effect is None:
            print(f"  cannot be used: {item.error}")
            continue
        print(f"  {item.effect.summary}")
        for param in item.effect.params:
            print(f"  {param.name:<24} {param.default:<8g} {param.unit:<8} {param.meaning}")
    if not effects:
        print("no effect is installed: is hapscene itself installed?")
    return 0


def _described(item: Any) -> dict[str, Any]:
    """One effect as JSON; a bound that is infinite is null."""
    described = {
        "name": item.name,
        "distribution": item.distribution,
        "version": item.version,
        "module": item.module,
        "error": item.error,
    }
    if item.effect is not None:
        described["summary"] = item.effect.summary
        described["parameters"] = [
            {
                "name": param.name,
                "unit": param.unit,
                "default": param.default,
                "minimum": param.minimum if abs(param.minimum) != float("inf") else None,
                "maximum": param.maximum if abs(param.maximum) != float("inf") else None,
                "meaning": param.meaning,
            }
            for param in item.effect.params
        ]
    return described


def _add_bench(commands: Any) -> None:
    command = _command(
        commands,
        "bench",
        _bench,
        "measure the time per tick on this machine",
        "hapscene bench --out out/bench",
    )
    command.add_argument("--out", default="out/bench", metavar="DIR", help="folder to write into (default out/bench)")
    command.add_argument("--quick", action="store_true", help="fewer cases, in a quarter of the time")


def _bench(options: argparse.Namespace) -> int:
    from hapscene.bench.run import bench

    bench(Path(options.out), options.quick)
    return 0


def _command(commands: Any, name: str, function: Any, summary: str, *examples: str) -> argparse.ArgumentParser:
    """A sub-command whose help ends with examples."""
    command: argparse.ArgumentParser = commands.add_parser(
        name,
        help=summary,
        description=f"{summary[0].upper()}{summary[1:]}.",
        epilog="for example:\n" + "\n".join(f"  {example}" for example in examples),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(command=function)
    # also after the command's name, where it is typed when something went wrong
    command.add_argument("--debug", action="store_true", default=argparse.SUPPRESS, help=argparse.SUPPRESS)
    return command


def _seed(text: str) -> int:
    seed = int(text)
    if seed < 0:
        raise argparse.ArgumentTypeError("a seed is a whole number, 0 or more")
    return seed


def _rate(text: str) -> float:
    rate_Hz = float(text)
    if not 0.0 < rate_Hz < float("inf"):
        raise argparse.ArgumentTypeError("a rate is a number of Hz, above 0")
    return rate_Hz


def _name_made(made: list[Path]) -> None:
    print("made:")
    for file in made:
        print(f"  {file}  ({file.stat().st_size / 1e3:,.0f} kB)")


def _sentence(error: BaseException) -> str:
    """The error in one line."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    if isinstance(error, MemoryError):
        return f"not enough memory ({error})" if str(error) else "not enough memory"
    return " ".join(str(error).split())


def _show_warning(message: Warning | str, category: Any, *place: Any, **more: Any) -> None:
    """A warning in one line, without the place in our code."""
    print(f"hapscene: note: {' '.join(str(message).split())}", file=sys.stderr)


def _speak_utf8() -> None:
    """Units and dashes must not fail on a terminal or pipe of another encoding."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(encoding="utf-8", errors="replace")


if __name__ == "__main__":
    sys.exit(main())
