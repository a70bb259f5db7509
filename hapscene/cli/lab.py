"""`hapscene tune` and `hapscene lab`: what measures: fidelity, effects, stability, benchmarks, charts, the paper."""

import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

from cyclopts import App, Parameter
from cyclopts.validators import Number

from hapscene.cli.console import name_made, note, say, table, tell
from hapscene.cli.inputs import check_scene, find_asset, load_input, tell_size
from hapscene.cli.options import (
    Counts,
    Help,
    InFolder,
    MeshOptions,
    Names,
    Numbers,
    OutFile,
    OutFolder,
    Positive,
    Seed,
    Table,
    WorkerOptions,
)
from hapscene.constants import DEFAULT_GRIP
from hapscene.errors import HapsceneError

if TYPE_CHECKING:
    from hapscene.fidelity.tune import Tuned
    from hapscene.surface.swatch import Swatch

__all__ = ["app", "tune"]

WORDS = ("plugins", "effects", "stability", "study", "teleoperate", "bench", "chart", "reproduce", "warmup")
STUDY: Final = "Ask people what they can tell apart: a plan, a page to answer on, a report."
TELEOPERATE: Final = "Teleoperation over UDP: a follower touches a surface, a leader feels it."
app = App(name="lab", synonym=WORDS, help="Effects, stability, benchmarks, charts, studies, teleoperation.")
app.command("hapscene.cli.sessions:study", name="study", help=STUDY)
app.command("hapscene.cli.sessions:teleoperate", name="teleoperate", help=TELEOPERATE)

Docs = Annotated[
    Path | None, Parameter(metavar="FOLDER", help="Folder of result pages (docs/results) to update as well.")
]


@app.command
def effects() -> None:
    """List the effects: parameters, units, defaults, and where they come from.

    for example:
      hapscene lab effects
    """
    from hapscene.surface.effect_registry import listed

    for item in listed().values():
        lines = [f"{item.name}  ({item.distribution} {item.version}, {item.module})"]
        if item.plugin is None:
            tell([*lines, f"  cannot be used: {item.error}"])
            continue
        lines.append(f"  {item.plugin.summary}")
        if item.plugin.scope == "scene":
            more = "".join(f", {name}" for name in (*item.plugin.arrays, "bodies"))
            lines.append(f"  effect of the scene: settings={{{item.name!r}: {{…}}}} takes its parameters{more}")
        rows = [(f"  {param.name}", f"{param.default:g}", param.unit, param.meaning) for param in item.plugin.params]
        tell(lines + (table([("  parameter", "default", "unit", "meaning"), *rows]) if rows else []))
    print("\nA swatch may set these parameters; `hapscene swatch show NAME` lists them. All effects share its")
    print("stiffness_N_m. Set effects of the scene by Renderer(settings={…}), or by")
    print("`hapscene touch SCENE --effects wall,weight --set weight.mass_kg=0.2`.")


@app.command
def warmup(*, quick: Annotated[bool, Help("Compile only what a first touch needs")] = False) -> None:
    """Compile beforehand, so that no first use of a feature waits.

    for example:
      hapscene lab warmup
      hapscene lab warmup --quick
    """
    from hapscene.compiled.cache import cache_folder
    from hapscene.compiled.native import INTERPRETED
    from hapscene.warm_up import warm_up

    if INTERPRETED:
        raise HapsceneError("NUMBA_DISABLE_JIT=1 turns compiling off: unset it to compile")
    folder = cache_folder()
    if folder is None:
        raise HapsceneError("the cache cannot be written: set NUMBA_CACHE_DIR to a folder of yours")
    start_s = time.perf_counter()
    warm_up(quick)
    count = sum(1 for _ in folder.glob("*.nbc"))
    print(f"compiled {count} function{'' if count == 1 else 's'} to {folder}; {time.perf_counter() - start_s:.0f} s")


Rates = Annotated[Numbers, Parameter(validator=Number(gte=100.0, lte=100_000.0), show_default="1000,5000,10000")]
Delays = Annotated[Counts, Parameter(validator=Number(gte=0, lte=63), show_default="0,1")]


