"""Losses of each format, measured by roundtrip, in the registry and in docs/reference/file-formats.md."""

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from hapscene.exchange import export_scene, import_scene, losses
from hapscene.exchange.format_registry import EXPORTS
from hapscene.scene.fine_paint import parts
from hapscene.scene.mesh import Mesh
from hapscene.scene.region import Sphere
from hapscene.scene.scene import Scene
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_file import swatch_to_json

READABLE = [name for name in EXPORTS if name != "html"]
UNIT = {"obj": "m", "ply": "m"}
DOCS = Path(__file__).resolve().parents[2] / "docs" / "reference" / "file-formats.md"
_LOOK = "colours and textures of the mesh file"
KEPT, ROUNDED, FLOAT32, CUT, LOST = "kept", "to 1e-15", "to 1e-7", "as cut faces", "lost"


def measured(before: Scene, after: Scene) -> dict[str, str]:
    """Return the result of a roundtrip for every property of a scene."""
    place, error = matched(before, after)
    bodies = [b.name for b in before.bodies] == [b.name for b in after.bodies]
    poses = max((np.abs(a.X_WB - b.X_WB).max() for a, b in pairs(before, after)), default=np.inf) if bodies else np.inf
    corners = [world(s, faces=False) for s in (before, after)]
    painted = [names(before), names(after)[place]]
    known, own = (painted[0] == name for name in ("wood", before.swatches[2].name))
    return {
        "shape": graded(error, np.inf),
        "exact positions": graded(error),
        "bodies and their names": kept_or_lost(bodies),
        "poses": graded(poses),
        "two-sided": kept_or_lost(bodies and all(a.two_sided == b.two_sided for a, b in pairs(before, after))),
        "shared meshes": kept_or_lost(bodies and after.bodies[0].mesh is after.bodies[2].mesh),
        "order of vertices": kept_or_lost(
            corners[0].shape == corners[1].shape and np.allclose(*corners, rtol=0, atol=1e-7)
        ),
        "order of faces": kept_or_lost(bool((place == np.arange(len(place))).all())),
        "paint with a swatch in the library": kept_or_lost(bool((painted[1][known] == painted[0][known]).all())),
        "paint with a swatch not in the library": kept_or_lost(bool((painted[1][own] == painted[0][own]).all())),
        **of_swatch(before.swatches[1], after, "in the library"),
        **of_swatch(before.swatches[2], after, "not in the library"),
        "unused swatches": kept_or_lost(
            all(of_swatch(s, after, "")["parameters of a swatch "] == KEPT for s in before.swatches[3:])
        ),
        _LOOK: kept_or_lost(
            bodies
            and all(b.mesh.colour_rgb is not None for b in after.bodies)
            and bool((colours(after)[place] == colours(before)).all())
        ),
        "group names of the mesh file": kept_or_lost(
            bodies and all(a.mesh.group_names == b.mesh.group_names for a, b in pairs(before, after))
        ),
        "attached bodies": kept_or_lost(
            bodies and [b.parent for b in before.bodies] == [b.parent for b in after.bodies]
        ),
        "swatches of bodies before painting": kept_or_lost(
            bodies and all(a.made_of == b.made_of for a, b in pairs(before, after))
        ),
    }


def of_swatch(swatch: Swatch, after: Scene, where: str) -> dict[str, str]:
    back = next((s for s in after.swatches if s.name == swatch.name), None)
    same = back is not None and back.own_numbers == swatch.own_numbers and back.albedo_rgb == swatch.albedo_rgb
    whole = back is not None and swatch_to_json(back) == swatch_to_json(swatch)
    return {f"parameters of a swatch {where}": kept_or_lost(same), f"texture of a swatch {where}": kept_or_lost(whole)}


def pairs(before: Scene, after: Scene) -> list[tuple]:
    return list(zip(before.bodies, after.bodies, strict=False))


def world(scene: Scene, faces: bool = True) -> np.ndarray:
    """Corners of all faces (m, 9), or vertices (n, 3), in W [m]."""
    placed = [body.mesh.vertices_m @ body.X_WB[:3, :3].T + body.X_WB[:3, 3] for body in scene.bodies]
    if not faces:
        return np.concatenate(placed)
    return np.concatenate([p[b.mesh.faces].reshape(-1, 9) for p, b in zip(placed, scene.bodies, strict=True)])


def names(scene: Scene) -> np.ndarray:
    """Name of the swatch on every face (m,)."""
    called = np.array([swatch.name for swatch in scene.swatches], object)
    return np.concatenate([called[body.face_swatch] for body in scene.bodies])


def colours(scene: Scene) -> np.ndarray:
    """Colour of every face in its file (m, 3)."""
    return np.concatenate([body.mesh.colour_rgb for body in scene.bodies])


