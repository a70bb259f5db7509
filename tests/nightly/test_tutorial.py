"""Every command line and every snippet of the tutorial, in its order, in an empty folder."""

import contextlib
import io
import re
import shlex
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapscene.cli import main
from tests.cli.command_lines import parse

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"^```(sh|python)\n(.*?)^```$", re.DOTALL | re.MULTILINE)


class Told:
    """What a run of the tutorial left: the names of its snippets, and what its commands said."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.names: list[dict[str, Any]] = []
        self.said: dict[str, str] = {}
        self.no_gl = False


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> Told:
    """The tutorial, done. The painter in the browser is left to the snippet that does the same."""
    told = Told(tmp_path_factory.mktemp("tutorial"))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(told.folder)
        patch.setenv("HAPSCENE_LIBRARY", str(told.folder / "library"))
        for kind, code in BLOCK.findall(TEXT):
            if kind == "python":
                told.names.append({})
                with contextlib.redirect_stdout(io.StringIO()):
                    exec(code, told.names[-1])
                continue
            for line in code.splitlines():
                told.said[line] = run(line, told)
    return told


def run(line: str, told: Told) -> str:
    """Run a command line; what it said. Where no GL can draw, a picture may be refused, saying so."""
    words = shlex.split(line, comments=True)
    assert words[0] == "hapscene", line
    if words[1] == "paint":
        parse(words[1:])
        return ""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        code = main(words[1:])
    if words[1] == "view" and code == 2 and "no GL can draw here" in out.getvalue():
        told.no_gl = True
        return out.getvalue()
    assert code == 0, out.getvalue()
    return out.getvalue()


def test_each_step_makes_what_it_says(told: Told) -> None:
    made = {file.relative_to(told.folder).as_posix() for file in told.folder.rglob("*") if file.is_file()}
    assert {"pebble.stl", "pebble.scene.json", "pebble.glb", "again.scene.json"} <= made
    assert len([name for name in made if re.fullmatch(r"pebble\.epoxy\.[0-9a-f]{8,}\.swatch", name)]) == 1
    assert {f"out/touch/{name}" for name in ("plots.png", "feel.wav", "touch.npz", "touch.csv")} <= made
    assert {"out/stroke/hand.png", "out/stability/z_width.png"} <= made
    assert told.no_gl or {"out/touch/scene.png", "pebble.gif"} <= made


def test_commands_say_what_the_tutorial_says(told: Told) -> None:
    stroke = next(said for line, said in told.said.items() if "--hand stroke" in line)
    assert "'epoxy': 900 N/m is more than the omni holds at 1 kHz (700 N/m)" in stroke
    stability = next(said for line, said in told.said.items() if line.startswith("hapscene lab stability"))
    assert (
        "epoxy: 900 N/m is unstable at 1 kHz with a delay of 1 tick; the device limits it to 700 N/m, which is stable"
        in stability
    )
    assert re.search("stable at every rate and delay: .*leather.*wood", stability)
    check = next(said for line, said in told.said.items() if line.startswith("hapscene check"))
    assert "80 mm × 56 mm × 32 mm" in check and "WARNING" not in check and "ERROR" not in check
    export = next(said for line, said in told.said.items() if line.startswith("hapscene convert pebble.scene"))
    assert "not stored in this format" in export


def test_painting_is_felt_and_comes_back(told: Told) -> None:
    import hapscene

    scene, again = (hapscene.load_scene(told.folder / f"{name}.scene.json") for name in ("pebble", "again"))
    areas = []
    for one in (scene, again):
        (body,) = one.bodies
        corner_m = body.mesh.vertices_m[body.mesh.faces]
        size_m2 = np.linalg.norm(np.cross(corner_m[:, 1] - corner_m[:, 0], corner_m[:, 2] - corner_m[:, 0]), axis=1) / 2
        areas.append(
            {s.name: size_m2[body.face_swatch == i].sum() for i, s in enumerate(one.swatches) if s.name != "plain"}
        )
    assert set(areas[0]) == {"wood", "leather", "epoxy"}
    assert areas[1] == pytest.approx(areas[0], rel=1e-5)
    assert areas[0]["leather"] == pytest.approx(0.016 * 0.04 + np.pi * 0.008**2, rel=0.15)  # the stroke
    command = told.names[-1]["command"]
    assert command.f_W_N[2] > 0.3 and np.isfinite(command.a_m_s2).all()


def test_what_is_installed_is_offered() -> None:
    extras = re.findall(r'pip install .*"\.\[(.*)\]"', TEXT)
    offered = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    assert extras and all(extra in offered for extra in ",".join(extras).split(","))
    assert (ROOT / "requirements.lock").exists()


def test_links_lead_somewhere() -> None:
    links = re.findall(r"\]\(([^)#]+)\)", TEXT)
    assert len(links) > 2
    assert [link for link in links if not (ROOT / "docs" / link).exists()] == []
