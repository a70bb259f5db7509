"""Public interface: complete stubs, few positional arguments, uniform load and save functions."""

import ast
import inspect
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

import hapscene

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = sorted(path.parent.name for path in (ROOT / "hapscene").glob("*/__init__.pyi"))


def test_stubs_list_the_public_names() -> None:
    stub = ast.parse((ROOT / "hapscene" / "__init__.pyi").read_text(encoding="utf-8"))
    names = {alias.name for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert {*PACKAGES, "Renderer", "load_scene"} <= names <= set(dir(hapscene))
    for package in PACKAGES:
        stub = ast.parse((ROOT / "hapscene" / package / "__init__.pyi").read_text(encoding="utf-8"))
        exported = {alias.name for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names}
        assert exported <= set(dir(getattr(hapscene, package)))


def test_calls_with_many_arguments_take_them_by_name() -> None:
    """Constructors and functions take at most three positional arguments."""
    for name in ("Renderer", "Scene.add", "loop.Twin", "loop.Servo", "teleoperation.Operation", "capture.fit_swatch"):
        target: Any = hapscene
        for part in name.split("."):
            target = getattr(target, part)
        called = target.__init__ if inspect.isclass(target) else target
        kinds = [p.kind for p in inspect.signature(called).parameters.values() if p.name != "self"]
        assert kinds.count(inspect.Parameter.POSITIONAL_OR_KEYWORD) <= 3, name


def test_device_is_given_by_name_or_object() -> None:
    from hapscene.device.sim.arm import simulated_device

    named = hapscene.device.limits_of("omni", 1e-3)
    assert hapscene.device.limits_of(hapscene.device.DEVICES["omni"], 1e-3) == named
    assert hapscene.device.limits_of(hapscene.device.Omni(), 1e-3) == named
    assert isinstance(simulated_device("omni"), hapscene.device.Omni)
    assert simulated_device("premium-1.5") is hapscene.device.DEVICES["premium-1.5"].point
    scene = hapscene.Scene()
    scene.add(trimesh.creation.box((0.1, 0.1, 0.02)), name="plate", unit="m")
    assert hapscene.loop.Twin(scene, "omni").renderer.limits == named
    assert hapscene.Renderer(scene, device=hapscene.device.Omni()).limits == named
    slippery = hapscene.device.limits_of(hapscene.device.Omni(friction_N=0.0, damping_Ns_m=0.0), 1e-3)
    assert slippery.undamped_N_m < named.undamped_N_m  # friction and damping of the device stabilise a wall
    own = hapscene.device.Device("omni", hapscene.device.PointMass(1.0), hapscene.device.Limits())
    assert simulated_device(own) is own.point


def test_saved_objects_load_unchanged(tmp_path: Path) -> None:
    """`save_x(x, path)` and `load_x(path)` accept a str or a Path; the loaded object equals the saved one."""
    scene, wood = hapscene.Scene(), hapscene.load_swatch("wood")
    mesh = scene.add(trimesh.creation.box((0.1, 0.1, 0.02)), name="plate", unit="m", swatch="wood").mesh
    recording = hapscene.Renderer(scene).run(np.linspace([0.0, 0.0, 0.02], [0.01, 0.0, 0.009], 50))
    (tmp_path / "again").mkdir()
    files = {"scene": "a.scene.json", "mesh": "a.ply", "swatch": "a.swatch", "touch": "touch.npz"}
    for (kind, name), example in zip(files.items(), (scene, mesh, wood, recording), strict=True):
        save, load = getattr(hapscene, f"save_{kind}"), getattr(hapscene, f"load_{kind}")
        save(example, str(tmp_path / name))
        more = {"unit": "m"} if kind == "mesh" else {}
        again = load(tmp_path / name, **more)
        assert repr(again).replace(f" of {tmp_path / name}", "") == repr(example)
        save(again, tmp_path / "again" / name)
        assert (tmp_path / "again" / name).stat().st_size > 0
    assert np.array_equal(hapscene.load_mesh(tmp_path / "a.ply", unit="m").vertices_m, mesh.vertices_m)
    assert np.array_equal(hapscene.load_touch(tmp_path / "touch.npz").f_W_N, recording.f_W_N)
    assert np.array_equal(hapscene.load_swatch(tmp_path / "a.swatch").texture.lsf_rad, wood.texture.lsf_rad)
    loaded = hapscene.load_scene(tmp_path / "a.scene.json")
    assert np.array_equal(loaded.bodies[0].face_swatch, scene.bodies[0].face_swatch)
