"""`hapscene lab study` and `hapscene lab teleoperate`: sessions with people, and over a network."""

import json
import math
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from cyclopts import App, Parameter
from cyclopts.validators import Number

from hapscene.cli.console import print_files, print_lines, print_progress
from hapscene.cli.options import (
    LOCALHOST,
    Compensator,
    Grip,
    Help,
    InFile,
    InFolder,
    OutFile,
    OutFolder,
    OutputOptions,
    PageOptions,
    Port,
    Positive,
    Seed,
    SwatchName,
)
from hapscene.cli.paths import base_name
from hapscene.constants import DEFAULT_GRIP
from hapscene.errors import HapsceneError, StudyError
from hapscene.interrupt import interrupt_noted

if TYPE_CHECKING:
    from hapscene.study.plan import Plan
    from hapscene.study.playing import OutputPlayer
    from hapscene.study.sitting import Sitting

__all__ = ["study", "teleoperate"]

study, teleoperate = App(name="study"), App(name="teleoperate")  # their help is in hapscene/cli/lab.py

NAP_S: Final = 0.2

LINGER_S: Final = 1.0
"""How long the page is served after the last answer [s], so that it learns that the session is over."""

WRONG: Final = {
    "clipped": "a sample was too loud, and was cut",
    "clips": "the handle's force was at its limit",
    "hits": "the handle's coil met a stop",
    "underruns": "the output had nothing to play in time",
}
"""What may go wrong while it is played, by the names of a player's report."""


@study.command
def run(
    plan: Annotated[InFile, Help("Plan, a TOML file, see docs/study.md")],
    /,
    *,
    person: Annotated[str | None, Help("Participant, new or to resume (default: the next of P01, P02, …)")] = None,
    out: Annotated[OutFolder | None, Help("Folder for the answers (default: out/NAME, as out/life)")] = None,
    output: OutputOptions = OutputOptions(),
    page: PageOptions = PageOptions(),
) -> None:
    """Run a session: open the page, play what the plan says, record every answer.

    Each answer is on the disk before the next question. After Ctrl-C or a crash,
    the same command with the same --person resumes at the next question.

    Examples:
      hapscene lab study run life.toml
      hapscene lab study run life.toml --person P07 --out out/life
    """
    folder = out or Path("out", base_name(plan))
    from hapscene.study.plan import load_plan
    from hapscene.study.sitting import Sitting

    loaded = load_plan(str(plan))
    person = person or _next_person(folder)
    resume = f"to resume: the same command with --person {person}"
    with ExitStack() as stack:
        sitting = stack.enter_context(Sitting(loaded, folder, person))
        if sitting.trial is None:
            raise StudyError(f"{person} has answered all {sitting.done}; --person NAME asks another")
        player = _player(loaded, output)
        stack.callback(player.close)
        print_progress(f"{person}: {sitting.done} of {sitting.total} answered\n")
        if fault := _serve(sitting, player, page):
            raise StudyError(f"{fault}; {sitting.done} answers are kept; {resume}")
        report = player.report()
        lines = [f"{person}: {sitting.done} of {sitting.total} answered, in {folder / 'results.csv'}"]
        lines += [f"{words}: {report[name]:.0f} times" for name, words in WRONG.items() if report.get(name)]
        lines.append(f"report: hapscene lab study report {folder}" if sitting.trial is None else resume)
        print_lines(lines)


def _serve(sitting: "Sitting", player: "OutputPlayer", page: PageOptions) -> str:
    """Serve the page until all is answered, or Ctrl-C; return what went wrong with it."""
    import webbrowser

    from hapscene.study.study_server import StudyServer

    with StudyServer(sitting, player, host=page.host, port=page.port) as server:
        print(f"{server.url}   (Ctrl-C ends; the session can be resumed)", flush=True)
        if server.public:
            print_progress("open to the network: whoever has this address may answer\n")
        if not page.no_browser:
            webbrowser.open(server.url)
        with interrupt_noted() as noted:
            while not (noted() or server.ended.is_set() or server.fault):
                time.sleep(NAP_S)
            time.sleep(0.0 if noted() else LINGER_S)
        return str(server.fault or "")


def _next_person(folder: Path) -> str:
    """The first of P01, P02, … who has not begun."""
    from hapscene.study.results_file import load_rows
    from hapscene.study.sitting import RESULTS

    known = {row["person"] for row in load_rows(folder / RESULTS)} if (folder / RESULTS).exists() else set()
    return next(name for k in range(1, len(known) + 2) if (name := f"P{k:02}") not in known)