@app.command
def stability(
    *,
    device: Annotated[str, Help("Simulated device")] = "omni",
    rate: Annotated[Rates, Help("Rates of the force channel [Hz]")] = (1000.0, 5000.0, 10_000.0),
    delay: Annotated[Delays, Help("Delays of the loop [ticks]")] = (0, 1),
    scene: Annotated[str | None, Help("Scene whose swatches are placed (default: all known swatches)")] = None,
    grip: Annotated[str, Help("Grip of the hand: none, light, medium or firm")] = DEFAULT_GRIP,
    out: OutFolder = Path("out/stability"),
    workers: WorkerOptions = WorkerOptions(),
) -> None:
    """Plot the stability region of a device (Z-width), and list the swatches that would buzz.

    for example:
      hapscene lab stability --device omni --rate 1000,5000,10000 --delay 0,1
      hapscene lab stability --device premium-1.5 --scene demo.scene.json
    """
    from hapscene.device.sim.hand import grip_named
    from hapscene.stability.study import stability as run

    how = (device, rate, delay, grip_named(grip), _swatches(scene), say)
    name_made(run(out, *how, jobs=workers.jobs, scheduler=workers.scheduler))


def _swatches(scene: str | None) -> "list[Swatch]":
    """The swatches of a scene, or all that are known."""
    if scene is not None:
        return load_input(*find_asset(scene, MeshOptions())).swatches
    from hapscene.swatches.library import load_swatch, own_entries, shipped_swatches

    names = [*shipped_swatches(), *(entry.name for entry in own_entries())]
    return [load_swatch(name) for name in names]


ROUNDS: Final = 5
"""Rounds of a comparison with another checkout [count]."""


def check_evidence() -> None:
    """Raise where benchmarks and studies are missing: the wheel does not have them."""
    if find_spec("hapscene_evidence") is None:
        raise HapsceneError(
            "this needs the folder `evidence` of a checkout, which an installed package does not have: clone the "
            "repository and run `pip install -e .` in it"
        )


@app.command
def bench(
    *,
    out: OutFolder = Path("out/bench"),
    quick: Annotated[bool, Help("Measure fewer cases, in a third of the time")] = False,
    docs: Docs = None,
    table: Table = None,
    zoo: Annotated[InFolder | None, Help("Recorded paths and meshes to run as well")] = None,
    against: Annotated[InFolder | None, Help("Other checkout, whose tick and step are timed in turn")] = None,
) -> int:
    """Measure the time per tick on this machine.

    Exit codes: 0 done; 1 with --against, this checkout is slower by more than 3 %.

    for example:
      hapscene lab bench
      hapscene lab bench --quick --out out/quick
      hapscene lab bench --from out/bench/bench.csv --out out/again
      hapscene lab bench --against ../hapscene-before
    """
    check_evidence()
    from hapscene_evidence.bench.run import bench as run
    from hapscene_evidence.bench.run import bench_against

    if against is not None:
        return 0 if bench_against(against, ROUNDS) else 1
    run(out, quick, docs, zoo, table)
    return 0


@app.command
def chart(
    scene: Annotated[str | None, Help("Scene or mesh, where a question is about one")] = None,
    /,
    *,
    out: OutFolder = Path("out/chart"),
    only: Annotated[Names, Help("Names of the questions (default: all)")] = (),
    table: Table = None,
    docs: Docs = None,
) -> None:
    """Chart speed against accuracy: what each lever saves, at which error, and which setting to choose.

    chart.html shows a picture and a table of all levers, and every setting; chart.csv has the
    figures. Stop other programs first: no advice is given if they disturb the times.

    for example:
      hapscene lab chart
      hapscene lab chart scene.scene.json --only mesh,texture --out out/mine
      hapscene lab chart --from out/chart/chart.csv --out out/again
    """
    if scene is not None:
        check_scene(scene)
        scene = str(Path(scene).resolve())
    check_evidence()
    from hapscene_evidence.chart.run import chart as run

    run(out, scene, only=only, table=table, docs=docs, say=lambda text: tell([text]))


@app.command
def reproduce(
    *,
    recordings: Annotated[InFolder | None, Help("Recordings of the shipped swatches (default: synthesised)")] = None,
    out: OutFolder = Path("out/reproduce"),
    docs: Docs = None,
) -> None:
    """Reproduce the haptography paper: its figures and numbers beside those of hapscene, on one page.

    for example:
      hapscene lab reproduce
      hapscene lab reproduce --recordings recordings --out out/paper
    """
    check_evidence()
    from hapscene_evidence.paper.reproduction import reproduce as run

    name_made(run(str(out), recordings, say, docs))


