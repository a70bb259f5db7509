"""`hapscene tune` and `hapscene lab`: fidelity, effects, stability, user studies, benchmarks, charts, the paper."""

import time
from collections.abc import Iterator
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

from cyclopts import App, Parameter
from cyclopts.validators import Number

from hapscene.cli.console import print_files, print_lines, print_note, print_progress, table
from hapscene.cli.inputs import base_name, check_scene, find_asset, load_input, new_file, print_size_advice
from hapscene.cli.options import (
    Counts,
    Help,
    InFile,
    InFolder,
    MeshOptions,
    Names,
    Numbers,
    OutFile,
    OutFolder,
    OutputOptions,
    PageOptions,
    Positive,
    Table,
    WorkerOptions,
)
from hapscene.constants import DEFAULT_GRIP
from hapscene.errors import HapsceneError, SaveConflict, StudyError
from hapscene.interrupt import interrupt_noted

if TYPE_CHECKING:
    from hapscene.fidelity.tune import Tuned
    from hapscene.study.plan import Plan
    from hapscene.study.session import Session
    from hapscene.study.stimulus import OutputPlayer
    from hapscene.surface.swatch import Swatch

__all__ = ["app", "tune"]

WORDS = ("plugins", "effects", "stability", "study", "bench", "chart", "reproduce", "warmup")
app = App(name="lab", synonym=WORDS, help="Stability, benchmarks, user studies, effects.")
study = App(name="study", help="User studies of perception: run a session, write a report.")
app.command(study)

Docs = Annotated[
    Path | None, Parameter(metavar="FOLDER", help="Folder of result pages (docs/results) to update as well.")
]


@app.command
def effects() -> None:
    """List the installed effects with their parameters, units and defaults.

    examples:
      hapscene lab effects
    """
    from hapscene.surface.effect import EFFECTS

    for item in EFFECTS.listed().values():
        lines = [f"{item.name}  ({item.distribution} {item.version}, {item.module})"]
        if item.plugin is None:
            print_lines([*lines, f"  cannot be loaded: {item.error}"])
            continue
        lines.append(f"  {item.plugin.summary}")
        if item.plugin.scope == "scene":
            more = "".join(f", {name}" for name in (*item.plugin.arrays, "bodies"))
            lines.append(f"  scene effect: settings={{{item.name!r}: {{…}}}} sets its parameters{more}")
        rows = [(f"  {param.name}", f"{param.default:g}", param.unit, param.meaning) for param in item.plugin.params]
        print_lines(lines + (table([("  parameter", "default", "unit", "meaning"), *rows]) if rows else []))
    print("\nA swatch can set the parameters of effects that act at contacts (`hapscene swatch show NAME`). Set the")
    print("parameters of a scene effect by Renderer(settings={…}), or on the command line:")
    print("`hapscene touch SCENE --effects wall,weight --set weight.mass_kg=0.2`.")


@app.command
def warmup() -> None:
    """Compile all functions in advance, so that later commands start without delay.

    examples:
      hapscene lab warmup
    """
    from hapscene.compiled.cache import cache_folder
    from hapscene.compiled.native import INTERPRETED
    from hapscene.warm_up import warm_up

    if INTERPRETED:
        raise HapsceneError("NUMBA_DISABLE_JIT=1 disables compilation; unset this environment variable")
    folder = cache_folder()
    if folder is None:
        raise HapsceneError("no folder for the compilation cache is writable; set NUMBA_CACHE_DIR to a writable folder")
    start_s = time.perf_counter()
    warm_up()
    count = sum(1 for _ in folder.glob("*.nbc"))
    print(f"compiled {count} function{'' if count == 1 else 's'} to {folder}; {time.perf_counter() - start_s:.0f} s")


Rates = Annotated[Numbers, Parameter(validator=Number(gte=100.0, lte=100_000.0), show_default="1000,5000,10000")]
Delays = Annotated[Counts, Parameter(validator=Number(gte=0, lte=63), show_default="0,1")]


