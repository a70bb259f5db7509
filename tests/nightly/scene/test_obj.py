"""Speed of the OBJ reader on continued lines."""

import time

import pytest

from hapscene.errors import MeshError
from tests.scene.test_obj import read


def test_many_continued_lines(tmp_path):
    start_s = time.process_time()
    with pytest.raises(MeshError, match="no faces"):
        read(tmp_path, "\\\n" * 490_000)
    assert time.process_time() - start_s < 3.0


def test_long_continued_line(tmp_path):
    start_s = time.process_time()
    with pytest.raises(MeshError, match="line 111112: longer than 1,000,000 characters"):
        read(tmp_path, "v 0 0 0\\\n" * 120_000)
    assert time.process_time() - start_s < 2.0
