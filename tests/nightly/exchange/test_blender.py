"""The Blender add-on, in Blender without a window: a painted scene comes back with what was painted there.

The areas are those of a box and of a disc on it; Blender's own reader, writer and mesh operators lie between.
"""

import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from hapscene.exchange import export_scene, import_scene
from hapscene.scene.body import Body
from hapscene.scene.region import Sphere
from hapscene.scene.scene import Scene
from hapscene.surface.swatch_file import swatch_to_json
from hapscene.swatches.library import load_swatch
from tests.exchange.conftest import rotation

ADD_ON = Path(__file__).resolve().parents[3] / "examples" / "blender" / "haptic_layer.py"
SIZE_M = np.array([0.12, 0.08, 0.06])
RADIUS_M = 0.02
RESOLUTION_M = 1e-3

pytestmark = pytest.mark.skipif(shutil.which("blender") is None, reason="no Blender here: apt-get install blender")


def blender(script: str, *arguments: Path) -> dict[str, Any]:
    """Run a script in Blender with the add-on loaded; return the dictionary `report` that it fills."""
    text = f"""
import json, sys
import bpy, numpy as np
report, paths = {{}}, sys.argv[sys.argv.index("--") + 1:]
{script}
print("REPORT", json.dumps(report))
"""
    command = ["blender", "-b", "--factory-startup", "--python-exit-code", "1", "--python", ADD_ON]
    done = subprocess.run(
        [*command, "--python-expr", text, "--", *arguments], capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0 and "Traceback" not in done.stdout + done.stderr, done.stdout + done.stderr
    lines = [line for line in done.stdout.splitlines() if line.startswith("REPORT ")]
    return dict(json.loads(lines[-1][7:]))


IMPORT = """
for item in list(bpy.data.objects):
    bpy.data.objects.remove(item)
bpy.ops.import_scene.haptic_layer(filepath=paths[0])
bodies = {item.parent["hapscene_body"]: item for item in bpy.data.objects if item.type == "MESH"}
known = {name: list(colour) for name, colour in bpy.context.scene["hapscene_swatches"].items()}
report |= {"bodies": sorted(bodies), "swatches": known}

def linear(rgb):
    return [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in rgb]

def colours(mesh):
    layer = mesh.color_attributes["haptics"]
    assert layer.domain == "CORNER" and mesh.color_attributes.active_color == layer
    found = np.zeros((len(layer.data), 4), np.float32)
    layer.data.foreach_get("color", found.ravel())
    return found

def faces_of(mesh, name):
    found = colours(mesh)[[face.loop_start for face in mesh.polygons]]
    return np.abs(found[:, :3] - linear(known[name])).max(axis=1) < 1e-6

def in_body(v):
    return v.x, v.z, -v.y  # Blender turns the y of glTF up in each mesh, and the node W turns it back

def paint(mesh, faces, rgb):
    for face in faces:
        for loop in face.loop_indices:
            mesh.color_attributes["haptics"].data[loop].color = (*linear(rgb), 1.0)
"""

EXPORT = """
materials, before = len(bpy.data.materials), {name: len(item.data.materials) for name, item in bodies.items()}
bpy.ops.export_scene.haptic_layer(filepath=paths[1])
assert all("haptics" in item.data.attributes for item in bodies.values())
assert len(bpy.data.materials) == materials
assert before == {name: len(item.data.materials) for name, item in bodies.items()}
"""


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    """A textured box with a disc of an own swatch in its top, and two bodies of one mesh without a look."""
    box = trimesh.creation.box(SIZE_M)
    corners, side = box.triangles.reshape(-1, 3), np.repeat(np.abs(box.face_normals).argmax(axis=1), 3)
    uv = np.array([np.delete(p, a) for p, a in zip(corners, side, strict=True)]) / 0.12 + 0.5
    pixels = np.random.default_rng(0).integers(0, 256, (16, 16, 3)).astype(np.uint8)
    paint: Any = trimesh.visual.material.PBRMaterial(name="Paint", baseColorTexture=Image.fromarray(pixels))
    mesh = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False)
    mesh.visual = trimesh.visual.TextureVisuals(uv=uv, material=paint)
    mesh.units = "m"
    scene = Scene()
    scene.add(mesh, name="box", pose=rotation((1, 2, 3), 0.7))
    mine = replace(load_swatch("paper"), name="mine", stiffness_N_m=1234.5)
    assert scene.paint("box", mine, Sphere((0.0, 0.0, SIZE_M[2] / 2), RADIUS_M), resolution_m=RESOLUTION_M) > 0
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.03)
    ball.units = "m"
    for name in ("ball", "ball too"):
        shared = scene.add(ball if name == "ball" else scene.bodies[1].mesh, name=name, swatch="wood")
        shared.two_sided = name == "ball"
    scene.swatch_index("leather")  # not painted
    return scene


