"""Wavefront OBJ: what trimesh's own reader would change, and errors that name their line."""

import time

import pytest

from hapscene.errors import MeshError
from tests.scene.test_obj import read


def test_lines_that_go_on_and_on_are_joined_once(tmp_path):
    start_s = time.process_time()
    with pytest.raises(MeshError, match="no faces"):
        read(tmp_path, "\\\n" * 490_000)
    assert time.process_time() - start_s < 3.0


def test_a_line_of_many_joined_ones_takes_time_by_its_length(tmp_path):
    start_s = time.process_time()
    with pytest.raises(MeshError, match="line 111112: longer than 1,000,000 characters"):
        read(tmp_path, "v 0 0 0\\\n" * 120_000)
    assert time.process_time() - start_s < 2.0
