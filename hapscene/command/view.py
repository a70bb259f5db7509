"""`hapscene view`."""

import argparse
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

from hapscene.command.console import name_made, say
from hapscene.command.options import (
    add_command,
    add_mesh_options,
    add_out_file,
    base_name,
    check_scene,
    check_there,
    find_asset,
    load_input,
    new_file,
    number,
    reading,
)
from hapscene.errors import ViewError

SIDE_MAX: Final = 4096
"""Longest side of a picture [pixels]: twice of it is what GL can draw everywhere."""

FILM_OPTIONS: Final = ("seconds", "turn")


def add_view(commands: Any) -> None:
    command = add_command(commands, "view", _view)
    command.add_argument(
        "scene", metavar="SCENE", help="a scene (.scene.json), a file that export wrote, a mesh, or an asset, as demo"
    )
    add_out_file(command, "FILE", "picture .png; film .gif, or .mp4 (extra `video`) (default NAME.png, as desk.png)")
    add_mesh_options(command, two_sided=False)
    command.add_argument("--touch", metavar="NPZ", help="a touch of it, touch.npz: path and forces; played in a film")
    command.add_argument("--size", type=size, metavar="WxH", help="in pixels, with the legend (films: 800x600)")
    shade = command.add_mutually_exclusive_group()
    shade.add_argument("--light", action="store_true", help="on a light background (default)")
    shade.add_argument("--dark", action="store_true", help="on a dark background")
    film = command.add_argument_group("films")
    film.add_argument(
        "--seconds",
        type=number("a film lasts a number of seconds", high=3600.0, above=0.0),
        help="how long (default: as the touch; without one 6)",
    )
    film.add_argument(
        "--turn",
        type=number("an angle is a number of degrees"),
        metavar="DEGREES",
        help="how far the camera goes around (default 360)",
    )


def _view(options: argparse.Namespace) -> int:
    """Draw a scene, and a touch of it, as a picture or a film.

    for example:
      hapscene view demo
      hapscene view desk.scene.json
      hapscene view bunny.ply --unit m --swatch wood --out bunny.gif --size 480x360 --dark
      hapscene view desk.scene.json --touch out/desk/touch.npz --turn 0 --out desk.mp4
    """
    options.scene, options.unit = find_asset(options.scene, options.unit)
    check_scene(options.scene, options.unit, options.swatch)
    check_there(options.touch, ViewError)
    options.out = options.out or new_file(f"{base_name(options.scene)}.png")

    import numpy as np

    from hapscene.files import check_file
    from hapscene.recording import Recording
    from hapscene.touch import step
    from hapscene.view.offscreen import started_ahead
    from hapscene.view.palette import DARK, LIGHT
    from hapscene.view.picture import RATES_HZ, Film, write_film, write_picture

    kind = Path(options.out).suffix.lower()
    if kind not in (".png", *RATES_HZ):
        raise ViewError(f"{options.out}: cannot tell what to draw; end its name with .png, .gif or .mp4")
    given = {name: getattr(options, name) for name in FILM_OPTIONS if getattr(options, name) is not None}
    if kind == ".png" and given:
        raise ViewError(f"{options.out}: is a picture; --{next(iter(given))} is for films, .gif and .mp4")
    check_file(Path(options.out), ViewError)
    theme = DARK if options.dark else LIGHT
    with ExitStack() as stack:
        stack.enter_context(started_ahead())
        scene = load_input(options.scene, options.unit, options.swatch, **reading(options))
        recording = None if options.touch is None else Recording.load(options.touch)
        stack.enter_context(step(say, f"drawing {options.out}"))
        if kind == ".png":
            write_picture(scene, recording, options.out, size=options.size, theme=theme)
        else:
            film = Film(
                size=options.size or Film.size,
                seconds=options.seconds,
                turn_rad=float(np.radians(given.get("turn", 360.0))),
                theme=theme,
            )
            write_film(scene, recording, options.out, film)
    name_made([Path(options.out)])
    return 0


def size(text: str) -> tuple[int, int]:
    """A size in pixels, as 800x600."""
    width, x, height = text.lower().partition("x")
    if not (x and width.isdecimal() and height.isdecimal()):
        raise argparse.ArgumentTypeError(f"a size is given as 800x600, not {text!r}")
    if not (160 <= int(width) <= SIDE_MAX and 160 <= int(height) <= SIDE_MAX):
        raise argparse.ArgumentTypeError(f"a side has 160 to {SIDE_MAX} pixels")
    return int(width), int(height)
