"""`hapscene stability`."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hapscene.command.console import name_made, say
from hapscene.command.options import (
    add_command,
    add_out_folder,
    add_workers,
    check_out_folder,
    check_scene,
    load_input,
    number,
    whole,
)
from hapscene.constants import DEFAULT_GRIP

if TYPE_CHECKING:
    from hapscene.surface.swatch import Swatch


RATE_MIN_HZ: Final = 100.0
"""Slowest force channel that is drawn [Hz]: below, a hand's own motion is no longer sampled."""

RATE_MAX_HZ: Final = 100_000.0
"""Fastest [Hz]: a tick of a microsecond or two would fill it."""


def add_stability(commands: Any) -> None:
    command = add_command(commands, "stability", _stability)
    command.add_argument("--device", default="omni", metavar="NAME", help="a device by name (default omni)")
    command.add_argument(
        "--rate",
        type=_rates,
        default=(1000.0, 5000.0, 10_000.0),
        metavar="HZ,…",
        help="of the force channel (default 1000,5000,10000)",
    )
    command.add_argument(
        "--delay", type=_delays, default=(0, 1), metavar="TICKS,…", help="of the loop, in ticks (default 0,1)"
    )
    command.add_argument("--scene", metavar="SCENE", help="place its swatches; else those shipped and in the library")
    command.add_argument(
        "--grip", default=DEFAULT_GRIP, metavar="NAME",
        help=f"of the hand: none, light, medium or firm (default {DEFAULT_GRIP})",
    )  # fmt: skip
    add_workers(command)
    add_out_folder(command, "out/stability")


def _stability(options: argparse.Namespace) -> int:
    """Draw the walls at which a device is still, and say which swatches would buzz.

    for example:
      hapscene stability --device omni --rate 1000,5000,10000 --delay 0,1
      hapscene stability --device premium-1.5 --scene demo.scene.json --grip firm --out out/premium
    """
    _check_read(options)
    from hapscene.device.hand import grip_named
    from hapscene.stability.study import stability

    grip = grip_named(options.grip)
    device = (options.device, options.rate, options.delay)
    swatches = _swatches(options.scene)
    workers = {"jobs": options.jobs, "scheduler": options.scheduler}
    made = stability(Path(options.out), *device, grip, swatches, say, **workers)
    name_made(made)
    return 0


def _check_read(options: argparse.Namespace) -> None:
    """Before minutes of work: the scene and the output folder."""
    if options.scene is not None:
        check_scene(options.scene)
    check_out_folder(options.out)


def _swatches(scene: str | None) -> "list[Swatch]":
    """Those of a scene, or all that are known."""
    if scene is not None:
        return load_input(scene).swatches
    from hapscene.swatches.library import load_swatch, own_entries, shipped_swatches

    names = [*shipped_swatches(), *(entry.name for entry in own_entries())]
    return [load_swatch(name) for name in names]


def _rates(text: str) -> tuple[float, ...]:
    """Rates in Hz, separated by commas, each once."""
    rate = number("a rate of the force channel is a number of Hz", RATE_MIN_HZ, RATE_MAX_HZ)
    return tuple(dict.fromkeys(rate(part) for part in _parts(text)))


def _delays(text: str) -> tuple[int, ...]:
    """Delays in ticks, separated by commas, each once."""
    from hapscene.device.model import DELAY_MAX

    delay = whole("a delay in ticks", 0, DELAY_MAX)
    return tuple(dict.fromkeys(delay(part) for part in _parts(text)))


def _parts(text: str) -> list[str]:
    parts = [part.strip() for part in text.split(",")]
    if not all(parts):
        raise argparse.ArgumentTypeError(f"expected numbers separated by commas, not {text!r}")
    return parts
