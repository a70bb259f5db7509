"""If an optional package is missing, the error names the extra to install."""

import sys
import tomllib
from pathlib import Path

import pytest
import trimesh
from packaging.requirements import Requirement

from hapscene.cli import main

PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]

WORDS = {
    "step": "check part.step",
    "audio": "device play-file oak.csv --rate 10000 --units acceleration=m/s2,force=N --handle audio",
    "cluster": "capture batch oak.csv --rate 2000 --out swatches --scheduler tcp://127.0.0.1:9",
    "mujoco": "touch box.xml --no-picture",
    "paint": "paint cube.stl --unit mm --no-browser --no-hand",
    "study": "lab study run gain.toml --no-browser",
    "serve": "serve cube.stl --unit mm --udp 0 --ws 0",
    "video": "view cube.stl --unit mm --out cube.mp4",
}
"""A command that needs the extra; `dev` and `docs` are for work on the project.
Drivers that need `usb` or `hid` are tried in tests/plugins/devices."""

GAIN = """
title = "gain"
people = 1
[stimuli.wood]
swatch = "wood"
[[blocks]]
name = "gain"
kind = "staircase"
stimulus = "wood"
parameter = "gain_dB"
levels = [1.0, 2.0, 2]
"""

NO_COMMAND = {"dev", "docs", "nightly", "hid", "usb"}


@pytest.mark.parametrize("extra", sorted(PROJECT["optional-dependencies"].keys() - NO_COMMAND))
def test_an_extra_that_is_missing_is_named(
    extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    trimesh.creation.box((20, 20, 20)).export("cube.stl")
    Path("part.step").write_text("ISO-10303-21;\nEND-ISO-10303-21;\n")
    Path("oak.csv").write_text("acceleration,force\n" + "0,1\n" * 100)
    Path("gain.toml").write_text(GAIN)
    Path("box.xml").write_text("<mujoco/>")
    for text in PROJECT["optional-dependencies"][extra]:
        monkeypatch.setitem(sys.modules, Requirement(text).name.replace("-", "_"), None)
    assert main(WORDS[extra].split()) == 2
    assert f"pip install 'hapscene[{extra}]'" in capsys.readouterr().err
