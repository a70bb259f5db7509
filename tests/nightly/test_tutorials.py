"""The commands and programs of each tutorial work, in their order, in an empty folder."""

import contextlib
import io
import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapscene.cli import main
from tests.cli.command_lines import parse

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"^```(sh|python)\n(.*?)^```$", re.DOTALL | re.MULTILINE)


class Run:
    """Result of a tutorial: the names of its programs, the output of its commands, and its files."""

    def __init__(self) -> None:
        self.names: dict[str, Any] = {"__name__": "__main__"}
        self.output: dict[str, str] = {}
        self.files: set[str] = set()
        self.no_gl = False

    def command(self, start: str) -> str:
        return next(output for line, output in self.output.items() if line.startswith(start))


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], Run]:
    """Run a tutorial. The painter is left to the program that does the same."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HAPSCENE_LIBRARY", str(tmp_path / "library"))

    def run_page(name: str) -> Run:
        done = Run()
        text = (ROOT / "docs" / "tutorials" / f"{name}.md").read_text(encoding="utf-8")
        for kind, code in BLOCK.findall(text):
            if kind == "python":
                with contextlib.redirect_stdout(io.StringIO()):
                    exec(compile(code, name, "exec"), done.names)
                continue
            for line in code.splitlines():
                run_command(line, done)
        done.files = {file.relative_to(tmp_path).as_posix() for file in tmp_path.rglob("*") if file.is_file()}
        return done

    return run_page


def run_command(line: str, done: Run) -> None:
    """Run a command line, and keep its output; where no GL can draw, a picture may be missing."""
    words = shlex.split(line, comments=True)
    assert words[0] == "hapscene", line
    if words[1] == "paint":
        parse(words[1:])
        return
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        code = main(words[1:])
    done.output[line] = out.getvalue()
    no_picture = words[1] == "view" and code == 2 and "GL" in out.getvalue()
    done.no_gl = done.no_gl or no_picture
    assert code == 0 or no_picture, out.getvalue()


def test_every_tutorial_is_run() -> None:
    pages = {file.stem for file in (ROOT / "docs" / "tutorials").glob("*.md")}
    tests = {name.removeprefix("test_run_").replace("_", "-") for name in globals() if name.startswith("test_run_")}
    assert pages == tests


def test_run_first_touch(run: Callable[[str], Run]) -> None:
    done = run("first-touch")
    assert {f"out/demo/{name}" for name in ("plots.png", "feel.wav", "touch.npz", "touch.csv")} <= done.files
    assert "out/stroke/hand.png" in done.files
    assert "80 mm × 56 mm × 32 mm" in done.command("hapscene check")
    assert done.names["command"].contact.body == "pebble"


def test_run_paint_a_scene(run: Callable[[str], Run]) -> None:
    import hapscene

    done = run("paint-a-scene")
    assert {"pebble.scene.json", "pebble.glb", "again.scene.json", "out/stability/z_width.png"} <= done.files
    assert len([name for name in done.files if re.fullmatch(r"pebble\.epoxy\.[0-9a-f]{8,}\.swatch", name)]) == 1
    assert done.no_gl or "pebble.gif" in done.files
    assert "900 N/m" in done.command("hapscene touch") and "700 N/m" in done.command("hapscene touch")
    assert "900 N/m" in done.command("hapscene lab stability")

    areas = []
    for name in ("pebble", "again"):
        scene = hapscene.load_scene(f"{name}.scene.json")
        (body,) = scene.bodies
        corner_m = body.mesh.vertices_m[body.mesh.faces]
        size_m2 = np.linalg.norm(np.cross(corner_m[:, 1] - corner_m[:, 0], corner_m[:, 2] - corner_m[:, 0]), axis=1) / 2
        areas.append(
            {s.name: size_m2[body.face_swatch == i].sum() for i, s in enumerate(scene.swatches) if s.name != "plain"}
        )
    assert set(areas[0]) == {"wood", "leather", "epoxy"}
    assert areas[1] == pytest.approx(areas[0], rel=1e-5)
    assert areas[0]["leather"] == pytest.approx(0.016 * 0.04 + np.pi * 0.008**2, rel=0.15)  # the stroke
    command = done.names["command"]
    assert command.f_W_N[2] > 0.3 and np.isfinite(command.a_m_s2).all()


def test_run_recording_to_swatch(run: Callable[[str], Run]) -> None:
    done = run("recording-to-swatch")
    assert {"oak.swatch", "oak.html", "library/oak.swatch", "out/oak/plots.png"} <= done.files
    ratio = done.names["acceleration"].std() / done.names["recording"].acceleration_m_s2.std()
    assert ratio == pytest.approx(1.0, abs=0.2)


def test_run_game_in_an_hour(run: Callable[[str], Run]) -> None:
    done = run("game-in-an-hour")
    assert (done.names["score"], done.names["hits"]) == (1, 1)


def test_run_write_an_effect(run: Callable[[str], Run]) -> None:
    done = run("write-an-effect")
    assert -done.names["recording"].f_W_N[-1, 0] == pytest.approx(0.2, rel=1e-3)


def test_run_write_a_driver(run: Callable[[str], Run]) -> None:
    done = run("write-a-driver")
    assert done.names["device"].state.p_DT_m[0, 2] == pytest.approx(1.0 / 300.0 - 0.005, rel=0.01)
