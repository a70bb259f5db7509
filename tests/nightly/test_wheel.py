"""The compiled code in a wheel is used if it fits the machine; else it is compiled again with equal results."""

import os
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import trimesh

from hapscene.compiled.native import INTERPRETED

ROOT = Path(__file__).resolve().parents[2]

CPU_MAX_S = 4.0
"""What a first touch may take without plots and pictures, of all cores together, Python's start included [s]."""

RENDER = """
import sys
import numpy as np, trimesh, hapscene
scene = hapscene.Scene()
scene.add(hapscene.load_mesh("box.stl", unit="mm"), name="box", swatch="wood")
path = np.zeros((2000, 3))
path[:, 0], path[:, 2] = np.linspace(-0.008, 0.008, 2000), np.linspace(0.006, 0.004, 2000)
hapscene.Renderer(scene).run(path).save(sys.argv[1])
"""
"""What `hapscene touch` does, without the drawing of its plots."""

pytestmark = [
    pytest.mark.skipif(sys.platform == "win32", reason="built by a shell"),
    pytest.mark.skipif(INTERPRETED, reason="nothing is compiled: NUMBA_DISABLE_JIT"),
    pytest.mark.timeout(1800),
]


class Done(NamedTuple):
    """What a command printed on stderr, and the processor time that it and its children took [s]."""

    printed: str
    cpu_s: float


class Installed(NamedTuple):
    """An environment with the wheel, and an empty folder to run in."""

    scripts: Path
    work: Path

    def run(self, *words: str, cache: str, **more: str) -> Done:
        clean = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "NUMBA"))}
        environment = clean | {"NUMBA_CACHE_DIR": str(self.work / cache)} | more
        command = [str(self.scripts / words[0]), *words[1:]]
        with (self.work / "stderr").open("w+b") as stderr:
            process = subprocess.Popen(
                command, cwd=self.work, env=environment, stdout=subprocess.DEVNULL, stderr=stderr
            )
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            stderr.seek(0)
            printed = stderr.read().decode()
        assert process.returncode == 0, printed
        return Done(printed, usage.ru_utime + usage.ru_stime)

    def compiled(self, cache: str) -> int:
        """How many functions a cache holds."""
        return len(list((self.work / cache).rglob("*.nbc")))


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Installed:
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(["sh", str(ROOT / ".ci" / "wheel"), sys.executable, str(folder / "dist")], check=True)
    (wheel,) = (folder / "dist").glob("hapscene-*.whl")
    assert wheel.stat().st_size < 12e6
    venv.create(folder / "env", with_pip=False)
    base = {"base": str(folder / "env"), "platbase": str(folder / "env")}
    site, scripts = (Path(sysconfig.get_path(kind, "venv", base)) for kind in ("purelib", "scripts"))
    pip = (sys.executable, "-m", "pip", "--python", str(scripts / "python"), "install", "--quiet")
    subprocess.run([*pip, "--no-index", "--no-deps", str(wheel)], check=True)
    (site / "outer.pth").write_text(sysconfig.get_path("purelib") + "\n")  # dependencies; no editable hapscene
    (folder / "work").mkdir()
    trimesh.creation.box((20, 20, 10)).export(folder / "work" / "box.stl")
    one = Installed(scripts, folder / "work")
    one.run("python", "-m", "compileall", "-q", str(site / "hapscene"), cache="none")
    return one


def forces(installed: Installed, file: str) -> np.ndarray:
    with np.load(installed.work / file) as touch:
        found: np.ndarray = touch["f_W_N"]
    return found


def test_a_first_touch_compiles_nothing(installed: Installed) -> None:
    words = ("touch", "box.stl", "--unit", "mm", "--swatch", "wood", "--no-picture", "--out", "felt")
    done = installed.run("hapscene", *words, cache="touch")
    assert "compiling" not in done.printed and installed.compiled("touch") == 0
    assert np.abs(forces(installed, "felt/touch.npz")).max() > 0.1


def test_a_first_touch_takes_little_processor_time(installed: Installed) -> None:
    done = installed.run("python", "-c", RENDER, "shipped.npz", cache="shipped")
    assert installed.compiled("shipped") == 0
    assert done.cpu_s <= CPU_MAX_S


def test_everything_is_shipped(installed: Installed) -> None:
    done = installed.run("hapscene", "lab", "warmup", cache="everything")
    assert "compiling" not in done.printed and installed.compiled("everything") == 0


def test_for_another_processor_it_is_compiled_to_the_same_forces(installed: Installed) -> None:
    """For one without the wheel's instructions, and for this one, with all it has."""
    installed.run("python", "-c", RENDER, "shipped.npz", cache="shipped")
    host = 'import llvmlite.binding as llvm; open("host", "w").write(llvm.get_host_cpu_name())'
    installed.run("python", "-c", host, cache="none")
    want = forces(installed, "shipped.npz")
    assert np.abs(want).max() > 0.1
    for name, more in (
        ("old", {"NUMBA_CPU_NAME": "nehalem", "NUMBA_CPU_FEATURES": ""}),
        ("own", {"NUMBA_CPU_NAME": (installed.work / "host").read_text()}),
    ):
        done = installed.run("python", "-c", RENDER, f"{name}.npz", cache=name, **more)
        assert "compiling" in done.printed and installed.compiled(name) > 5
        np.testing.assert_array_equal(forces(installed, f"{name}.npz"), want)
