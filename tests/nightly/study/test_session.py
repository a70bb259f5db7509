"""A session keeps every answer, and goes on where it was: killed at any time, in the same order."""

import os
import random
import signal
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from hapscene.study.plan import parse_plan
from hapscene.study.results_file import load_rows
from hapscene.study.session import Session
from tests.study.plans import TEXT
from tests.study.test_session import answers, sit, whole

__all__ = ["whole"]  # fixtures


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
    """Sits in processes, each killed without warning after some answers; how many rows were torn.

    Every answer that a process has told of is in the file afterwards. Half of the times, what a kill in the middle of
    a write leaves is added, as the row is too short to be caught in it often.
    """
    torn = 0
    for _ in range(times):
        with subprocess.Popen(
            [sys.executable, "-c", KILLED, str(Path(__file__).parents[2]), str(folder)],
            stdout=subprocess.PIPE,
            text=True,
        ) as process:
            told = -1
            for _ in range(draw.randint(1, 6)):
                told = int(process.stdout.readline() or told)
            os.kill(process.pid, signal.SIGKILL)
            told = max([told, *(int(line) for line in process.stdout if line.endswith("\n"))])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # should the kill have torn a row
            rows = load_rows(folder / "results.csv")
        assert [int(row["trial"]) for row in rows] == list(range(len(rows))) and len(rows) > told
        if draw.random() < 0.5:
            with (folder / "results.csv").open("ab") as file:
                file.write(b"P01,0,headphones,"[: draw.randint(1, 17)])
            torn += 1
            with Session(PLAN, folder, "P01") as session:
                assert session.done == len(rows)
    return torn


@pytest.mark.skipif(sys.platform == "win32", reason="no such kill")
def test_killed_it_goes_on_at_the_next_trial(whole: list[dict[str, str]], tmp_path: Path) -> None:
    assert killed(tmp_path, 4, random.Random(3)) > 0
    sit(PLAN, tmp_path, "P01")
    assert answers(tmp_path) == whole


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(10))
def test_killed_at_random_again_and_again(whole: list[dict[str, str]], tmp_path: Path, seed: int) -> None:
    killed(tmp_path, 8, random.Random(seed))
    sit(PLAN, tmp_path, "P01")
    assert answers(tmp_path) == whole
