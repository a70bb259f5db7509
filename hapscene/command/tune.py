"""`hapscene tune`."""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hapscene.command.console import name_made, note, say, tell
from hapscene.command.options import add_command, add_mesh_options, check_scene, number, reading, seed, tell_size
from hapscene.errors import HapsceneError

if TYPE_CHECKING:
    from hapscene.fidelity.tune import Tuned


def add_tune(commands: Any) -> None:
    command = add_command(commands, "tune", _tune)
    command.add_argument("scene", metavar="SCENE", help="a scene (.scene.json), a file that export wrote, or a mesh")
    command.add_argument(
        "-o", "--out", metavar="FILE", help="fidelity file to write (default NAME.fidelity.json beside the scene)"
    )
    add_mesh_options(command)
    command.add_argument("--device", default="omni", metavar="NAME", help="it is felt with (default omni)")
    command.add_argument(
        "--handle", default="ideal", metavar="NAME",
        help="what vibrates: ideal (default), none, or an identified handle's .handle file",
    )  # fmt: skip
    command.add_argument(
        "--budget-us", type=number("a budget is a number of microseconds", above=0.0), default=50.0, metavar="US",
        help="most that the worst tick may take (default 50)",
    )  # fmt: skip
    command.add_argument(
        "--jnd", type=number("a difference is a number of JND", above=0.0), default=1.0, metavar="JND",
        help="most that it may feel different, in just-noticeable differences (default 1)",
    )  # fmt: skip
    command.add_argument("--seed", type=seed, default=0, help="of the paths that are felt (default 0)")
    command.add_argument("--explain", action="store_true", help="say why each choice was made")


def _tune(options: argparse.Namespace) -> int:
    """Measure a scene on this machine, and render no more of it than a person can tell.

    Exit codes: 0 error and budget are kept; 1 the error or the budget is exceeded.

    for example:
      hapscene tune demo.scene.json --explain
      hapscene tune bunny.ply --unit m --swatch wood -o bunny.fidelity.json
      hapscene touch demo.scene.json --fidelity demo.fidelity.json
    """
    check_scene(options.scene, options.unit, options.swatch)
    from hapscene.device.model import device_named
    from hapscene.fidelity.fidelity_file import check_place, fidelity_beside, save_fidelity
    from hapscene.fidelity.trial import quietly
    from hapscene.fidelity.tune import reach_m_s2, tune
    from hapscene.touch import is_model, open_scene

    if is_model(options.scene):
        raise HapsceneError(f"{options.scene}: a model of MuJoCo is not tuned; tune a scene of its meshes")
    out = Path(options.out) if options.out is not None else fidelity_beside(options.scene)
    check_place(out)
    device_named(options.device)
    reach_m_s2(options.handle)
    with quietly():
        scene = open_scene(options.scene, options.unit, options.swatch, options.two_sided, **reading(options))
    tell_size(scene, options.scene, options.device)
    words = ("device", "handle", "budget_us", "jnd", "seed")
    found = tune(scene, **{word: getattr(options, word) for word in words}, say=say)
    save_fidelity(found.fidelity, out, scene)
    tell(report(found, options.explain))
    name_made([out])
    if not found.within_jnd:
        note(f"it feels {found.after['error_jnd']:.2g} JND different, and {options.jnd:g} were asked for")
    if not found.within_budget:
        note(f"the worst tick takes {found.after['tick_worst_us']:.3g} µs, and the budget is {options.budget_us:g}")
    return 0 if found.within_jnd and found.within_budget else 1


def report(found: "Tuned", explain: bool) -> Iterator[str]:
    """The lines of a report: each choice, and the scene before and after."""
    from hapscene.fidelity.trial import REPEATS, WORST
    from hapscene.fidelity.tune import WITHIN

    width = max(len(choice.name) for choice in found.choices)
    what = max(len(choice.what) for choice in found.choices)
    for choice in found.choices:
        error = "not touched" if choice.error_jnd is None else f"{choice.error_jnd:.2f} JND"
        yield f"{choice.kind:<6} {choice.name:<{width}}  {choice.what:<{what}}  {error:>11}"
        if explain:
            yield f"       {choice.why}"
    before, after = found.before, found.after
    yield "the scene             as it is      tuned"
    for name, unit, scale in (
        ("tick_median_us", "µs", 1.0), ("tick_p99_us", "µs", 1.0), ("tick_worst_us", "µs", 1.0),
        ("memory_B", "MB", 1e-6), ("load_s", "ms", 1e3), ("faces", "", 1.0),
    ):  # fmt: skip
        label = name.rpartition("_")[0].replace("_", " ") or name
        was, now = (f"{v * scale:,.0f}" if name == "faces" else f"{v * scale:.3g}" for v in (before[name], after[name]))
        yield f"{label:<15} {was:>10} {unit:<2} {now:>9} {unit}".rstrip()
    yield (
        f"on paths not used to choose, it feels {after['error_jnd']:.2f} JND different or less in {WITHIN:g} % of the "
        f"ticks in contact: forces {after['force_jnd']:.2f}, vibrations {after['vibration_jnd']:.2f}"
    )
    runs = f"{REPEATS} runs, of {3 * REPEATS} where over the budget"
    yield f"worst: {WORST:g} % of the ticks in contact, each the least of {runs}"
