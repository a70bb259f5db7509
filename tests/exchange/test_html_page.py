"""Pages to touch: content, paint, reduction, and untrusted names. tests/nightly/exchange has them in a browser."""

import base64
import hashlib
import json
import zlib
from dataclasses import replace
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest
import trimesh

from hapscene.constants import ACCELERATION_RATE_HZ
from hapscene.errors import SceneError
from hapscene.exchange.html_page import html_page
from hapscene.scene.region import Box, Sphere
from hapscene.scene.scene import Scene
from hapscene.surface.effect import load_effect
from hapscene.swatches.library import load_swatch
from hapscene.view.palette import rgb

HOSTILE = "</script><img src=x onerror=alert(1)><!--<script>"


class Reader(HTMLParser):
    """Elements, attributes and the text of scripts, styles and the title."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[tuple[str, str]] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        if self.found and self.found[-1][0] in ("script", "style", "title") and data.strip():
            self.texts.append((self.found[-1][0], data))


def content_of(page: str) -> dict[str, Any]:
    """Return the data of a page, with arrays."""
    content = json.loads(next(text for tag, text in Reader(page).texts if tag == "script"))
    block = zlib.decompress(base64.b64decode(content["data"]))

    def expand(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: expand(item) for key, item in value.items()}
        if isinstance(value, list) and len(value) == 3 and value[0] in ("u1", "i1", "u2", "u4", "f4"):
            return np.frombuffer(block, "<" + value[0], value[2], value[1])
        return [expand(item) for item in value] if isinstance(value, list) else value

    return expand(content)


def triangles(content: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Return corners (m, 3, 3) [m] and the name of the swatch (m,) of all triangles."""
    places = content["position"].reshape(-1, 3) / 65535 * content["size"] + content["low"]
    faces = content["faces"].reshape(-1, 3)
    names = np.array([swatch["name"] for swatch in content["swatches"]])
    kind = content["swatch"][faces]
    assert (kind == kind[:, :1]).all()
    return places[faces], names[kind[:, 0]]


def area_of(corners: np.ndarray) -> np.ndarray:
    return np.asarray(trimesh.triangles.area(corners))


def painted_box(radius_m: float = 0.005) -> Scene:
    scene = Scene()
    scene.add(trimesh.creation.box((0.04, 0.03, 0.02)), unit="m", swatch="wood")
    scene.paint("body", "paper", Sphere((0.0, 0.0, 0.01), radius_m))
    return scene


def test_page_loads_nothing() -> None:
    page = html_page(painted_box(), "box")
    reader = Reader(page)
    addresses = [value for _, attrs in reader.found for name, value in attrs.items() if name in ("src", "href")]
    assert addresses == ["data:,"] and "http:" not in page and "https:" not in page and "url(" not in page
    policy = next(str(attrs["content"]) for _, attrs in reader.found if "http-equiv" in attrs)
    assert policy.startswith("default-src 'none'") and "unsafe" not in policy
    programs = [text for tag, text in reader.texts if tag != "title"]
    for text in [text for text in programs if not text.startswith("{")]:
        assert f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'" in policy


def test_untrusted_names_are_escaped() -> None:
    scene = Scene()
    hostile = replace(load_swatch("wood"), name=HOSTILE)
    scene.add(trimesh.creation.box((0.04, 0.03, 0.02)), name=HOSTILE, unit="m", swatch=hostile)
    page = html_page(scene, HOSTILE)
    reader, plain = Reader(page), Reader(html_page(painted_box(), "box"))
    assert [tag for tag, _ in reader.found] == [tag for tag, _ in plain.found]
    content = content_of(page)
    assert content["bodies"][0]["name"] == content["swatches"][0]["name"] == HOSTILE
    assert HOSTILE[:39] in content["bodies"][0]["task"]


