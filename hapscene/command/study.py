"""`hapscene study`."""

import argparse
import time
import webbrowser
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hapscene.command.console import name_made, note, say, tell
from hapscene.command.options import (
    HOST,
    add_command,
    add_group,
    add_out_file,
    add_out_folder,
    add_pairs,
    base_name,
    check_out_folder,
    check_there,
    port,
)
from hapscene.errors import StudyError
from hapscene.interrupt import interrupt_noted

if TYPE_CHECKING:
    from hapscene.study.plan import Plan
    from hapscene.study.playing import OutputPlayer

NAP_S: Final = 0.2

LINGER_S: Final = 1.0
"""How long the page is served once all is answered [s]: it is told so, and needs nothing after that."""

WRONG: Final = {
    "clipped": "a sample was too loud, and was cut",
    "clips": "the handle's force was at its limit",
    "hits": "the handle's coil met a stop",
    "underruns": "the output was given nothing to play in time",
}
"""What may go wrong while it is played, by the names of a player's report."""

WORDS: Final = ("run", "report")


def add_study(commands: Any) -> None:
    about = "ask people what they can tell apart: a plan, a page to answer on, a report"
    add_group(commands, "study", about, _add_run, _add_report, metavar="PLAN | COMMAND")
    group = commands.choices["study"]
    group.epilog = "hapscene study PLAN.toml runs it; hapscene study run --help says more."
    parse = group.parse_known_args

    def with_run(words: Sequence[str], namespace: Any = None) -> Any:
        """A plan alone is run."""
        return parse(["run", *words] if words and _is_plan(words[0]) else words, namespace)

    group.parse_known_args = with_run


def _is_plan(word: str) -> bool:
    return word not in WORDS and (word.endswith(".toml") or Path(word).is_file())


def _add_run(commands: Any) -> None:
    command = add_command(commands, "run", _run)
    command.add_argument("plan", metavar="PLAN", help="a TOML file, see docs/study.md")
    command.add_argument("--person", metavar="NAME", help="who is asked, or goes on (default: the next of P01, P02, …)")
    add_out_folder(command, None, "out/ and the plan's name")
    command.add_argument("--channel", choices=("headphones", "handle"), help="in place of the plan's")
    played = command.add_argument_group("what it is played on")
    played.add_argument("--output", metavar="NAME", help="what plays vibrations: audio (default), serial, usb")
    add_pairs(played, "--output-option", "of the output")
    played.add_argument("--handle-file", metavar="FILE", help="of `handle identify`: what the compensator drives")
    page = command.add_argument_group("the page")
    page.add_argument("--port", type=port, default=0, help="where it is (default: any that is free)")
    page.add_argument(
        "--host", default=HOST, metavar="ADDRESS",
        help=f"to serve at (default {HOST}: this computer alone); 0.0.0.0 for a tablet in the same network",
    )  # fmt: skip
    page.add_argument("--no-browser", action="store_true", help="open no browser; print the address alone")


def _run(options: argparse.Namespace) -> int:
    """Ask a person: opens the page, plays what the plan says, keeps every answer. `hapscene study PLAN.toml` is enough.

    Each answer is on the disk before the next question. Ctrl-C, or a computer that fails, loses none: the same command
    with the same --person goes on at the next question.

    for example:
      hapscene study run life.toml
      hapscene study life.toml --person P07 --out out/life --output-option device=headphones
    """
    check_there(options.plan, StudyError, "plan of a study")
    folder = Path(options.out or f"out/{base_name(options.plan)}")
    check_out_folder(str(folder))
    from msgspec.structs import replace

    from hapscene.study.plan import load_plan
    from hapscene.study.sitting import Sitting
    from hapscene.study.study_server import StudyServer

    plan = load_plan(options.plan)
    if options.channel and options.channel != plan.channel:
        note(f"played by {options.channel}; the plan says {plan.channel}")
        plan = replace(plan, channel=options.channel)
    person = options.person or next_person(folder)
    again = f"to go on: the same command with --person {person}"
    with ExitStack() as stack:
        sitting = stack.enter_context(Sitting(plan, folder, person))
        if sitting.trial is None:
            raise StudyError(f"{person} has answered all {sitting.done}; --person NAME asks another")
        player = _player(plan, options)
        stack.callback(player.close)
        server = stack.enter_context(StudyServer(sitting, player, host=options.host, port=options.port))
        say(f"{person}: {sitting.done} of {sitting.total} answered\n")
        print(f"{server.url}   (Ctrl-C ends; it can be gone on with)", flush=True)
        if server.public:
            say("open to the network: whoever has this address may answer\n")
        if not options.no_browser:
            webbrowser.open(server.url)
        with interrupt_noted() as noted:
            while not (noted() or server.ended.is_set() or server.fault):
                time.sleep(NAP_S)
            time.sleep(0.0 if noted() else LINGER_S)
        if server.fault:
            raise StudyError(f"{server.fault}; {sitting.done} answers are kept; {again}")
        report = player.report()
        lines = [f"{person}: {sitting.done} of {sitting.total} answered, in {folder / 'results.csv'}"]
        lines += [f"{words}: {report[name]:.0f} times" for name, words in WRONG.items() if report.get(name)]
        lines.append(f"report: hapscene study report {folder}" if sitting.trial is None else again)
        tell(lines)
    return 0


def next_person(folder: Path) -> str:
    """The first of P01, P02, … who has not begun."""
    from hapscene.study.results_file import load_rows
    from hapscene.study.sitting import RESULTS

    known = {row["person"] for row in load_rows(folder / RESULTS)} if (folder / RESULTS).exists() else set()
    return next(name for k in range(1, len(known) + 2) if (name := f"P{k:02}") not in known)


def _player(plan: "Plan", options: argparse.Namespace) -> "OutputPlayer":
    """What the plan's stimuli are played on, ready."""
    from hapscene.handle.live_process import open_output
    from hapscene.study.playing import handle, headphones
    from hapscene.study.stimulus import StimulusMaker, all_stimuli
    from hapscene.touch import step

    maker, stimuli = StimulusMaker(plan.folder), all_stimuli(plan)
    output = open_output(options.output or "audio", dict(options.output_option))
    try:
        with step(say, f"making {len(stimuli)} stimuli"):
            if plan.channel == "handle":
                return handle(maker, output, stimuli, options.handle_file or "")
            player = headphones(maker, output, stimuli)
        say(f"{output.name}: full scale is {player.report()['full_scale_m_s2']:.3g} m/s²\n")
        return player
    except BaseException:
        output.close()
        raise


def _add_report(commands: Any) -> None:
    command = add_command(commands, "report", _report)
    command.add_argument("folder", metavar="FOLDER", help="where a study's answers are")
    add_out_file(command, "FILE", "the page (default: report.html in the folder)")


def _report(options: argparse.Namespace) -> int:
    """What the answers say, on one page: thresholds, d′, ratings, with intervals, and what cannot be said.

    for example:
      hapscene study report out/life
    """
    check_there(options.folder, StudyError, "folder")
    from hapscene.study.study_report import write_report

    path = Path(options.out or Path(options.folder) / "report.html")
    write_report(Path(options.folder), path)
    name_made([path])
    return 0
