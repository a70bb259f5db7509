"""Sessions: a killed session resumes in the same order."""

import os
import random
import signal
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from hapscene.study.plan import parse_plan
from hapscene.study.session import Session, load_rows
from tests.study.plans import TEXT
from tests.study.test_session import answer_trials, answers, complete

__all__ = ["complete"]  # fixtures


PLAN = parse_plan(TEXT.replace("trials = 20", "trials = 6"))


AT_TIMES = ("time", "latency_s")


KILLED = """
import sys
sys.path.insert(0, sys.argv[1])
from study.test_session import PLAN, Session, choice
with Session(PLAN, sys.argv[2], "P01") as session:
    while session.trial is not None:
        number = session.trial.number
        session.answer(choice(session.trial), latency_s=0.5)
        print(number, flush=True)
"""


def killed(folder: Path, times: int, draw: random.Random) -> int:
    """Run sessions in processes that are killed after some answers; return the number of incomplete rows. Every
    answer that a process has printed must be in the file. In half of the cases the start of a row is appended,
    as a kill during a write would leave it.
    """
    torn = 0
    for _ in range(times):
        with subprocess.Popen(
            [sys.executable, "-c", KILLED, str(Path(__file__).parents[2]), str(folder)],
            stdout=subprocess.PIPE,
            text=True,
        ) as process:
            shown = -1
            for _ in range(draw.randint(1, 6)):
                shown = int(process.stdout.readline() or shown)
            os.kill(process.pid, signal.SIGKILL)
            shown = max([shown, *(int(line) for line in process.stdout if line.endswith("\n"))])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # should the kill have torn a row
            rows = load_rows(folder / "results.csv")
        assert [int(row["trial"]) for row in rows] == list(range(len(rows))) and len(rows) > shown
        if draw.random() < 0.5:
            with (folder / "results.csv").open("ab") as file:
                file.write(b"P01,0,headphones,"[: draw.randint(1, 17)])
            torn += 1
            with Session(PLAN, folder, "P01") as session:
                assert session.done == len(rows)
    return torn


@pytest.mark.skipif(sys.platform == "win32", reason="no such kill")
def test_a_killed_session_resumes(complete: list[dict[str, str]], tmp_path: Path) -> None:
    assert killed(tmp_path, 4, random.Random(3)) > 0
    answer_trials(PLAN, tmp_path, "P01")
    assert answers(tmp_path) == complete


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(10))
def test_repeated_kills(complete: list[dict[str, str]], tmp_path: Path, seed: int) -> None:
    killed(tmp_path, 8, random.Random(seed))
    answer_trials(PLAN, tmp_path, "P01")
    assert answers(tmp_path) == complete
