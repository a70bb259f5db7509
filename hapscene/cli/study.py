"""`hapscene lab study`: user studies."""

import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

from cyclopts import App

from hapscene.cli.console import print_files, print_lines, print_progress
from hapscene.cli.inputs import base_name
from hapscene.cli.options import (
    Help,
    InFile,
    InFolder,
    OutFile,
    OutFolder,
    OutputOptions,
    PageOptions,
)
from hapscene.errors import StudyError
from hapscene.interrupt import interrupt_noted

if TYPE_CHECKING:
    from hapscene.study.plan import Plan
    from hapscene.study.session import Session
    from hapscene.study.stimulus import OutputPlayer

__all__ = ["study"]

study = App(name="study")  # hapscene/cli/lab.py has its help text

POLL_S: Final = 0.2
"""Polling interval of the page server [s]."""

LINGER_S: Final = 1.0
"""Time for which the page is served after the last answer [s], so that it can show the end of the session."""

WRONG: Final = {
    "clipped": "clipped samples",
    "underruns": "underruns of the output",
}
"""Descriptions of the error counters of a player, by name."""


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
        lines += [f"{words}: {report[name]:.0f}" for name, words in WRONG.items() if report.get(name)]
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
