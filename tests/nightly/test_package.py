"""The package as users install it: built from a copy of the tree, in an environment that knows no checkout."""

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from dataclasses import dataclass
from importlib.metadata import Distribution, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[2]

BUILD_SDIST = "import sys; from setuptools import build_meta; build_meta.build_sdist(sys.argv[1])"
"""What build front ends call; pip cannot make one."""

IMPORT_ALL = """
import importlib, json, sys
print(json.dumps({name: importlib.import_module(name).__file__ for name in json.load(sys.stdin)}))
"""


def run(*words: str | Path, cwd: Path, said: str | None = None, **more: str) -> str:
    """Run a command that must succeed, without access to the checkout; return its output."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(words, cwd=cwd, input=said, env={**clean, **more}, capture_output=True, encoding="utf-8")
    assert done.returncode == 0, f"{words}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def tree() -> dict[str, Path]:
    """Every file that belongs into the wheel by its place there: of all top folders that are packages but evidence."""
    files = {}
    for folder in sorted(package.parent for package in ROOT.glob("*/__init__.py")):
        if folder.name == "evidence":
            continue
        name = "hapscene" if folder.name == "hapscene" else f"hapscene_{folder.name}"
        found = (file for file in folder.rglob("*") if file.is_file() and file.suffix != ".pyc")
        files |= {f"{name}/{file.relative_to(folder).as_posix()}": file for file in found}
    return files


def modules() -> list[str]:
    """Import names of all modules of the tree, but those that run a program when imported."""
    names = (place.removesuffix(".py").removesuffix("/__init__") for place in tree() if place.endswith(".py"))
    return [name.replace("/", ".") for name in names if not name.endswith("/__main__")]


def needed(requirements: list[str]) -> dict[str, Distribution]:
    """What pip installs for requirements, by name: no extras, and nothing but what is asked for."""
    found: dict[str, Distribution] = {}
    waiting = [Requirement(text) for text in requirements]
    while waiting:
        one = waiting.pop()
        if one.name not in found and (one.marker is None or one.marker.evaluate({"extra": ""})):
            found[one.name] = distribution(one.name)
            waiting += map(Requirement, found[one.name].requires or [])
    return found


@dataclass
class Installed:
    """An environment with hapscene from its wheel."""

    site: Path
    """where modules lie"""
    scripts: Path
    work: Path
    """an empty folder to run in"""
    cache: Path

    def run(self, command: str, *words: str | Path, said: str | None = None, **more: str) -> str:
        return run(self.scripts / command, *words, cwd=self.work, said=said, NUMBA_CACHE_DIR=str(self.cache), **more)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a sdist, and in folders of their own wheels made from it and from the tree."""
    folder = tmp_path_factory.mktemp("built")
    ignored = (ROOT / ".gitignore").read_text(encoding="utf-8").split()
    unwanted = shutil.ignore_patterns(".git", *(line.rstrip("/") for line in ignored))
    shutil.copytree(ROOT, folder / "source", ignore=unwanted)  # a build leaves files beside its source, and uses them
    run(sys.executable, "-c", BUILD_SDIST, folder, cwd=folder / "source")
    (sdist,) = folder.glob("*.tar.gz")
    wheel = (sys.executable, "-m", "pip", "wheel", "--quiet", "--no-index", "--no-deps", "--no-build-isolation", "-w")
    run(*wheel, folder / "from_tree", folder / "source", cwd=folder)
    run(*wheel, folder / "from_sdist", sdist, cwd=folder)
    return folder


def wheel_of(folder: Path) -> Path:
    (wheel,) = folder.glob("*.whl")
    return wheel


@pytest.fixture(scope="module")
def installed(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Installed:
    """The wheel in an empty environment. What it needs is not installed anew but linked, package by package: an
    editable hapscene stays out of sight, and so does what the wheel does not ask for."""
    folder = tmp_path_factory.mktemp("installed")
    venv.create(folder / "env", with_pip=False, symlinks=os.name != "nt")
    base = {"base": str(folder / "env"), "platbase": str(folder / "env")}
    site, scripts = (Path(sysconfig.get_path(kind, "venv", base)) for kind in ("purelib", "scripts"))
    pip = (sys.executable, "-m", "pip", "--python", scripts / "python", "install", "--quiet", "--no-index", "--no-deps")
    run(*pip, wheel_of(built / "from_tree"), cwd=folder)
    (metadata,) = site.glob("hapscene-*.dist-info")
    for one in needed(Distribution.at(metadata).requires or []).values():
        for name in {file.parts[0] for file in one.files or []} - {"..", "__pycache__"}:
            if not (site / name).exists():
                (site / name).symlink_to(Path(str(one.locate_file(name))))
    (folder / "work").mkdir()
    return Installed(site, scripts, folder / "work", folder / "cache")


def test_the_sdist_builds_the_same_wheel(built: Path) -> None:
    contents = []
    for folder in ("from_tree", "from_sdist"):
        with zipfile.ZipFile(wheel_of(built / folder)) as wheel:
            contents.append({file.filename: file.CRC for file in wheel.infolist()})
    assert contents[0] == contents[1]


def test_every_file_of_the_tree_is_installed_and_nothing_else(installed: Installed) -> None:
    files = tree()
    assert {"hapscene/py.typed", "hapscene/io/probe_protocol.py", "hapscene_assets/demo.scene.json"} <= files.keys()
    assert len([place for place in files if place.endswith((".css", ".js", ".ply", ".obj", ".swatch"))]) > 10
    folders = [f for f in installed.site.glob("hapscene*") if f.suffix != ".dist-info"]
    found = {f.relative_to(installed.site).as_posix() for folder in folders for f in folder.rglob("*") if f.is_file()}
    assert {place for place in found if not place.endswith(".pyc")} == files.keys()
    for place, file in files.items():
        assert (installed.site / place).read_bytes() == file.read_bytes(), place


def test_every_module_is_imported_from_there(installed: Installed) -> None:
    names = modules()
    found = json.loads(installed.run("python", "-c", IMPORT_ALL, said=json.dumps(names)))
    assert len(names) > 200
    assert [name for name in names if not Path(found[name]).is_relative_to(installed.site)] == []


def test_commands_that_need_a_checkout_say_so(installed: Installed) -> None:
    for command in ("bench", "chart", "reproduce"):
        words = (installed.scripts / "hapscene", "lab", command, "--out", "out")
        clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        done = subprocess.run(words, cwd=installed.work, env=clean, capture_output=True, encoding="utf-8", check=False)
        assert done.returncode == 2 and "clone the repository" in done.stderr and "Traceback" not in done.stderr


# Elsewhere than in the checkout all would be compiled anew, half a minute: `.ci/versions` has that.


def touch(installed: Installed, *words: str | Path) -> None:
    """From above down to 3 mm, in 0.05 s; interpreted, a tick takes 30 ms."""
    (installed.work / "down.csv").write_text("t,x,y,z\n0,0,0,0.06\n0.05,0,0,0.003\n")
    more = ("--path", "down.csv", "--out", "felt", "--no-picture")
    installed.run("hapscene", "touch", *words, *more, NUMBA_DISABLE_JIT="1")
    summary = json.loads((installed.work / "felt" / "summary.json").read_text(encoding="utf-8"))
    assert summary["ticks"] > 45 and summary["ticks_in_contact"] > 1
    assert {"touch.npz", "touch.csv", "plots.png", "feel.wav"} <= {f.name for f in (installed.work / "felt").iterdir()}


def test_the_shipped_scene_is_touched(installed: Installed) -> None:
    touch(installed, "demo")
