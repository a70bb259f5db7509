"""Errors whose size is known beforehand."""

import numpy as np
import pytest

from hapscene.contact.planes import nearest
from hapscene.renderer import Renderer
from hapscene_benchmarks.accuracy import angle_deg, distances, measure_accuracy
from hapscene_benchmarks.case import sphere, sphere_cases
from hapscene_benchmarks.projection import TOOL_M, alternating_error_m, groove, measure_projection
from hapscene_benchmarks.sheet import Sheet


def test_direction_error_is_the_angle() -> None:
    p = np.array([[0.0, 0.0, 0.048], [0.048, 0.0, 0.0]])
    turned = np.array([[np.sin(0.1), 0.0, np.cos(0.1)], [3.0, 0.0, 0.0]])
    assert angle_deg(turned, p) == pytest.approx([np.degrees(0.1), 0.0])


def test_distances_to_facets() -> None:
    corners = sphere(2).triangles_m
    middle = corners.mean(axis=1)
    n = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    gap, lag = distances(corners, middle - 1e-5 * n, middle - 5e-4 * n)
    assert gap == pytest.approx(-1e-5, abs=1e-12)
    assert lag == pytest.approx(1e-5, abs=1e-12)


def test_proxy_of_a_slide_is_on_the_facets() -> None:
    (case,) = sphere_cases((3,), 400)
    sheet = Sheet()
    measure_accuracy(sheet, case, Renderer(case.scene(), effects=["wall"]).run(case.p_WT_m))
    assert sheet.number(case.name, "proxy to facets max") < 1e-7
    assert sheet.number(case.name, "force direction error max") < 8.0  # half a facet's turn at this size


def test_projection_closes_in_by_the_cosine_and_the_active_set_is_there() -> None:
    planes = groove(20.0)
    error = [alternating_error_m(planes, steps) for steps in (10, 11)]
    assert error[1] / error[0] == pytest.approx(np.cos(np.radians(20.0)), rel=1e-6)
    found, p = nearest(planes[0], TOOL_M, 0.0)
    assert found
    assert np.linalg.norm(p) < 1e-15


def test_projection_is_noted_for_each_groove() -> None:
    sheet = Sheet()
    measure_projection(sheet)
    assert len(sheet.cases("groove ")) == 3
