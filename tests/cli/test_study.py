"""`hapscene lab study`."""

from pathlib import Path

import pytest

pytest.importorskip("websockets", reason="websockets is not installed: pip install 'hapscene[serve]'")

from hapscene.cli import main
from hapscene.study.plan import load_plan

EXAMPLES = sorted((Path(__file__).resolve().parents[2] / "examples" / "study").glob("*.toml"))

PLAN = """
title = "Surfaces"
people = 2
[stimuli.wood]
swatch = "wood"
seconds = 0.1
[stimuli.paper]
swatch = "paper"
seconds = 0.1
[[blocks]]
name = "which"
kind = "2ifc"
pairs = [["wood", "paper"]]
repeats = 4
question = "Which is rougher?"
"""

CARD = '''
"""The part of sounddevice that headphones use, with a simulated sound card."""
import threading, time
from types import SimpleNamespace
import numpy as np
class PortAudioError(Exception): pass
class CallbackAbort(Exception): pass
default = SimpleNamespace(device=(-1, 0))
def query_devices(): return [{"name": "Headphones", "max_output_channels": 2}]
class OutputStream:
    latency = 0.01
    def __init__(self, callback, channels, **settings):
        self.callback, self.out, self.runs = callback, np.zeros((480, channels), np.int16), True
    def start(self):
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()
    def run(self):
        while self.runs:
            self.callback(self.out, 480, None, SimpleNamespace(output_underflow=False))
            time.sleep(0.01)
    def stop(self): self.runs = False
    def close(self): self.runs = False
'''


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "sounddevice.py").write_text(CARD)
    (tmp_path / "plan.toml").write_text(PLAN)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("plan", EXAMPLES, ids=lambda path: path.stem)
def test_examples_are_valid_plans(plan: Path) -> None:
    assert load_plan(plan).blocks


@pytest.mark.parametrize(
    ("words", "output"),
    [
        (["run", "none.toml"], "none.toml: no such file"),
        (["reprot", "out"], 'Did you mean "report"?'),
        (["run", "plan.toml", "--particpant", "P01"], "Did you mean --participant?"),
        (["run", "plan.toml", "--participant", "7", "--no-browser"], "invalid name"),
        (["run", "plan.toml", "--handle", "serial", "--handle-option", "port=none", "--no-browser"], "none"),
        (["run", "plan.toml", "--handle", "falcon", "--no-browser"], "no vibration output 'falcon'"),
        (["report", "none"], "none: no such folder"),
        (["report", "."], "results.csv: no such file"),
    ],
)
def test_invalid_input_is_one_line(
    folder: Path, words: list[str], output: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["lab", "study", *words]) == 2
    errors = capsys.readouterr().err
    assert output in errors and errors.count("\n") == 1