def matched(before: Scene, after: Scene) -> tuple[np.ndarray, float]:
    """For every face before the one after at its place, one for one, and the largest distance of a corner [m]."""
    from scipy.spatial import cKDTree

    old, new = world(before), world(after)
    assert len(old) == len(new)
    place = cKDTree(new).query(old)[1]
    assert len(np.unique(place)) == len(old)
    return place, float(np.abs(new[place] - old).max())


def graded(error: float, *allowed: float) -> str:
    """Classify an error [m]; the scene has a size of 0.4 m, so it is about a relative error."""
    if error == 0.0 or (allowed and error < 1e-7):
        return KEPT
    return ROUNDED if error < 1e-15 else FLOAT32 if error < 1e-7 else LOST


def kept_or_lost(kept: bool) -> str:
    return KEPT if kept else LOST


def measured_fine_paint(name: str, folder: Path) -> dict[str, str]:
    """Return the result for a spot with falloff on a box of 12 faces."""
    before = Scene()
    box = before.add(trimesh.creation.box((0.04, 0.03, 0.02)), unit="m")
    before.paint("body", "wood", Sphere((0.0, 0.0, 0.01), 0.005), resolution_m=1e-3, falloff_m=0.004)
    file = folder / f"fine_{name}.{name}"
    export_scene(before, file)
    back = import_scene(file, UNIT.get(name)).bodies[0]
    assert box.fine is not None and parts(box.fine.paint)[2].any()
    kept = back.fine is not None and len(back.fine) == len(box.fine)
    wood_m2 = float(area_of(back.mesh)[back.face_swatch == 1].sum())
    cut = len(back.mesh.faces) > 12 and abs(wood_m2 - np.pi * 0.005**2) < 1e-6
    soft = back.fine is not None and bool(parts(back.fine.paint)[2].any())
    fine = {"paint of subdivided faces": KEPT if kept else CUT if cut else LOST}
    return fine | {"blends of two swatches": kept_or_lost(soft)}


def area_of(mesh: Mesh) -> np.ndarray:
    return np.asarray(trimesh.triangles.area(mesh.triangles_m))


@pytest.fixture(scope="module")
def results(make_scene: Callable[[int], Scene], tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, str]]:
    folder = tmp_path_factory.mktemp("round")
    before = make_scene(2)
    for spare in ("leather", Swatch("tuned for tomorrow", stiffness_N_m=111.0)):
        before.swatch_index(spare)
    for body in before.bodies:
        body.made_of = 1
    before.attach(before.bodies[0].name, "nut")
    found = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name in READABLE:
            file = folder / f"{name}.{name}"
            export_scene(before, file)
            found[name] = measured(before, import_scene(file, UNIT.get(name))) | measured_fine_paint(name, folder)
    return found


@pytest.mark.parametrize("name", READABLE)
def test_registry_lists_losses(name: str, results: dict[str, dict[str, str]]) -> None:
    lost = [aspect for aspect, what in results[name].items() if what in (LOST, FLOAT32)]
    assert sorted(EXPORTS[name].loses) == sorted(lost)


def test_table_in_the_docs(results: dict[str, dict[str, str]]) -> None:
    columns = {"GLB": "glb", "PLY": "ply", "OBJ": "obj"}
    rows = ["| | " + " | ".join(columns) + " |", "|---" * (len(columns) + 1) + "|"]
    for aspect in results["glb"]:
        cells = [results[name][aspect] for name in columns.values()]
        rows.append(f"| {aspect} | " + " | ".join("**lost**" if c == LOST else c for c in cells) + " |")
    table = "\n".join(rows)
    assert table in DOCS.read_text(encoding="utf-8"), f"docs/reference/file-formats.md should hold:\n{table}"


def test_losses_depend_on_the_scene(scene: Scene) -> None:
    plain = Scene()
    plain.add(trimesh.creation.box((0.04, 0.03, 0.02)), unit="m", swatch="wood").made_of = None
    assert set(losses(plain, "glb")) == {"exact positions", "order of vertices", "order of faces"}
    assert losses(plain, "ply") == ("bodies and their names",)
    assert {"bodies and their names", "order of faces"} == set(losses(plain, "obj"))
    plain.paint("body", "paper", Sphere((0.0, 0.0, 0.01), 0.005), resolution_m=1e-3, falloff_m=0.004)
    assert losses(plain, "ply") == ("bodies and their names", "blends of two swatches")
    for name, export in EXPORTS.items():
        here = set(export.loses) - {"unused swatches", "blends of two swatches"}
        here -= {"attached bodies"}
        here -= {"swatches of bodies before painting"}
        assert set(losses(scene, name)) == here  # the scene has all other properties
