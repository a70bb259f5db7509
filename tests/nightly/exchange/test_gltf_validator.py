"""Exported glTF files in the validator of Khronos, which `make system` installs from npm."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from hapscene.exchange import export_scene
from hapscene.scene.region import Sphere
from hapscene.scene.scene import Scene

PACKAGE = Path(__file__).resolve().parents[3] / "build" / "node" / "node_modules" / "gltf-validator"

ASK = """
const [, package, ...files] = process.argv, fs = require("fs");
Promise.all(files.map(file => require(package).validateBytes(new Uint8Array(fs.readFileSync(file)), {maxIssues: 20})))
    .then(reports => console.log(JSON.stringify(reports.map(report => report.issues))));
"""


@pytest.mark.skipif(shutil.which("node") is None, reason="no node here: apt-get install nodejs")
@pytest.mark.skipif(not PACKAGE.exists(), reason="no gltf-validator here: make system, which needs npm")
def test_validator(scene: Scene, shared: Path, tmp_path: Path) -> None:
    body = scene.bodies[0].name
    scene.paint(body, "paper", Sphere((0.0, 0.0, 0.03), 0.01), resolution_m=2e-3, falloff_m=0.005)
    own: dict[str, Any] = {"a.glb": "both", "look.glb": "look", "feel.glb": "feel"}
    for file, show in own.items():
        export_scene(scene, tmp_path / file, show=show)
    export_scene(scene, tmp_path / "cut.glb", cut=True)
    foreign = [path for path in sorted((shared / "data" / "meshes").glob("*.glb"))]
    for path in foreign:
        other = Scene()
        painted = other.add(path)
        for swatch, side in (("leather", 0), ("wood", 1)):  # on two sides
            place = tuple(painted.mesh.bounds_m[side] * (0, 0, 1) + painted.mesh.bounds_m.mean(axis=0) * (1, 1, 0))
            region = Sphere(place, painted.mesh.diagonal_m / 4)
            assert other.paint(painted.name, swatch, region, resolution_m=painted.mesh.diagonal_m / 200) > 0
        export_scene(other, tmp_path / path.name)
    files = [tmp_path / name for name in (*own, "cut.glb", *(path.name for path in foreign))]
    asked = ["node", "-e", ASK, PACKAGE, *files]
    done = subprocess.run(asked, capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode == 0, done.stderr
    for file, issues in zip(files, json.loads(done.stdout), strict=True):
        assert issues["numErrors"] == 0 and issues["numWarnings"] == 0, (file.name, issues["messages"])
