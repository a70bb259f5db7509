"""The errors and warnings that users meet most, compared with one file of expected texts.

After an intended change of a text, renew the file and read the difference:

    pytest tests/test_messages.py --update && git diff tests/messages.golden
"""

import json
import shlex
import sys
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.cli import main
from hapscene.device.model import Limits
from hapscene.errors import HapsceneError
from hapscene.exchange import export_scene
from hapscene.scene.mesh import Mesh
from hapscene.surface.swatch_file import swatch_from_json, swatch_to_json

GOLDEN = Path(__file__).with_name("messages.golden")

COMMANDS = """
tuch cube.ply
xyz
swatch lst
touch
touch cube.ply cube.stl
touch cube.ply --untt mm
touch cube.ply --unit m --seed -1
touch cube.ply --unit m --rate 0
touch cube.ply --unit m --rate 12345
touch cube.stl
touch cube.stl --unit furlong
touch none.stl
touch toda
touch empty.ply --unit m
touch truncated.ply --unit m
touch truncated.off --unit m
touch text.stl --unit m
touch path.csv
touch broken.scene.json
touch cube.ply --unit m --swatch oka
touch cube.ply --unit m --swatch later.swatch
touch cube.ply --unit m --effects wall,fricton
touch cube.ply --unit m --effects weight --set weight.mass_kg=-1
touch cube.ply --unit m --effects weight --set weight.mas_kg=1
touch cube.ply --unit m --effects weight --set weight.bodies=lid
touch cube.ply --unit m --path none.csv
touch cube.ply --unit m --path short.csv
touch cube.ply --unit m --path nan.csv
touch cube.ply --unit m --path backwards.csv
touch cube.ply --unit m --path no_z.csv
touch cube.ply --unit m --hand strok
touch cube.ply --unit m --hand stroke --device omi
touch cube.ply --unit m --hand stroke --grip soft
touch cube.ply --unit m --out path.csv
touch cube.ply --unit m --no-picture --effects wall
check cube.ply --unit m --fix no/x.ply
check none.stl
swatch show oka
swatch search friction<
swatch search colour<3
swatch remove wood
capture fit none.csv
"""
"""Command lines; what they print to standard error."""

BOX = trimesh.creation.box((0.1, 0.1, 0.1))


def scene(swatch: str = "wood") -> hapscene.Scene:
    built = hapscene.Scene()
    built.add(BOX, name="box", unit="m", swatch=swatch if swatch == "wood" else hapscene.Swatch(swatch, 5000.0))
    return built


def renderer(**options: object) -> hapscene.Renderer:
    return hapscene.Renderer(scene(), ["wall"], **options)  # type: ignore[arg-type]


def wound(count: int) -> Mesh:
    """Return a ball with a number of faces wound inwards."""
    ball = trimesh.creation.icosphere(subdivisions=2)
    faces = np.array(ball.faces)
    faces[:count] = faces[:count, ::-1]
    return Mesh(np.array(ball.vertices), faces)


def swatch_with(key: str, value: object) -> str:
    return json.dumps(json.loads(swatch_to_json(hapscene.load_swatch("wood"))) | {key: value})


def replace_mesh() -> None:
    scene().save("box.scene.json")
    (file,) = Path().glob("box.box.*.ply")
    hapscene.save_mesh(Mesh.from_trimesh(trimesh.creation.box((0.2, 0.1, 0.1)), "m"), file)
    hapscene.load_scene("box.scene.json")