def areas_m2(scene: Scene, body: Body) -> dict[str, float]:
    """Area of each swatch on a body."""
    area = trimesh.triangles.area(body.mesh.triangles_m)
    index = np.unique(body.face_swatch)
    return {scene.swatches[i].name: float(area[body.face_swatch == i].sum()) for i in index}


def test_paint_in_blender_is_read_back(scene: Scene, tmp_path: Path) -> None:
    sent, painted = tmp_path / "sent.glb", tmp_path / "painted.glb"
    export_scene(scene, sent, cut=True)
    script = f"""{IMPORT}
box, ball = bodies["box"].data, bodies["ball"].data
report["disc_m2"] = sum(face.area for face, there in zip(box.polygons, faces_of(box, "mine")) if there)
report["fake"] = [own.name for own in bpy.data.materials if own.use_fake_user]
paint(box, [face for face in box.polygons if in_body(face.normal)[0] > 0.9], known["leather"])
paint(ball, [face for face in ball.polygons if in_body(face.center)[2] > 0.0], known["mine"])
bpy.ops.hapscene.add_swatch(name="sandpaper-p60", colour=known["mine"])
known = {{name: list(colour) for name, colour in bpy.context.scene["hapscene_swatches"].items()}}
report["rough"] = known["sandpaper-p60"]
paint(box, [face for face in box.polygons if in_body(face.normal)[1] > 0.9], known["sandpaper-p60"])
{EXPORT}"""
    report = blender(script, sent, painted)
    disc_m2 = np.pi * RADIUS_M**2
    assert report["bodies"] == ["ball", "ball too", "box"]
    assert sorted(report["swatches"]) == ["leather", "mine", "plain", "wood"] and report["fake"] == ["leather"]
    for name in ("wood", "leather"):
        assert report["swatches"][name] == pytest.approx(load_swatch(name).albedo_rgb, abs=1e-12)
    assert np.abs(np.subtract(report["rough"], report["swatches"]["mine"])).max() > 0.04  # distinct
    assert report["disc_m2"] == pytest.approx(disc_m2, rel=2 * RESOLUTION_M / RADIUS_M)

    back = import_scene(painted)
    assert sorted(body.name for body in back.bodies) == report["bodies"]
    box, ball, other = again = [back.body(body.name) for body in scene.bodies]
    x, y, z = SIZE_M
    found = areas_m2(back, box)
    assert found.pop("mine") == pytest.approx(report["disc_m2"], rel=1e-4)
    assert found.pop("leather") == pytest.approx(y * z, rel=1e-5)
    assert found.pop("sandpaper-p60") == pytest.approx(x * z, rel=1e-5)
    assert found.pop("plain") == pytest.approx(2 * x * y + y * z + x * z - report["disc_m2"], rel=1e-4) and not found
    for body, was in zip(again, scene.bodies, strict=True):
        np.testing.assert_allclose(body.X_WB, was.X_WB, atol=1e-6)
        assert body.two_sided == was.two_sided
    assert {back.swatches[i].name for i in np.unique(ball.face_swatch)} == {"mine", "wood"}
    upper = ball.mesh.triangles_m.mean(axis=1)[:, 2] > 0.0
    assert np.array_equal(ball.face_swatch == [swatch.name for swatch in back.swatches].index("mine"), upper)
    assert areas_m2(back, other).keys() == {"wood"}
    texts = {swatch.name: swatch_to_json(swatch) for swatch in back.swatches}
    for swatch in scene.swatches:
        assert texts[swatch.name] == swatch_to_json(swatch)
    assert texts["sandpaper-p60"] == swatch_to_json(load_swatch("sandpaper-p60"))

    (look,) = box.mesh.materials
    assert look.name == "Paint" and box.mesh.material is not None and not box.mesh.material.any()
    pictures = [
        np.asarray(m.textures["baseColorTexture"].convert("RGB")) for m in (look, scene.bodies[0].mesh.materials[0])
    ]
    assert np.array_equal(*pictures)
    assert ball.mesh.colour_rgb is None