# `hapscene tune`.


def tune(
    scene: Annotated[str, Help("Scene (.scene.json), painted scene of another format, mesh, or name of an asset")],
    /,
    *,
    out: Annotated[OutFile, Help("Fidelity file to write (default: NAME.fidelity.json beside the scene)")] = None,
    device: Annotated[str, Help("Device that it is felt with")] = "omni",
    handle: Annotated[str, Help("What vibrates: ideal, none, or a .handle file")] = "ideal",
    budget_us: Annotated[Positive, Help("Longest time that a tick may take [µs]")] = 50.0,
    jnd: Annotated[Positive, Help("Largest perceptible difference [just-noticeable differences]")] = 1.0,
    seed: Seed = 0,
    explain: Annotated[bool, Help("Print why each choice was made")] = False,
    mesh: MeshOptions = MeshOptions(),
) -> int:
    """Measure a scene on this machine, and render no more of it than a person can tell.

    Exit codes: 0 error and budget are kept; 1 one of them is exceeded.

    for example:
      hapscene tune demo.scene.json --explain
      hapscene tune bunny.ply --unit m --swatch wood -o bunny.fidelity.json
      hapscene touch demo.scene.json --fidelity demo.fidelity.json
    """
    scene, mesh = find_asset(scene, mesh)
    check_scene(scene, mesh)
    from hapscene.device.model import device_named
    from hapscene.fidelity.fidelity_file import check_scene_path, fidelity_beside, save_fidelity
    from hapscene.fidelity.trial import quietly
    from hapscene.fidelity.tune import reach_m_s2
    from hapscene.fidelity.tune import tune as run
    from hapscene.touch import is_model, open_scene

    if is_model(scene):
        raise HapsceneError(f"{scene}: a model of MuJoCo is not tuned; tune a scene of its meshes")
    out = out or fidelity_beside(scene)
    check_scene_path(out)
    device_named(device)
    reach_m_s2(handle)
    with quietly():
        loaded = open_scene(scene, mesh.unit, mesh.swatch, mesh.two_sided, **mesh.reading())
    tell_size(loaded, scene, device)
    found = run(loaded, device=device, handle=handle, budget_us=budget_us, jnd=jnd, seed=seed, say=say)
    save_fidelity(found.fidelity, out, loaded)
    tell(_report(found, explain))
    name_made([out])
    if not found.within_jnd:
        note(f"it feels {found.after['error_jnd']:.2g} JND different, and {jnd:g} were asked for")
    if not found.within_budget:
        note(f"the worst tick takes {found.after['tick_worst_us']:.3g} µs, and the budget is {budget_us:g}")
    return 0 if found.within_jnd and found.within_budget else 1


def _report(found: "Tuned", explain: bool) -> Iterator[str]:
    """The lines of a report: each choice, and the scene before and after."""
    from hapscene.fidelity.trial import REPEATS, WORST
    from hapscene.fidelity.tune import WITHIN

    errors = ["not touched" if c.error_jnd is None else f"{c.error_jnd:.2f} JND" for c in found.choices]
    rows = [(c.kind, c.name, c.what, error) for c, error in zip(found.choices, errors, strict=True)]
    for choice, line in zip(found.choices, table(rows), strict=True):
        yield line
        if explain:
            yield f"       {choice.why}"
    kinds = (
        *(("tick median", "tick_median_us", "µs", 1.0), ("tick p99", "tick_p99_us", "µs", 1.0)),
        *(("tick worst", "tick_worst_us", "µs", 1.0), ("memory", "memory_B", "MB", 1e-6)),
        *(("load", "load_s", "ms", 1e3), ("faces", "faces", "", 1.0)),
    )
    both = (found.before, found.after)
    figures = [
        (what, *(f"{each[name] * scale:.3g} {unit}".rstrip() for each in both)) for what, name, unit, scale in kinds
    ]
    yield from table([("the scene", "as it is", "tuned"), *figures])
    after = found.after
    yield (
        f"on paths not used to choose, it feels {after['error_jnd']:.2f} JND different or less in {WITHIN:g} % of the "
        f"ticks in contact: forces {after['force_jnd']:.2f}, vibrations {after['vibration_jnd']:.2f}"
    )
    runs = f"{REPEATS} runs, of {3 * REPEATS} where over the budget"
    yield f"worst: {WORST:g} % of the ticks in contact, each the least of {runs}"