@app.command
def stability(
    *,
    device: Annotated[str, Help("Simulated device")] = "omni",
    rate: Annotated[Rates, Help("Rates of the haptic tick [Hz]")] = (1000.0, 5000.0, 10_000.0),
    delay: Annotated[Delays, Help("Delays of the force [ticks]")] = (0, 1),
    scene: Annotated[str | None, Help("Scene whose swatches are tested (default: all known swatches)")] = None,
    grip: Annotated[str, Help("Grip of the hand: none, light, medium or firm")] = DEFAULT_GRIP,
    out: OutFolder = Path("out/stability"),
    workers: WorkerOptions = WorkerOptions(),
) -> None:
    """Plot the stability region (Z-width) of a device, and list the swatches that are unstable on it.

    For each rate and delay, virtual walls of increasing stiffness and damping are
    touched in simulation; the region is where the device comes to rest.

    examples:
      hapscene lab stability --device omni --rate 1000,5000,10000 --delay 0,1
      hapscene lab stability --device premium-1.5 --scene demo.scene.json
    """
    from hapscene.device.sim.hand import grip_named
    from hapscene.stability.study import stability as run

    how = (device, rate, delay, grip_named(grip), _swatches(scene), print_progress)
    print_files(run(out, *how, jobs=workers.jobs, scheduler=workers.scheduler))


def _swatches(scene: str | None) -> "list[Swatch]":
    """The swatches of a scene; without one, all shipped swatches and those of the library."""
    if scene is not None:
        return load_input(*find_asset(scene, MeshOptions())).swatches
    from hapscene.swatches.library import load_swatch, own_entries, shipped_swatches

    names = [*shipped_swatches(), *(entry.name for entry in own_entries())]
    return [load_swatch(name) for name in names]


ROUNDS: Final = 5
"""Rounds of a comparison with another checkout [count]."""


def check_evidence() -> None:
    """Raise HapsceneError if the benchmarks are not installed: they are part of the repository, not of the wheel."""
    if find_spec("hapscene_evidence") is None:
        raise HapsceneError("the benchmarks are not installed: clone the repository, and run `pip install -e .` in it")


@app.command
def bench(
    *,
    out: OutFolder = Path("out/bench"),
    quick: Annotated[bool, Help("Measure fewer cases, in a third of the time")] = False,
    docs: Docs = None,
    table: Table = None,
    against: Annotated[InFolder | None, Help("Another checkout to compare with, measured alternately")] = None,
) -> int:
    """Measure the computing time of a haptic tick on this machine.

    Exit codes: 0 success; 1 with --against, this checkout is more than 3 % slower.

    examples:
      hapscene lab bench
      hapscene lab bench --quick --out out/quick
      hapscene lab bench --from out/bench/bench.csv --out out/again
    """
    check_evidence()
    from hapscene_evidence.bench.run import bench as run
    from hapscene_evidence.bench.run import bench_against

    if against is not None:
        return 0 if bench_against(against, ROUNDS) else 1
    run(out, quick, docs, table)
    return 0


@app.command
def chart(
    scene: Annotated[str | None, Help("Scene or mesh to measure, for the questions about a scene")] = None,
    /,
    *,
    out: OutFolder = Path("out/chart"),
    only: Annotated[Names, Help("Names of the questions to answer (default: all)")] = (),
    table: Table = None,
    docs: Docs = None,
) -> None:
    """Chart speed against accuracy: what each lever saves, at which error, and which setting to choose.

    chart.html shows a picture and a table of all levers, and every setting;
    chart.csv has the figures. Stop other programs first: no advice is given if
    they disturb the times.

    examples:
      hapscene lab chart
      hapscene lab chart scene.scene.json --only mesh,texture --out out/mine
      hapscene lab chart --from out/chart/chart.csv --out out/again
    """
    if scene is not None:
        check_scene(scene)
        scene = str(Path(scene).resolve())
    check_evidence()
    from hapscene_evidence.chart.run import chart as run

    run(out, scene, only=only, table=table, docs=docs, say=lambda text: print_lines([text]))


@app.command
def reproduce(
    *,
    recordings: Annotated[InFolder | None, Help("Folder of recordings (default: synthesised recordings)")] = None,
    out: OutFolder = Path("out/reproduce"),
    docs: Docs = None,
) -> None:
    """Reproduce the haptography paper: figures and numbers beside the published ones, on one page.

    examples:
      hapscene lab reproduce
      hapscene lab reproduce --recordings recordings --out out/paper
    """
    check_evidence()
    from hapscene_evidence.paper.reproduction import reproduce as run

    print_files(run(str(out), recordings, print_progress, docs))


