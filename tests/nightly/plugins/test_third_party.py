"""The example of a third-party effect, really installed, is found and rendered."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "third_party_effect"

TOUCH_IT = """
import json, numpy as np, trimesh, hapscene
from hapscene.surface.effect import EFFECTS
entry = EFFECTS.listed()["ridges"]
scene = hapscene.Scene()
scene.add(trimesh.creation.box((0.1, 0.1, 0.02)), name="plate", unit="m",
          swatch=hapscene.Swatch("file", effects={"ridges": {"wavelength_m": 0.002}}))
t_s = np.arange(1000) * 1e-3
path = np.stack([-0.04 + 0.08 * t_s, 0.01 + 0 * t_s, np.full(1000, 0.0095)], axis=1)
path[0, 2] = 0.011
renderer = hapscene.Renderer(scene, effects=["wall", "ridges"])
y = renderer.run(path).a_m_s2.ravel()[5000:]
spectrum = np.abs(np.fft.rfft(y * np.hanning(len(y))))
print(json.dumps({"distribution": entry.distribution, "version": entry.version, "error": entry.error,
                  "rms": float(np.std(y)), "peak_Hz": float(np.argmax(spectrum) * 10_000 / len(y))}))
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A folder with the example installed in it, from a copy: a build leaves files beside its source."""
    folder = tmp_path_factory.mktemp("third_party")
    shutil.copytree(EXAMPLE, folder / "source", ignore=shutil.ignore_patterns("__pycache__", "build", "*.egg-info"))
    pip = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--disable-pip-version-check",
        "--no-index",
        "--no-deps",
    ]
    command = [*pip, "--no-build-isolation", "--target", str(folder / "site"), str(folder / "source")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder / "site"


def test_installed_listed_rendered(site, tmp_path):
    """Sliding at 0.08 m/s over ridges 2 mm apart gives 40 Hz; a height of 10 µm then 0.45 m/s² rms."""
    environment = {**os.environ, "PYTHONPATH": str(site)}
    command = [sys.executable, "-c", TOUCH_IT]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert (found["distribution"], found["version"], found["error"]) == ("hapscene-ridges", "1.0.0", None)
    assert found["peak_Hz"] == pytest.approx(40.0, abs=2.0)
    assert found["rms"] == pytest.approx(1e-5 * (2 * 3.14159 * 40.0) ** 2 / 2**0.5, rel=0.05)