CALLS: dict[str, Callable[[], object]] = {
    "a mesh without units": lambda: hapscene.Scene().add(BOX),
    "not a mesh": lambda: hapscene.Scene().add(3),  # type: ignore[arg-type]
    "a second body of one name": lambda: scene().add(BOX, name="box", unit="m"),
    "an unknown body": lambda: scene().body("bocks"),
    "a pose that scales": lambda: scene().pose("box", np.diag([2.0, 2.0, 2.0, 1.0])),
    "a pose in another unit": lambda: scene().pose("box", trimesh.transformations.translation_matrix((2e4, 0, 0))),
    "painting a face that is missing": lambda: scene().paint("box", "wood", [12]),
    "painting an unknown group": lambda: scene().paint("box", "wood", "lid"),
    "a mesh that changed": replace_mesh,
    "a mesh of mixed winding": lambda: hapscene.Scene().add(wound(100), name="ball"),
    "a mesh that is inside out": lambda: hapscene.Scene().add(wound(320), name="ball"),
    "a mesh without area": lambda: hapscene.Scene().add(
        Mesh([[0, 0, 0], [0.1, 0, 0], [0.3, 0, 0]], [[0, 1, 2]]), name="slab"
    ),
    "a unit that differs from the file's": lambda: hapscene.load_mesh("cube.glb", unit="cm"),
    "STEP without its reader": lambda: hapscene.load_mesh("part.step"),
    "an unknown key of a swatch": lambda: swatch_from_json(swatch_with("stifness_N_m", 1.0)),
    "a number that is a text": lambda: swatch_from_json(swatch_with("stiffness_N_m", "hard")),
    "friction out of range": lambda: hapscene.Swatch("oak", friction_static=6.0),
    "an unknown export format": lambda: export_scene(scene(), "desk.fbx"),
    "an export over a file": lambda: export_scene(scene(), "cube.glb"),
    "a path of the wrong shape": lambda: renderer().run(np.zeros(3)),
    "a path with NaN": lambda: renderer().run([[0, 0, 1], [0, np.nan, 1]]),
    "a path in mm": lambda: renderer().run([[0, 0, 1], [0, -20_000, 1]]),
    "poses of an unknown body": lambda: renderer().run(np.ones((5, 3)), poses={"bax": np.tile(np.eye(4), (5, 1, 1))}),
    "poses that are no rotations": lambda: renderer().run(np.ones((1, 3)), poses={"box": 2.0 * np.eye(4)[None]}),
    "an unknown device": lambda: renderer(device="omi"),
    "a device that cannot hold the stiffness": lambda: hapscene.Renderer(scene("steel"), device="omni"),
    "a limit below zero": lambda: Limits(force_N=-1.0),
    "an unknown moving body": lambda: renderer().moving_bodies(["crate"]),
}
"""Calls of the library; the errors and warnings that they raise."""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with the files that the commands name."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HAPSCENE_LIBRARY", str(tmp_path / "library"))
    monkeypatch.setitem(sys.modules, "cascadio", None)
    cube = trimesh.creation.box((0.02, 0.02, 0.02))
    for suffix in ("ply", "stl", "glb"):
        cube.export(tmp_path / f"cube.{suffix}")
    rows = "t,x,y,z\n" + "".join(f"{k / 1000},0,0,0\n" for k in range(9))
    files = {
        "empty.ply": "",
        "text.stl": "This is no mesh.\n",
        "truncated.off": "OFF\n4 4 6\n0 0 0\n1 0 0\n",
        "part.step": "ISO-10303-21;\nEND-ISO-10303-21;\n",
        "broken.scene.json": "{",
        "later.swatch": swatch_with("version", 99),
        "path.csv": rows,
        "short.csv": "t,x,y,z\n0,0,0,0\n",
        "nan.csv": rows + "0.3,0,nan,0\n",
        "backwards.csv": rows + "0.001,0,0,0\n",
        "no_z.csv": "t,x,y\n0,0,0\n1,0,0\n",
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "truncated.ply").write_bytes((tmp_path / "cube.ply").read_bytes()[:300])
    return tmp_path


def texts(call: Callable[[], object]) -> list[str]:
    """The warnings and the error of a call."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            call()
        except HapsceneError as error:
            return [f"{type(error).__name__}: {error}"]
    return [f"{warning.category.__name__}: {warning.message}" for warning in caught]


def test_messages(folder: Path, capsys: pytest.CaptureFixture[str], request: pytest.FixtureRequest) -> None:
    found = []
    for command in COMMANDS.strip().splitlines():
        with suppress(SystemExit):
            main(shlex.split(command))
        lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("hapscene")]
        found.append("\n".join([f"$ hapscene {command}", *lines]))
    for name, call in CALLS.items():
        found.append("\n".join([f"# {name}", *texts(call)]))
    text = "\n\n".join(found).replace(f"{folder}/", "") + "\n"
    if request.config.getoption("--update"):
        GOLDEN.write_text(text, encoding="utf-8")
    assert text == GOLDEN.read_text(encoding="utf-8")
