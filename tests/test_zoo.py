"""Every case of ../shared/zoo through the public API: no NaN, no lost contact, nothing inside, no jump of direction.

Judged by closed forms and by the distance to the face that is said to be touched; limits as in the zoo's own judge.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import hapscene
from hapscene.flags import Flag

SUBDIVISIONS = {"sph1k": 3, "sph20k": 5, "sph80k": 6, "sph330k": 7, "sph1300k": 8}
TWO_SIDED = ("flip20k", "open40")
CONVEX = ("sph", "cube", "plate", "wall", "wedge", "soup", "flip", "degen")
JUMP_DEG = {"slide_sph1k": 11, "plate_thin": 1, "fast2ms": 1, "vgroove": 2, "edge90": 95}
JUMP_OF_KIND_DEG = {"sphere": 3, "moving_sphere": 3}
POKE_TICKS = 20
LOST_M = 2e-4
ON_M = 3e-6
"""A proxy that slips over a convex edge may be a skin past it [m]."""
UNIT_M = 1e-6
"""For trimesh, whose tolerances are absolute: in metres it takes small triangles for points."""

SHARED = Path(__file__).resolve().parents[2] / "shared"
LIST = SHARED / "zoo" / "cases.json"
CASES = json.loads(LIST.read_text()) if LIST.is_file() else []


@pytest.fixture(scope="module")
def meshes():
    """Loaded once: five cases share the ball of 20 k faces."""
    loaded: dict[str, hapscene.Mesh] = {}

    def mesh(name: str) -> "hapscene.Mesh":
        if name not in loaded:
            if name in SUBDIVISIONS:
                shape = trimesh.creation.icosphere(subdivisions=SUBDIVISIONS[name], radius=0.05)
            else:
                data = np.load(SHARED / "zoo" / f"mesh_{name}.npz")
                shape = trimesh.Trimesh(data["vertices_m"], data["faces"], process=False)
            loaded[name] = hapscene.Mesh.from_trimesh(shape, "m")
        return loaded[name]

    return mesh


@pytest.mark.filterwarnings("ignore::hapscene.scene.mesh.MeshWarning")
@pytest.mark.skipif(not CASES, reason="no folder ../shared beside the checkout: reference data absent")
@pytest.mark.parametrize("case", CASES, ids=[case["name"] for case in CASES])
def test_case(case: dict[str, Any], meshes) -> None:
    mesh = meshes(case["mesh"])
    data = np.load(SHARED / "zoo" / f"{case['path']}.npz")
    tool, body = data["tool_m"], data["body_m"] if "body_m" in data else np.zeros(3)
    r = play(case, mesh, tool, body)
    p, touching = r["p_WP_m"], r["touching"]
    assert np.isfinite(p).all() and np.isfinite(r["f_W_N"]).all()
    assert not (r["flags"] & Flag.UNSETTLED).any()
    np.testing.assert_array_equal(p[~touching], tool[~touching])

    assert off_surface_m(mesh, (p - body)[touching], r["face"][touching]).max() < ON_M
    lost = depth_in(case, mesh, tool - body) > LOST_M
    assert not (lost & ~touching).any()
    if not case["name"].startswith("poke"):  # pokes start anew: the direction may be another
        assert jump_deg(p, tool, touching) <= jump_limit_deg(case)
    if "vgroove" in case["name"]:
        deep = tool[:, 2] < -0.0105
        assert deep.any()
        np.testing.assert_allclose(p[deep, 2].min(), -0.01, atol=1e-6)
    if case["name"] in ("plate_thin", "fast2ms"):
        np.testing.assert_allclose(p[touching, 2], 0.0, atol=1e-6)


def play(case, mesh, tool, body) -> dict[str, np.ndarray]:
    scene = hapscene.Scene()
    scene.add(mesh, name="it", two_sided=case["mesh"] in TWO_SIDED)
    renderer = hapscene.Renderer(scene, effects=["wall"])
    poses = {}
    if body.ndim == 2:
        poses["it"] = np.tile(np.eye(4), (len(tool), 1, 1))
        poses["it"][:, :3, 3] = body
    length = POKE_TICKS if case["name"].startswith("poke") else len(tool)
    parts = []
    for start in range(0, len(tool), length):
        renderer.reset(tool[start])
        parts.append(renderer.run(tool[start : start + length], poses=poses))
    names = ("p_WP_m", "touching", "face", "f_W_N", "flags")
    return {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}


def off_surface_m(mesh, p, face) -> np.ndarray:
    """Distance of points from the face each is said to lie on; from the nearest of all faces where that is far [m].

    A face met on the way holds the proxy in a narrow place though another one lies nearer.
    """
    corners = mesh.vertices_m[mesh.faces]
    off = distance_m(corners[face], p)
    for i in np.flatnonzero(off > ON_M):
        off[i] = distance_m(corners, np.tile(p[i], (len(corners), 1))).min()
    return off


def distance_m(corners, p) -> np.ndarray:
    """From each point (n, 3) to its triangle (n, 3, 3)."""
    near = trimesh.triangles.closest_point(corners / UNIT_M, p / UNIT_M)
    return np.linalg.norm(near * UNIT_M - p, axis=1)


def depth_in(case, mesh, tool) -> np.ndarray:
    """How deep the tool is inside at least [m], from closed forms: a ball's inscribed sphere, planes, a convex hull."""
    if case["kind"] in ("sphere", "moving_sphere"):
        a, b, c = (mesh.vertices_m[mesh.faces[:, k]] for k in range(3))
        center = mesh.vertices_m.mean(axis=0)
        normal = np.cross(b - a, c - a)
        size = np.linalg.norm(normal, axis=1)
        real = size > 1e-14
        inner_m = np.abs(((a - center) * normal).sum(axis=1)[real] / size[real]).min()
        return inner_m - np.linalg.norm(tool - center, axis=1)
    if "rot" in case:
        return -(tool @ np.array(case["rot"]))[:, 2]
    if case["mesh"].startswith(CONVEX):
        a, b, c = (mesh.vertices_m[mesh.faces[:, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        planes = np.unique(np.round(np.c_[normal, (normal * a).sum(axis=1)], 12), axis=0)
        return (planes[:, 3] - tool @ planes[:, :3].T).min(axis=1)
    if "vgroove" in case["name"]:  # below the two walls, which hold alone within its top
        across = np.abs(mesh.vertices_m[np.isclose(mesh.vertices_m[:, 2], 0)][:, 0])
        half = np.arctan2(across[across > 0].min(), 0.01)
        wall = np.abs(tool[:, 0]) * np.cos(half) - (tool[:, 2] + 0.01) * np.sin(half)
        return np.minimum(wall, np.minimum(-tool[:, 2], tool[:, 2] + 0.02))
    return np.full(len(tool), -1.0)  # scans and open sheets have none


def jump_deg(p, tool, touching) -> float:
    """Largest turn of the direction from tool to proxy within a tick, the tool 0.2 mm and more inside."""
    way = p - tool
    depth = np.linalg.norm(way, axis=1)
    held = touching & (depth > LOST_M)
    u = way / np.maximum(depth, 1e-12)[:, None]
    turn = np.degrees(np.arccos(np.clip((u[1:] * u[:-1]).sum(axis=1), -1, 1)))
    return float(turn[held[1:] & held[:-1]].max(initial=0.0))


def jump_limit_deg(case) -> float:
    for name, limit in JUMP_DEG.items():
        if case["name"].startswith(name):
            return limit
    return JUMP_OF_KIND_DEG.get(case["kind"], 180)
