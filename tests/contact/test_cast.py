"""Sweeps of the proxy: position of the stop, side of the face, and choice among several bodies."""

import numpy as np
import pytest
import trimesh

from hapscene.contact.cast import cast

BOX = trimesh.creation.box(bounds=[[-0.05, -0.05, -0.02], [0.05, 0.05, 0.0]])


def test_back_face_is_passed_and_next_front_face_stops(world):
    other = BOX.copy()
    other.apply_translation((0, 0, 0.1))
    w = world(trimesh.util.concatenate([BOX, other]))
    stop = cast(w, (0.0, 0.0, -0.01), (0.0, 0.0, 0.09))
    assert -0.01 + 0.1 * stop == pytest.approx(0.08, abs=1e-5)
    np.testing.assert_array_equal(w.proxy[0].nhat_W[0], (0, 0, -1))


def test_face_at_a_grazing_angle_stops(world):
    """At a slope of 1 in 100 the goal lies half a skin above the face, so the way itself does not reach the face."""
    w = world(BOX)
    skin = w.bodies[0].skin_m
    assert cast(w, (0.0, 0.0, 1.5 * skin), (100 * skin, 0.0, 0.5 * skin)) == pytest.approx(0.5)


def cubes(cells, width_m: float = 0.02) -> trimesh.Trimesh:
    """Return the surface of cubes in a grid: two faces for each side without a neighbour."""
    corners, faces = [], []
    for cell in cells:
        for axis in range(3):
            for side in (0, 1):
                step = np.eye(3, dtype=int)[axis] * (2 * side - 1)
                if tuple(np.add(cell, step).tolist()) in cells:
                    continue
                u, v = np.roll(np.eye(3, dtype=int), -axis - 1, axis=0)[:2]
                base = np.array(cell) + side * np.eye(3, dtype=int)[axis]
                k = len(corners)
                corners += [base, base + u, base + u + v, base + v]
                faces += [[k, k + 1, k + 2], [k, k + 2, k + 3]] if side else [[k + 2, k + 1, k], [k + 3, k + 2, k]]
    return trimesh.Trimesh(np.array(corners) * width_m, faces)


@pytest.mark.parametrize(
    "cells",
    [
        pytest.param([(0, -1, -1), (0, -1, 0), (0, 0, 0)], id="end of a step"),
        pytest.param([(-1, -1, -1), (0, -1, -1), (-1, 0, -1), (-1, -1, 0)], id="three steps"),
        pytest.param([(-1, -1, -1), (-1, -1, 0), (-1, 0, -1), (0, -1, 0)], id="faces back to back"),
    ],
)
def test_no_ray_leaks_where_convex_and_concave_edges_meet(world, cells):
    """Faces overlap their edges, where they can cover other faces with their backs.

    The rays enter the cubes from outside, within about a skin of their common corner at the origin.
    """
    mesh = cubes(cells)
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0
    w = world(mesh)
    skin = w.bodies[0].skin_m
    rng = np.random.default_rng(3)
    leaks = []
    for _ in range(2000):
        inside = (np.array(cells[rng.integers(len(cells))]) + 0.5 + rng.uniform(-0.45, 0.45, 3)) * 0.02
        beside = rng.normal(size=3) * skin * rng.choice([0.03, 0.3, 1.0])
        outside = beside - 0.2 * (inside - beside)
        if tuple(np.floor(outside / 0.02).astype(int).tolist()) in cells:
            continue
        w.proxy[0].count = 0
        if cast(w, tuple(outside), tuple(inside)) > 1.0:
            leaks.append((outside.tolist(), inside.tolist()))
    assert len(leaks) == 0, f"{len(leaks)} rays, the first from and to {leaks[0]}"
