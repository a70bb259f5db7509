"""`hapscene touch` and `hapscene demo`."""

import argparse
from pathlib import Path
from typing import Any

from hapscene.command.word import add_command, folder, name_made, rate, seed
from hapscene.constants import ACCELERATION_RATE_HZ, TICK_S
from hapscene.errors import EffectError


def add_touch(commands: Any) -> None:
    command = add_command(
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
    command.add_argument("--out", required=True, type=folder, metavar="DIR", help="folder to write into")
    command.add_argument("--unit", help="of the mesh, where its file carries none: m, mm, in, …")
    command.add_argument("--swatch", help="of the whole mesh: a name, or a .swatch file")
    command.add_argument("--two-sided", action="store_true", help="feel the mesh's inner side as well")
    command.add_argument("--effects", metavar="A,B,…", help="effects to sum; `hapscene plugins` lists them")
    command.add_argument("--seed", type=seed, default=0, help="of what effects draw at random (default 0)")
    command.add_argument(
        "--rate",
        type=rate,
        default=ACCELERATION_RATE_HZ,
        metavar="HZ",
        help=f"of the acceleration channel (default {ACCELERATION_RATE_HZ:g})",
    )
    command.add_argument("--no-picture", action="store_true", help="leave scene.png out")


def _touch(options: argparse.Namespace) -> int:
    from hapscene.path import load_path
    from hapscene.touch import open_scene, speak, touch

    effects = None if options.effects is None else [name for name in options.effects.split(",") if name]
    if effects == []:
        raise EffectError("--effects names none; `hapscene plugins` lists them")
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
    name_made(made)
    return 0


def add_demo(commands: Any) -> None:
    command = add_command(
        commands,
        "demo",
        _demo,
        "touch the shipped scene: three bodies, four real surfaces, a hand that taps, presses and strokes",
        "hapscene demo",
    )
    command.add_argument("--out", default="out/demo", type=folder, metavar="DIR", help="folder (default out/demo)")


def _demo(options: argparse.Namespace) -> int:
    from importlib.resources import as_file, files

    from hapscene.gesture import explore
    from hapscene.touch import open_scene, speak, touch

    speak("loading the demo scene\n")
    with as_file(files("hapscene_assets")) as folder:
        scene = open_scene(folder / "demo.scene.json")
    path = explore(scene, TICK_S)
    name_made(touch(scene, options.out, path, title="demo.scene.json", say=speak))
    return 0