# `hapscene tune`.


def tune(
    scene: Annotated[str, Help("Scene (.scene.json), painted scene of another format, mesh, or name of an asset")],
    /,
    *,
    out: Annotated[OutFile, Help("Scene file to write (default: NAME.tuned.scene.json)")] = None,
    device: Annotated[str, Help("Haptic device whose limits apply")] = "omni",
    jnd: Annotated[Positive, Help("Largest allowed difference [just-noticeable differences]")] = 1.0,
    mesh: MeshOptions = MeshOptions(),
) -> int:
    """Simplify a scene as far as a person cannot perceive the difference.

    Finds the coarsest meshes and the lowest texture orders whose difference from
    the original scene stays below --jnd, measures the time of a tick on this
    machine, and writes the simplified scene. Its coarser meshes have no materials.
    Exit codes: 0 success; 1 the difference is exceeded.

    examples:
      hapscene tune demo
      hapscene tune bunny.ply --unit m --swatch wood -o bunny.tuned.scene.json
      hapscene touch demo.tuned.scene.json
    """
    path, mesh = find_asset(scene, mesh)
    check_scene(path, mesh)
    from hapscene.device.model import device_named
    from hapscene.fidelity.trial import without_scene_warnings
    from hapscene.fidelity.tune import tune as run
    from hapscene.scene.scene_file import check_scene_path
    from hapscene.touch import is_model, open_scene

    if is_model(path):
        raise HapsceneError(f"{path}: a MuJoCo model cannot be tuned; expected a scene or a mesh")
    out = out or new_file(f"{base_name(path)}.tuned.scene.json")
    check_scene_path(out)
    if out.exists() and out.samefile(path):
        raise SaveConflict(f"{out}: is the scene itself; choose another name for the simplified one")
    device_named(device)
    with without_scene_warnings():
        loaded = open_scene(path, mesh.unit, mesh.swatch, mesh.two_sided, **mesh.reading())
    print_size_advice(loaded, path, device)
    found = run(loaded, device=device, jnd=jnd, say=print_progress)
    found.scene.save(out)
    print_lines(_report(found))
    print_files([out])
    if not found.within_jnd:
        print_note(f"difference exceeded: {found.after['error_jnd']:.2g} JND; the limit is {jnd:g} JND")
    return 0 if found.within_jnd else 1


def _report(found: "Tuned") -> Iterator[str]:
    """The lines of the report: each choice, then the scene before and after."""
    from hapscene.fidelity.tune import WITHIN

    errors = ["not touched" if c.error_jnd is None else f"{c.error_jnd:.2f} JND" for c in found.choices]
    yield from table([(c.kind, c.name, c.what, error) for c, error in zip(found.choices, errors, strict=True)])
    kinds = (
        *(("tick median", "tick_median_us", "µs", 1.0), ("tick p99", "tick_p99_us", "µs", 1.0)),
        *(("tick longest", "tick_worst_us", "µs", 1.0), ("memory", "memory_B", "MB", 1e-6)),
        *(("loading time", "load_s", "ms", 1e3), ("faces", "faces", "", 1.0)),
    )
    both = (found.before, found.after)
    figures = [
        (what, *(f"{each[name] * scale:.3g} {unit}".rstrip() for each in both)) for what, name, unit, scale in kinds
    ]
    yield from table([("scene", "original", "tuned"), *figures])
    after = found.after
    yield (
        f"difference on test paths: at most {after['error_jnd']:.2f} JND in {WITHIN:g} % of the ticks in contact "
        f"(forces {after['force_jnd']:.2f}, vibrations {after['vibration_jnd']:.2f})"
    )


# `hapscene lab study`: user studies.


POLL_S: Final = 0.2
"""Polling interval of the page server [s]."""

LINGER_S: Final = 1.0
"""Time for which the page is served after the last answer [s], so that it can show the end of the session."""


