"""`hapscene lab study`, as a user meets it: asked over the page, ended by Ctrl-C, gone on with."""

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("websockets", reason="websockets is not installed: pip install 'hapscene[serve]'")
from websockets.sync.client import connect

from hapscene.cli import main
from hapscene.study.results_file import load_rows
from tests.cli.test_study import folder

__all__ = ["folder"]  # fixtures


class Run:
    """`hapscene lab study` as a process, and the page of it."""

    def __init__(self, folder: Path, *words: str) -> None:
        paths = os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH")]))
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
        command = [sys.executable, "-m", "hapscene", "lab", "study", "run", *words, "--no-browser"]
        pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        self.process = subprocess.Popen(command, cwd=folder, env=environment | {"PYTHONPATH": paths}, **pipes)
        self.said: list[str] = []
        url = None
        assert self.process.stdout is not None
        while url is None:
            line = self.process.stdout.readline()
            assert line, self.process.communicate()[1]
            self.said.append(line)
            url = re.search(r"http://\S+", line)
        page = url.group()
        origin: Any = "/".join(page.split("/")[:3])
        self.socket = connect(page.replace("http", "ws") + "socket", origin=origin)
        self.state = json.loads(self.socket.recv(120.0))

    def say(self, until: Callable[[dict[str, Any]], bool], **said: Any) -> None:
        self.socket.send(json.dumps(said))
        while True:
            told = json.loads(self.socket.recv(120.0))
            if "screen" in told:
                self.state = told
                if until(told):
                    return

    def answer(self) -> None:
        """The trial that is asked."""
        state = self.state
        if state["screen"] == "begin":
            self.say(lambda told: told["screen"] == "trial", **{"continue": True})
            state = self.state
        self.say(lambda told: told["played"] == [0, 1] and not told["playing"], play=[state["number"], 0, 2])
        done = state["done"]
        self.say(lambda told: told["done"] == done + 1, answer=[state["number"], 0, 1.5])

    def end(self, number: int) -> tuple[int, str, str]:
        """What comes of a signal: code, output, errors."""
        if number:
            self.process.send_signal(number)
        output, errors = self.process.communicate(timeout=120.0)
        self.socket.close()
        return self.process.returncode, "".join(self.said) + output, errors


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_a_sitting_is_interrupted_and_gone_on_with(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    results = folder / "out" / "plan" / "results.csv"
    run = Run(folder, "plan.toml")
    run.answer()
    code, said, errors = run.end(signal.SIGINT)
    assert code == 0 and errors == ""
    assert "P01: 1 of 4 answered, in out/plan/results.csv" in said
    assert "to resume: the same command with --person P01" in said
    assert len(load_rows(results)) == 1
    run = Run(folder, "plan.toml", "--person", "P01")
    for _ in range(3):
        run.answer()
    code, said, _ = run.end(0)  # by itself
    assert code == 0 and "P01: 4 of 4 answered" in said and "report: hapscene lab study report out/plan" in said
    rows = load_rows(results)
    assert [row["trial"] for row in rows] == ["0", "1", "2", "3"] and {row["person"] for row in rows} == {"P01"}
    assert main(["lab", "study", "run", "plan.toml", "--person", "P01", "--no-browser"]) == 2
    assert "P01 has answered all 4; --person NAME asks another" in capsys.readouterr().err
    assert main(["lab", "study", "report", "out/plan"]) == 0
    page = (folder / "out" / "plan" / "report.html").read_text(encoding="utf-8")
    assert "1 of 2 participants; 4 answers" in page and "do not extend to others" in page and "simulated" not in page
