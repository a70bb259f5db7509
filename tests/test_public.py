"""Public interface: complete stubs, one-line reprs, few positional arguments, uniform load and save functions."""

import ast
import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hapscene

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = sorted(path.parent.name for path in (ROOT / "hapscene").glob("*/__init__.pyi"))
LINE_MAX = 260


def test_stubs_list_the_public_names() -> None:
    stub = ast.parse((ROOT / "hapscene" / "__init__.pyi").read_text(encoding="utf-8"))
    names = {alias.name for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert {*PACKAGES, "Renderer", "load_scene"} <= names <= set(dir(hapscene))
    for package in PACKAGES:
        stub = ast.parse((ROOT / "hapscene" / package / "__init__.pyi").read_text(encoding="utf-8"))
        exported = {alias.name for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names}
        assert exported <= set(dir(getattr(hapscene, package)))


@pytest.fixture(scope="module")
def examples() -> Iterator[list[Any]]:
    """Return one instance of each public class that holds data."""
    import trimesh

    scene = hapscene.Scene()
    box = trimesh.creation.box((0.1, 0.1, 0.02))
    scene.add(box, name="plate", unit="m", swatch="wood")
    wood = hapscene.load_swatch("wood")
    renderer = hapscene.Renderer(scene, device="omni")
    p_WT = np.linspace([0.0, 0.0, 0.02], [0.01, 0.0, 0.009], 50)
    recording = renderer.run(p_WT)
    twin = hapscene.loop.Twin(scene, "omni", handle=hapscene.handle.Plant())
    intent = hapscene.loop.ReferenceTrajectory.along(p_WT, "light")
    feel = twin.run(intent)
    noise = np.random.default_rng(0).standard_normal(4000)
    operation = hapscene.teleoperation.Operation(scene, p_WT[0])
    surface = hapscene.capture.SurfaceRecording(1000.0, noise, noise, None, None)
    servo = hapscene.loop.Servo(scene, "omni")
    yield [
        scene,
        scene.bodies[0],
        scene.bodies[0].mesh,
        hapscene.scene.examine(scene.bodies[0].mesh),
        wood,
        wood.texture,
        wood.taps,
        renderer,
        recording,
        renderer.step(p_WT[-1]),
        renderer.limits,
        *hapscene.device.DEVICES.values(),
        hapscene.device.Omni(),
        hapscene.surface.load_effect("wall"),
        twin,
        intent,
        feel,
        hapscene.handle.Plant(),
        hapscene.handle.play(noise, 10_000.0),
        operation,
        operation.run(intent),
        surface,
        servo,
        hapscene.teleoperation.Coupling(),
        hapscene.teleoperation.Impairment(),
    ]
    servo.close()


def test_repr_is_one_line_with_the_class_name(examples: list[Any]) -> None:
    for example in examples:
        line = repr(example)
        assert "\n" not in line and len(line) <= LINE_MAX, line
        assert type(example).__name__ in line and " at 0x" not in line, line


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
    import trimesh

    scene.add(trimesh.creation.box((0.1, 0.1, 0.02)), name="plate", unit="m")
    assert hapscene.loop.Twin(scene, "omni").renderer.limits == named
    assert hapscene.Renderer(scene, device=hapscene.device.Omni()).limits == named
    slippery = hapscene.device.limits_of(hapscene.device.Omni(friction_N=0.0, damping_Ns_m=0.0), 1e-3)
    assert slippery.undamped_N_m < named.undamped_N_m  # friction and damping of the device stabilise a wall
    own = hapscene.device.Device("omni", hapscene.device.PointMass(1.0), hapscene.device.Limits())
    assert simulated_device(own) is own.point


def test_fit_accepts_loaded_and_constructed_recordings(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    noise = rng.standard_normal(20_000)
    table = np.column_stack([noise, np.full(len(noise), 1.0), np.full(len(noise), 0.1)])
    file = tmp_path / "oak.csv"
    np.savetxt(file, table, delimiter=",", header="acceleration,force,speed", comments="", fmt="%.17g")
    units = {"acceleration": "m/s2", "force": "N", "speed": "m/s"}
    recording = hapscene.capture.load_recording(file, rate_Hz=10_000.0, units=units)
    options = hapscene.capture.FitOptions(name="oak", order=4, model_count=1)
    found = hapscene.capture.fit_swatch(recording, options)
    arrays = hapscene.capture.SurfaceRecording(10_000.0, noise, table[:, 1], table[:, 2])
    assert found.name == "oak"
    assert np.array_equal(found.texture.lsf_rad, hapscene.capture.fit_swatch(arrays, options).texture.lsf_rad)


def test_saved_objects_load_unchanged(tmp_path: Path, examples: list[Any]) -> None:
    """`save_x(x, path)` and `load_x(path)` accept a str or a Path; the loaded object equals the saved one."""
    scene, mesh, wood, recording = examples[0], examples[2], examples[4], examples[8]
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
