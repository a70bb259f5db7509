"""Speed of the size checks of glTF files."""

import json
import time
from pathlib import Path

import numpy as np

from hapscene.scene import mesh_file
from tests.scene.test_gltf_check import gltf

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()


VIEW = {"buffer": 0, "byteLength": len(POINTS)}


def test_check_of_a_large_file_is_fast(tmp_path: Path) -> None:
    """As many views and accessors as a file of 10,000 parts has."""
    count = 40_000
    accessors = [{"bufferView": i, "componentType": 5126, "type": "VEC3", "count": 3} for i in range(count)]
    content = json.dumps(gltf(bufferViews=[VIEW] * count, accessors=accessors)).encode()
    start_s = time.process_time()
    mesh_file.check("gltf", content, "large.gltf")
    assert time.process_time() - start_s < 2.0
