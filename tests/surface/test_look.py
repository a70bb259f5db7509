"""Pictures of a swatch: lossless files, and invalid or damaged pictures."""

import base64
import io
import json

import numpy as np
import pytest
from PIL import Image

import hapscene
from hapscene.errors import SwatchError
from hapscene.surface.look import PICTURE_BYTES_MAX, Look
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_file import swatch_from_json, swatch_to_json


def png(width: int = 4, height: int = 3, colour: tuple[int, int, int] = (255, 0, 0)) -> bytes:
    file = io.BytesIO()
    Image.new("RGB", (width, height), colour).save(file, "PNG")
    return file.getvalue()


FELT = Swatch("felt", look=Look(0.9, 0.02, png(), png(colour=(127, 127, 255))))


def changed(**keys: object) -> str:
    content = json.loads(swatch_to_json(FELT))
    content["look"] |= keys
    return json.dumps(content)


def test_written_and_read_look_are_equal() -> None:
    text = swatch_to_json(FELT)
    assert swatch_from_json(text) == FELT and json.loads(text)["version"] == 3
    look = swatch_from_json(text).look
    assert look is not None
    np.testing.assert_array_equal(look.albedo(), np.full((3, 4, 3), [1.0, 0.0, 0.0]))
    np.testing.assert_allclose(look.normal(), np.full((3, 4, 3), [0.0, 0.0, 1.0]), atol=0.01)
    inwards = Look(normal_png=png(colour=(255, 0, 0))).normal()
    np.testing.assert_allclose(inwards, np.full((3, 4, 3), np.array([1.0, -1.0, 0.05]) / np.sqrt(2.0025)))
    assert Look().albedo() is None and Look().normal() is None
    Look(0.0, 1e-4, png(512, 1), png(1, 512)), Look(1.0, 10.0)  # the largest


def test_bytes_and_pixels_are_limited() -> None:
    png_ = png() + bytes(PICTURE_BYTES_MAX - len(png()))
    Look(albedo_png=png_)
    for bad in (png_ + b"\0", png(513, 1), png(1, 513), png()[:23], png()[:16] + bytes(4) + png()[20:]):
        with pytest.raises(SwatchError, match="albedo_png"):
            Look(albedo_png=bad)


def test_swatch_without_look_has_version_2() -> None:
    content = json.loads(swatch_to_json(hapscene.Swatch("plain")))
    assert content["version"] == 2 and "look" not in content
    assert swatch_from_json(json.dumps(content | {"version": 3, "look": {}})).look == Look()


@pytest.mark.parametrize(
    ("keys", "field"),
    [
        ({"albedo_png": "no base64!"}, "albedo_png"),
        ({"albedo_png": "A" * (2 * PICTURE_BYTES_MAX + 4)}, "albedo_png"),
        ({"albedo_png": base64.b64encode(b"GIF89a" + bytes(50)).decode()}, "albedo_png"),
        ({"normal_png": base64.b64encode(png(600, 2)).decode()}, "600"),
        ({"roughness": 1.1}, "look.roughness"),
        ({"roughness": -0.1}, "look.roughness"),
        ({"size_m": 0.9e-4}, "look.size_m"),
        ({"size_m": 10.1}, "look.size_m"),
        ({"metalness": 1.0}, "metalness"),
    ],
)
def test_an_invalid_look_is_refused(keys: dict[str, object], field: str) -> None:
    with pytest.raises(SwatchError, match=field):
        swatch_from_json(changed(**keys))


def test_damaged_picture_is_ignored() -> None:
    good = png(64, 64)
    for bad in (good[:-30], good[:40] + bytes(60), good[:16] + (2**31 - 1).to_bytes(4, "big") * 2 + good[24:]):
        if int.from_bytes(bad[16:20], "big") > 512:
            with pytest.raises(SwatchError):
                Look(albedo_png=bad)
        else:
            assert Look(albedo_png=bad).albedo() is None
    twice = good[:33] + good[8:33] + good[33:]  # a second head, which may say anything
    twice = twice[:41] + (4096).to_bytes(4, "big") + twice[45:]
    assert Look(albedo_png=png()[:33] + png(600, 2)[8:]).albedo() is None
    found = Look(albedo_png=twice).albedo()
    assert found is None or found.shape == (64, 64, 3)
