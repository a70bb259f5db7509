"""Faces that cross, against linear programs and counted cases."""

import numpy as np
import trimesh
from scipy.optimize import linprog

from hapscene.scene.intersection import crossings, overlapping


def test_overlapping_boxes_are_all_found_once():
    rng = np.random.default_rng(0)
    low = rng.random((300, 3))
    high = low + rng.random((300, 3)) * 0.2
    found = np.concatenate(list(overlapping(low, high)))
    touching = ((low[:, None] <= high[None]) & (low[None] <= high[:, None])).all(axis=2)
    expected = {tuple(pair) for pair in np.argwhere(np.triu(touching, 1)).tolist()}
    got = [tuple(sorted(pair)) for pair in found.tolist()]
    assert len(got) == len(set(got)) and set(got) == expected


def meet(a, b) -> bool:
    """Whether two triangles have a point in common, as a linear program over their corners' weights."""
    equal = np.block([[a.T, -b.T], [np.ones(3), np.zeros(3)], [np.zeros(3), np.ones(3)]])
    return linprog(np.zeros(6), A_eq=equal, b_eq=[0, 0, 0, 1, 1], bounds=(0, None)).status == 0


def test_random_triangles_cross_where_a_linear_program_says_so():
    triangles = np.random.default_rng(3).normal(size=(24, 3, 3))
    found = {tuple(sorted(pair)) for pair in crossings(triangles, 1e-12).crossing.tolist()}
    pairs = [(i, j) for i in range(24) for j in range(i + 1, 24)]
    expected = {(i, j) for i, j in pairs if meet(triangles[i], triangles[j])}
    assert found == expected and 20 < len(found) < len(pairs) - 20


def test_touching_is_not_crossing():
    box = trimesh.creation.box((1, 1, 1))
    ball = trimesh.creation.icosphere(subdivisions=2)
    for mesh in (box, ball):
        found = crossings(np.array(mesh.triangles), 1e-9)
        assert not len(found.crossing) and not len(found.lying)
    ledge = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0.2, 0.2, 0], [0.4, 0.2, 1], [0.2, 0.4, 1]]], float)
    assert not len(crossings(ledge, 1e-9).crossing)


def test_overlap_in_one_plane():
    first, over = [[0, 0, 0], [2, 0, 0], [0, 2, 0]], [[0.1, 0.1, 0], [3, 0.1, 0], [0.1, 3, 0]]
    flat = np.array([first, over, [[2, 0, 0], [4, 0, 0], [2, 2, 0]]], float)
    found = {tuple(sorted(pair)) for pair in crossings(flat, 1e-9).lying.tolist()}
    assert found == {(0, 1), (1, 2)}
