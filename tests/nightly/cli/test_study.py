"""`hapscene lab study` as a process: answering over the page, interrupting, resuming."""

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
from hapscene.study.session import load_rows
from tests.cli.test_study import folder

__all__ = ["folder"]  # fixtures


class Run:
    """`hapscene lab study run` as a process, with a connection to its page."""

    def __init__(self, folder: Path, *words: str) -> None:
        paths = os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH")]))
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
        command = [sys.executable, "-m", "hapscene", "lab", "study", "run", *words, "--no-browser"]
        pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        self.process = subprocess.Popen(command, cwd=folder, env=environment | {"PYTHONPATH": paths}, **pipes)
        self.output: list[str] = []
        url = None
        assert self.process.stdout is not None
        while url is None:
            line = self.process.stdout.readline()
            assert line, self.process.communicate()[1]
            self.output.append(line)
            url = re.search(r"http://\S+", line)
        page = url.group()
        origin: Any = "/".join(page.split("/")[:3])
        self.socket = connect(page.replace("http", "ws") + "socket", origin=origin)
        self.state = json.loads(self.socket.recv(120.0))

    def say(self, until: Callable[[dict[str, Any]], bool], **output: Any) -> None:
        self.socket.send(json.dumps(output))
        while True:
            state = json.loads(self.socket.recv(120.0))
            if "screen" in state:
                self.state = state
                if until(state):
                    return

    def answer(self) -> None:
        """Answer the present trial."""
        state = self.state
        if state["screen"] == "begin":
            self.say(lambda state: state["screen"] == "trial", **{"continue": True})
            state = self.state
        self.say(lambda state: state["played"] == [0, 1] and not state["playing"], play=[state["number"], 0, 2])
        done = state["done"]
        self.say(lambda state: state["done"] == done + 1, answer=[state["number"], 0, 1.5])

    def end(self, number: int) -> tuple[int, str, str]:
        """Send a signal; return exit code, output and errors."""
        if number:
            self.process.send_signal(number)
        output, errors = self.process.communicate(timeout=120.0)
        self.socket.close()
        return self.process.returncode, "".join(self.output) + output, errors


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_a_session_is_interrupted_and_resumed(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    results = folder / "out" / "plan" / "results.csv"
    run = Run(folder, "plan.toml")
    run.answer()
    code, output, errors = run.end(signal.SIGINT)
    assert code == 0 and errors == ""
    assert "P01: 1 of 4 answered, in out/plan/results.csv" in output
    assert "to resume: run the same command with --participant P01" in output
    assert len(load_rows(results)) == 1
    run = Run(folder, "plan.toml", "--participant", "P01")
    for _ in range(3):
        run.answer()
    code, output, _ = run.end(0)  # by itself
    assert code == 0 and "P01: 4 of 4 answered" in output and "report: hapscene lab study report out/plan" in output
    rows = load_rows(results)
    assert [row["trial"] for row in rows] == ["0", "1", "2", "3"] and {row["person"] for row in rows} == {"P01"}
    assert main(["lab", "study", "run", "plan.toml", "--participant", "P01", "--no-browser"]) == 2
    assert "P01 has already answered all 4 questions" in capsys.readouterr().err
    assert main(["lab", "study", "report", "out/plan"]) == 0
    page = (folder / "out" / "plan" / "report.html").read_text(encoding="utf-8")
    assert "1 of 2 participants; 4 answers" in page