def _player(plan: "Plan", options: OutputOptions) -> "OutputPlayer":
    """What the plan's stimuli are played on, ready."""
    from hapscene.handle.live_process import open_output
    from hapscene.study.playing import handle, headphones
    from hapscene.study.stimulus import StimulusMaker, all_stimuli
    from hapscene.touch import step

    maker, stimuli = StimulusMaker(plan.folder), all_stimuli(plan)
    output = open_output(options.handle or "audio", options.handle_option or {})
    try:
        with step(print_progress, f"making {len(stimuli)} stimuli"):
            if plan.channel == "handle":
                return handle(maker, output, stimuli, str(options.handle_file or ""))
            player = headphones(maker, output, stimuli)
        print_progress(f"{output.name}: full scale is {player.report()['full_scale_m_s2']:.3g} m/s²\n")
        return player
    except BaseException:
        output.close()
        raise


@study.command
def report(
    folder: Annotated[InFolder, Help("Folder of the study's answers")],
    /,
    *,
    out: Annotated[OutFile, Help("Page to write (default: report.html in the folder)")] = None,
) -> None:
    """Write the results of a study on one page: thresholds, d′, ratings, with intervals.

    Examples:
      hapscene lab study report out/life
    """
    from hapscene.study.study_report import write_report

    path = out or folder / "report.html"
    write_report(folder, path)
    print_files([path])


# Teleoperation.

PORT: Final = 47600
"""Default port of a follower; in the range that nobody has registered."""

Milliseconds = Annotated[float, Parameter(validator=Number(gte=0.0, lte=10_000.0))]
Share = Annotated[float, Parameter(validator=Number(gte=0.0, lte=1.0))]


@Parameter(name="*", group="Session")
@dataclass(frozen=True)
class SessionOptions:
    """What both ends are started with."""

    scheme: Annotated[Literal["wave", "position"], Help("Coupling; the same at both ends")] = "wave"
    duration: Annotated[Positive | None, Help("Length [s] (default: until Ctrl-C, or until the other end stops)")] = (
        None
    )
    summary: Annotated[Path | None, Help("Write the summary to this file, JSON, too")] = None
    seed: Seed = 0
    delay: Annotated[Milliseconds, Help("Impairment of the link from here: delay [ms]")] = 0.0
    jitter: Annotated[Milliseconds, Help("Impairment: mean of a random further delay [ms]")] = 0.0
    loss: Annotated[Share, Help("Impairment: share of packets that are lost, 0 to 1")] = 0.0
    reorder: Annotated[Share, Help("Impairment: share of packets that are overtaken, 0 to 1")] = 0.0

    def given(self) -> dict[str, Any]:
        """The keyword arguments of both ends."""
        from hapscene.teleoperation.endpoint import Coupling
        from hapscene.teleoperation.link import Impairment

        return {
            "coupling": Coupling(self.scheme),
            "impairment": Impairment(self.delay * 1e-3, self.jitter * 1e-3, self.loss, self.reorder),
            "duration_s": math.inf if self.duration is None else self.duration,
            "seed": self.seed,
        }

    def report(self, found: dict[str, Any]) -> None:
        """Print the summary of a session, and write it where `summary` says."""
        from hapscene.io.files import write_whole

        text = json.dumps(found, indent=2, ensure_ascii=False, allow_nan=False)
        print(text)
        if self.summary is not None:
            write_whole(self.summary, (text + "\n").encode(), HapsceneError)


@teleoperate.command
def follower(
    *,
    swatch: SwatchName = "wood",
    host: Annotated[str, Help("Address to listen at")] = LOCALHOST,
    port: Annotated[Port, Help("UDP port; 0 for any free one")] = PORT,
    allow: Annotated[str | None, Help("The one address that may lead; needed with another --host")] = None,
    session: SessionOptions = SessionOptions(),
) -> None:
    """Run the end that touches: it waits for a leader, and ends with it.

    Examples:
      hapscene lab teleoperate follower --swatch wood
      hapscene lab teleoperate follower --delay 50 --jitter 10 --loss 0.1
    """
    if allow is None and host != LOCALHOST:
        raise HapsceneError(f"--host {host} can be reached from elsewhere: name by --allow who may lead")
    from hapscene.teleoperation.udp_session import run_follower

    session.report(run_follower((host, port), allow or LOCALHOST, swatch, **session.given()))


@teleoperate.command
def leader(
    *,
    host: Annotated[str, Help("Address of the follower")] = LOCALHOST,
    port: Annotated[Port, Help("UDP port of the follower")] = PORT,
    grip: Grip = DEFAULT_GRIP,
    compensator: Compensator = "adaptive",
    session: SessionOptions = SessionOptions(),
) -> None:
    """Run the end that is held: a simulated hand feels what the follower touches.

    Examples:
      hapscene lab teleoperate leader --port 47600 --duration 10
    """
    from hapscene.teleoperation.udp_session import run_leader

    session.report(run_leader((host, port), grip, compensator, **session.given()))
