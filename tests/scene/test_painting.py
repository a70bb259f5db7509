"""A painting as it stands in a scene file: exact both ways, compact, and safe to read from anybody."""

import base64
import json
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from trimesh.creation import icosphere

import hapscene
from hapscene.scene.painting import RUN_MAX, read, written


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 300), st.integers(1, 40)), min_size=1, max_size=60), st.booleans())
def test_every_painting_comes_back(runs: list[tuple[int, int]], packed: bool) -> None:
    paint = np.repeat([r[0] for r in runs], [r[1] for r in runs]).astype(np.int16)
    if packed:  # many short runs over the same swatches
        paint = np.resize(np.concatenate([paint, paint[::-1]]), 3 * RUN_MAX)
        paint[::2] = (paint[::2] + 1) % 301
    value = json.loads(json.dumps(written(paint)))
    np.testing.assert_array_equal(read(value, len(paint), 301), paint)


def test_few_runs_are_for_reading_and_many_are_packed() -> None:
    paint = np.repeat(np.arange(RUN_MAX, dtype=np.int16), 2)
    assert written(paint) == [[i, 2] for i in range(RUN_MAX)]
    more = np.repeat(np.arange(RUN_MAX + 1, dtype=np.int16), 2)
    assert isinstance(written(more), str)


def test_a_mesh_painted_face_by_face_takes_less_than_a_byte_a_face() -> None:
    paint = np.random.default_rng(0).integers(0, 6, 330_000).astype(np.int16)
    text = written(paint)
    assert isinstance(text, str)
    assert len(text) < len(paint)
    np.testing.assert_array_equal(read(text, len(paint), 6), paint)


def packed(content: bytes) -> str:
    return base64.b64encode(zlib.compress(content)).decode()


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("no base64!", "damaged"),
        (base64.b64encode(b"no zlib").decode(), "damaged"),
        (packed(bytes(6)), "another number of faces"),
        (packed(bytes(10)), "another number of faces"),
        (packed(bytes(100_000_000)), "another number of faces"),  # 100 kB that would grow to 100 MB
        (base64.b64encode(zlib.compress(bytes(8))[:-2]).decode(), "cut off"),
        (packed(np.array([0, 1, 2, 3], "<i2").tobytes()), "names swatch 3; there are 3"),
        (packed(np.array([0, 1, -1, 2], "<i2").tobytes()), "names swatch -1"),
        ({}, "must be a list of runs or a packed text"),
    ],
)
def test_hostile_paintings(value: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        read(value, 4, 3)


def test_a_scene_with_a_packed_painting(tmp_path) -> None:
    scene = hapscene.Scene()
    icosphere(subdivisions=4).export(tmp_path / "ball.ply")
    scene.add(tmp_path / "ball.ply", unit="mm")
    for name in ("wood", "paper"):
        scene.paint("ball", name, np.random.default_rng(len(name)).random(5120) < 0.4)
    scene.save(tmp_path / "my.scene.json")
    content = json.loads((tmp_path / "my.scene.json").read_text())
    assert content["version"] == 2
    assert isinstance(content["bodies"][0]["paint"], str)
    back = hapscene.load_scene(tmp_path / "my.scene.json")
    np.testing.assert_array_equal(back.bodies[0].face_swatch, scene.bodies[0].face_swatch)
    scene.paint("ball", "plain")
    scene.save(tmp_path / "my.scene.json")
    assert json.loads((tmp_path / "my.scene.json").read_text())["version"] == 1  # older readers can read that