def test_shape_and_paint(scene: Scene) -> None:
    content = content_of(html_page(scene, "scene"))
    corners, names = triangles(content)
    start = 0
    for body, shown in zip(scene.bodies, content["bodies"], strict=True):
        rows = slice(shown["first"] // 3, (shown["first"] + shown["count"]) // 3)
        expected = body.mesh.triangles_m @ body.X_WB[:3, :3].T + body.X_WB[:3, 3]
        np.testing.assert_allclose(corners[rows], expected, atol=max(content["size"]) / 65535)
        assert [scene.swatches[i].name for i in body.face_swatch] == names[rows].tolist()
        start += len(expected)
    assert start == len(corners)
    assert content["colour"].size == content["position"].size and content["main"] == 0
    assert content["scale"] == pytest.approx(1.0)  # a scene of 0.4 m


def test_border_is_where_it_was_painted() -> None:
    content = content_of(html_page(painted_box(), "box"))
    corners, names = triangles(content)
    kinds = content["swatches"]
    assert [kinds[i]["name"] for i in content["bodies"][0]["swatches"]] == ["wood", "paper"]  # by area
    assert content["scale"] * np.linalg.norm(content["size"]) == pytest.approx(0.15)
    colours = 255 * np.array([rgb(kind["colour"]) for kind in kinds])[content["swatch"]]
    assert np.abs(content["colour"].reshape(-1, 3) - colours).max() < 0.51
    paper = corners[names == "paper"]
    assert area_of(paper).sum() == pytest.approx(np.pi * 0.005**2, rel=0.01)
    assert np.abs(np.linalg.norm(paper.reshape(-1, 3) - (0, 0, 0.01), axis=1)).max() < 0.00515


def test_large_meshes_are_reduced() -> None:
    scene = Scene()
    scene.add(trimesh.creation.icosphere(subdivisions=5, radius=0.03), unit="m", swatch="wood")
    scene.paint("body", "paper", Box((-1.0, -1.0, 0.01), (1.0, 1.0, 1.0)))
    corners, names = triangles(content_of(html_page(scene, "ball", shown_max=3000)))
    assert 2000 < len(corners) <= 3000
    cap_m2 = 2 * np.pi * 0.03 * 0.02
    assert area_of(corners[names == "paper"]).sum() == pytest.approx(cap_m2, rel=0.02)
    assert area_of(corners).sum() == pytest.approx(4 * np.pi * 0.03**2, rel=0.02)
    assert corners[names == "paper"][..., 2].min() > 0.01 - 0.0008


@pytest.mark.parametrize("shown_max", [150_000, 20])
def test_bodies_without_area_are_left_out(shown_max: int) -> None:
    scene, flat = Scene(), np.zeros((40, 3))
    flat[:, 0] = np.linspace(0.0, 0.1, 40)
    with pytest.raises(SceneError):
        html_page(scene, "empty")
    with pytest.warns(UserWarning):
        scene.add(trimesh.Trimesh(flat, np.arange(39).reshape(-1, 3), process=False), name="flat", unit="m")
    with pytest.raises(SceneError):
        html_page(scene, "flat")
    scene.add(trimesh.creation.box((0.04, 0.03, 0.02)), name="box", unit="m", swatch="wood")
    content = content_of(html_page(scene, "both", shown_max=shown_max))
    assert [body["name"] for body in content["bodies"]] == ["box"]
    assert len(triangles(content)[0]) == 12


def test_swatches_have_the_tables_of_the_effects() -> None:
    scene = painted_box()
    loud = replace(load_swatch("leather"), name="loud", effects={"lpc_texture": {"texture_gain": 2.0}})
    scene.paint("body", loud, Sphere((0.02, 0.0, 0.0), 0.004))
    shown = {swatch["name"]: swatch for swatch in content_of(html_page(scene, "box"))["swatches"]}
    assert set(shown) == {"wood", "paper", "loud"}
    table = load_effect("lpc_texture").table
    assert table is not None
    for name, swatch in (("wood", load_swatch("wood")), ("loud", loud)):
        np.testing.assert_allclose(shown[name]["table"], table(swatch, ACCELERATION_RATE_HZ), rtol=1e-6)
    assert shown["loud"]["gain"] == 2.0
    for swatch in shown.values():  # a grain neither tilts nor darkens the surface on average
        assert swatch["grain"].reshape(-1, 3).mean(axis=0) == pytest.approx(128.0, abs=4.0)
    assert swatch_without_texture()["table"].size == swatch_without_texture()["tap"].size == 0


def swatch_without_texture() -> dict[str, Any]:
    scene = Scene()
    scene.add(trimesh.creation.box((0.04, 0.03, 0.02)), unit="m")
    scene.add(trimesh.creation.box((1.0, 1.0, 1.0)), name="large", unit="m", swatch="wood")
    scene.paint("large", "paper", np.arange(2))
    content = content_of(html_page(scene, "plain"))
    assert content["main"] == 1 and content["scale"] * np.linalg.norm(content["size"]) == pytest.approx(0.5)
    return dict(content["swatches"][0])
