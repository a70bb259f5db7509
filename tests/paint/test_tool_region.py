"""Regions that tools draw: against the long way, and never further than the truth."""

import numpy as np
from matplotlib.path import Path as Line

from hapscene.paint.model.regions import Outline

from .conftest import turned

STAR = np.array([(0.5 if k % 2 else 0.2) * np.array([np.cos(k), np.sin(k)]) for k in np.arange(0.0, 6.0, 0.6)])


def test_outline_selects_visible_points_in_front_of_the_eye() -> None:
    X_EB = turned(0.4, (0.01, 0.02, 0.3))
    region = Outline(X_EB, STAR)
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (3000, 3))
    p_E = points @ X_EB[:3, :3].T + X_EB[:3, 3]
    ahead = p_E[:, 2] > 0
    inside = np.zeros(len(points), bool)
    inside[ahead] = Line(STAR).contains_points(p_E[ahead, :2] / p_E[ahead, 2:])
    distance = region.distance_m(points)
    np.testing.assert_array_equal(distance < 0, inside)
    assert inside.sum() > 100 and not ahead.all()


def test_distance_is_a_lower_bound() -> None:
    rng = np.random.default_rng(1)
    region = Outline(turned(0.4, (0.01, 0.02, 0.3)), STAR)
    a, b = rng.uniform(-0.5, 0.5, (2, 20_000, 3))
    b = a + (b - a) * rng.uniform(0, 1, (len(a), 1)) ** 4  # near ones too
    other = np.sign(region.distance_m(a)) != np.sign(region.distance_m(b))  # the border is between
    assert other.sum() > 100
    gap = np.linalg.norm(a - b, axis=1)
    assert (np.abs(region.distance_m(a)) <= gap + 1e-12)[other].all()
