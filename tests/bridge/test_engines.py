"""Engines that push a body over the bridge, each with its client in one file: its momentum is what it was told."""

import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from .served import Served

ENGINES = Path(__file__).resolve().parents[2] / "examples" / "engines"


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    served = Served(tmp_path_factory.mktemp("served"))
    yield served
    served.process.kill()
    served.process.wait()


def ran(*words: object) -> str:
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, timeout=120.0, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def assert_pushed(said: str) -> None:
    """What each client prints at its end."""
    told = re.search(r"momentum ([-\d.e]+) told ([-\d.e]+)", said)
    assert told is not None and "began, crate, wood" in said, said
    momentum, got = (float(number) for number in told.groups())
    assert momentum > 1e-3 and momentum == pytest.approx(got, abs=1.1e-6)  # printed to six digits, kept in float32


@pytest.mark.skipif(shutil.which("godot3-server") is None, reason="no Godot here: apt-get install godot3-server")
def test_godot_pushes_a_rigid_body(served: Served, tmp_path: Path) -> None:
    project = tmp_path / "godot"
    shutil.copytree(ENGINES / "godot", project)  # it writes beside what it runs
    assert_pushed(ran("godot3-server", "--path", project, f"--port={served.port}"))


@pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler here: apt-get install g++")
def test_a_program_in_cpp_pushes_a_crate(served: Served, tmp_path: Path) -> None:
    program = tmp_path / "push"
    ran("g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", "-O1", "-o", program, ENGINES / "cpp" / "push.cpp")
    assert_pushed(ran(program, served.port))


@pytest.mark.skipif(shutil.which("node") is None, reason="no Node.js here: apt-get install nodejs")
def test_a_program_in_javascript_pushes_a_crate(served: Served) -> None:
    assert_pushed(ran("node", ENGINES / "javascript" / "push.mjs", served.port))