@study.command
def run(
    plan: Annotated[InFile, Help("Plan of the study, a TOML file; docs/how-to/run-a-study.md describes it")],
    /,
    *,
    participant: Annotated[
        str | None, Help("Name of the participant, new or to resume (default: the next of P01, P02, …)")
    ] = None,
    out: Annotated[OutFolder | None, Help("Folder for the answers (default: out/NAME, as out/life)")] = None,
    output: OutputOptions = OutputOptions(),
    page: PageOptions = PageOptions(),
) -> None:
    """Run the session of one participant: play stimuli, ask questions on a page, record the answers.

    Each answer is written to disk before the next question. After Ctrl-C or a
    crash, run the same command with the same --participant to resume.

    examples:
      hapscene lab study run life.toml
      hapscene lab study run life.toml --participant P07 --out out/life
    """
    folder = out or Path("out", base_name(plan))
    from hapscene.study.plan import load_plan
    from hapscene.study.session import Session

    loaded = load_plan(str(plan))
    participant = participant or _next_participant(folder)
    resume = f"to resume: run the same command with --participant {participant}"
    with ExitStack() as stack:
        session = stack.enter_context(Session(loaded, folder, participant))
        if session.trial is None:
            raise StudyError(
                f"{participant} has already answered all {session.done} questions; choose another --participant"
            )
        player = _player(loaded, output)
        stack.callback(player.close)
        print_progress(f"{participant}: {session.done} of {session.total} answered\n")
        if fault := _serve(session, player, page):
            raise StudyError(f"{fault}; {session.done} answers are saved; {resume}")
        report = player.report()
        lines = [f"{participant}: {session.done} of {session.total} answered, in {folder / 'results.csv'}"]
        counts = {"clipped": "clipped samples", "underruns": "underruns of the output"}
        lines += [f"{text}: {report[name]:.0f}" for name, text in counts.items() if report.get(name)]
        lines.append(f"report: hapscene lab study report {folder}" if session.trial is None else resume)
        print_lines(lines)


def _serve(session: "Session", player: "OutputPlayer", page: PageOptions) -> str:
    """Serve the page until all questions are answered, or until Ctrl-C; return the message of an error."""
    import webbrowser

    from hapscene.study.study_server import StudyServer

    with StudyServer(session, player, host=page.host, port=page.port) as server:
        print(f"{server.url}   (press Ctrl-C to end; the session can be resumed)", flush=True)
        if server.public:
            print_progress("open to the network: anyone with this address can answer\n")
        if not page.no_browser:
            webbrowser.open(server.url)
        with interrupt_noted() as noted:
            while not (noted() or server.ended.is_set() or server.fault):
                time.sleep(POLL_S)
            time.sleep(0.0 if noted() else LINGER_S)
        return str(server.fault or "")


def _next_participant(folder: Path) -> str:
    """The first of P01, P02, … without answers."""
    from hapscene.study.session import RESULTS, load_rows

    known = {row["person"] for row in load_rows(folder / RESULTS)} if (folder / RESULTS).exists() else set()
    return next(name for k in range(1, len(known) + 2) if (name := f"P{k:02}") not in known)


def _player(plan: "Plan", options: OutputOptions) -> "OutputPlayer":
    """Open the output of a plan, and return its player."""
    from hapscene.handle.live_process import open_output
    from hapscene.study.stimulus import StimulusMaker, all_stimuli, handle_player, headphone_player
    from hapscene.touch import step

    maker, stimuli = StimulusMaker(plan.folder), all_stimuli(plan)
    options.chosen()  # checks the name of the output
    output = open_output(options.handle or "audio", options.handle_option or {})
    try:
        with step(print_progress, f"synthesising {len(stimuli)} stimuli"):
            if plan.channel == "handle":
                return handle_player(maker, output, stimuli, str(options.handle_file or ""))
            player = headphone_player(maker, output, stimuli)
        print_progress(f"{output.name}: full scale is {player.report()['full_scale_m_s2']:.3g} m/s²\n")
        return player
    except BaseException:
        output.close()
        raise


@study.command
def report(
    folder: Annotated[InFolder, Help("Folder with the answers of the study")],
    /,
    *,
    out: Annotated[OutFile, Help("HTML page to write (default: report.html in the folder)")] = None,
) -> None:
    """Write a report on a study: thresholds, d′ and ratings with confidence intervals.

    examples:
      hapscene lab study report out/life
    """
    from hapscene.study.study_report import write_report

    path = out or folder / "report.html"
    write_report(folder, path)
    print_files([path])
