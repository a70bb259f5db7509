"""Paint from images and export of paint as images."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import hapscene
from hapscene.errors import SceneError
from hapscene.scene import uv_paint
from hapscene.scene.body import Body
from hapscene.scene.fine_paint import parts
from hapscene.scene.mesh import Mesh
from hapscene.scene.mesh_file import load_mesh
from hapscene.scene.scene import Scene
from hapscene.scene.uv_paint import (
    paint_by_picture,
    paint_of,
    paint_picture,
    picture_of,
    read_picture,
    save_picture,
    scaled,
)
from tests.subface_areas import areas_m2

FOREIGN = Path(__file__).parents[3] / "shared/data/meshes"
LEGEND = {(255, 0, 0): 1, (0, 255, 0): 2, (0, 0, 255): 3}
SIZE = 256


def scene_of(name: str, unit: str | None) -> tuple[Scene, Body]:
    if not (FOREIGN / name).exists():
        pytest.skip(f"the foreign mesh {name} is not available")
    return with_swatches(load_mesh(FOREIGN / name, unit))


def with_swatches(mesh: Mesh) -> tuple[Scene, Body]:
    scene = Scene()
    body = scene.add(mesh, name="square")
    for swatch in ("wood", "leather", "paper"):
        scene.swatch_index(swatch)
    return scene, body


def square() -> Mesh:
    """A square of 20 mm, its picture upright on it."""
    corners = np.array([[0, 0, 0], [0.02, 0, 0], [0.02, 0.02, 0], [0, 0.02, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    return Mesh(corners, faces, uv=(corners[:, :2] / 0.02)[faces])


def picture(which: NDArray[np.int64]) -> NDArray[np.uint8]:
    """Colours of the legend by number (h, w)."""
    colours = np.array(list(LEGEND), np.uint8)[which]
    return np.dstack([colours, np.full(which.shape, 255, np.uint8)])


@pytest.mark.parametrize(("name", "unit"), [("Duck.glb", None), ("fuze.zip", "m")])
def test_roundtrip_of_an_image(name: str, unit: str | None) -> None:
    scene, body = scene_of(name, unit)
    y, x = np.mgrid[:SIZE, :SIZE]
    which = (np.hypot(x - 90, y - 120) < 70) * 1 + (x // 19 + y // 27) % 2
    before = picture(which)
    assert len(paint_picture(body, paint_of(before, LEGEND))) == len(body.mesh.faces)
    after = picture_of(scene, body, LEGEND, (SIZE, SIZE))
    covered = after[..., 3] > 0
    others = (after != before).any(axis=2) & covered
    border = np.zeros_like(covered)
    for axis in (0, 1):
        change = np.diff(which, axis=axis) != 0
        border |= np.pad(change, [(0, 1) if a == axis else (0, 0) for a in (0, 1)])
        border |= np.pad(change, [(1, 0) if a == axis else (0, 0) for a in (0, 1)])
    assert covered.sum() > 5000 and not (others & ~border).any()
    assert others.sum() <= 2  # texels whose centre is on a border


def test_orientation_and_sharpness() -> None:
    _scene, body = with_swatches(square())
    which = np.zeros((64, 64), np.int64)
    which[:16, :40] = 1  # upper left
    paint_picture(body, paint_of(picture(which), LEGEND))
    assert body.fine is not None

    def at(x_mm: float, y_mm: float) -> int:
        """The swatch at a place; the first face is below the diagonal."""
        x, y = x_mm / 20, y_mm / 20
        face, bary = (0, (1 - x, x - y, y)) if y < x else (1, (1 - y, x, y - x))
        paint = body.fine.at(face, np.array(bary))
        return int(parts(body.face_swatch[face] if paint is None else paint)[0])

    texel_mm = 20 / 64
    assert at(1, 19) == 2 and at(19, 19) == 1 and at(1, 1) == 1
    for y_mm in (15.5, 17.0, 19.5):
        assert at(12.5 - 0.51 * texel_mm, y_mm) == 2 and at(12.5 + 0.51 * texel_mm, y_mm) == 1
    areas = areas_m2(body.fine, body.mesh)[parts(body.fine.paint)[0] == 2].sum()
    assert areas == pytest.approx(0.0125 * 0.005, rel=0.02)


def test_greys_are_blends() -> None:
    scene, body = with_swatches(square())
    grey = np.tile(np.linspace(0, 255, 64).astype(np.uint8), (64, 1))
    legend = {(0, 0, 0): 1, (255, 255, 255): 2}
    paint_picture(body, paint_of(np.dstack([grey] * 3 + [np.full_like(grey, 255)]), legend))
    assert body.fine is not None
    first, second, weight = parts(body.fine.paint)
    of_white = np.where(first == 2, 1 - weight, np.where((second == 2) & (weight > 0), weight, 0))
    x = (body.fine.corners_m(body.mesh).mean(axis=1) / 0.02)[:, 0]
    assert np.abs(of_white - x).max() < 1 / 32 + 1 / 64
    out = picture_of(scene, body, legend, (64, 64))
    assert np.abs(out[..., 0].astype(int) - grey).max() <= 8  # a step of 3 %


def test_transparent_texels_are_not_painted() -> None:
    scene, body = with_swatches(square())
    scene.paint("square", "paper")
    clear = picture(np.zeros((8, 8), np.int64))
    clear[:, 4:, 3] = 0
    paint_picture(body, paint_of(clear, LEGEND))
    out = picture_of(scene, body, LEGEND, (8, 8))
    assert (out[:, :4, :3] == (255, 0, 0)).all() and (out[:, 4:, :3] == (0, 0, 255)).all()


def test_image_with_legend_transfers_paint(tmp_path: Path) -> None:
    scene, body = with_swatches(square())
    which = np.arange(16).reshape(4, 4) % 3
    paint_picture(body, paint_of(picture(which), LEGEND))
    harder = scaled("wood", {"stiffness": 2.0, "friction": 0.5, "texture": 3.0})
    scene.paint("square", harder, [1])
    made = save_picture(scene, body, tmp_path / "map.png")
    assert [file.suffix for file in made] == [".png", ".swatch", ".json"]

    other = Scene()
    other.add(square(), name="square")
    assert paint_by_picture(other, None, tmp_path / "map.png") == 2
    names = {swatch.name for swatch in other.swatches}
    assert harder.name in names and {"wood", "leather", "paper"} <= names
    again = save_picture(other, other.bodies[0], tmp_path / "again.png")[0]
    assert np.array_equal(np.asarray(Image.open(made[0])), np.asarray(Image.open(again)))
    wood = hapscene.load_swatch("wood")
    assert harder.stiffness_N_m == 2 * wood.stiffness_N_m and harder.friction_static == 0.5 * wood.friction_static
    assert harder.parameter("lpc_texture", "texture_gain", 1.0) == 3.0


@pytest.mark.parametrize(
    ("legend", "name"),
    [
        ("[]", "map"),
        ('{"red": "wood"}', "red"),
        ('{"#ff0000": "wud"}', "wud"),
        ('{"#ff0000": {"swatch": "wood", "weight": 2}}', "weight"),
        ('{"#ff0000": {"swatch": "wood", "stiffness": -1}}', "stiffness"),
    ],
)
def test_invalid_legend_raises_one_line(legend: str, name: str, tmp_path: Path) -> None:
    Image.fromarray(picture(np.zeros((2, 2), np.int64))).save(tmp_path / "map.png")
    (tmp_path / "map.json").write_text(legend)
    scene, _ = with_swatches(square())
    with pytest.raises(hapscene.errors.HapsceneError, match=name) as caught:
        paint_by_picture(scene, "square", tmp_path / "map.png")
    assert "\n" not in str(caught.value)


def test_invalid_image_or_missing_coordinates_raise(tmp_path: Path) -> None:
    (tmp_path / "map.png").write_bytes(b"\x89PNG\r\n\x1a\n but no more")
    with pytest.raises(SceneError):
        read_picture(tmp_path / "map.png")
    Image.new("L", (5000, 5000)).save(tmp_path / "large.png")
    with pytest.raises(SceneError):
        read_picture(tmp_path / "large.png")
    bare = square()
    _scene, body = with_swatches(Mesh(bare.vertices_m, bare.faces))
    with pytest.raises(SceneError):
        paint_picture(body, np.zeros((2, 2), np.int64))


def test_repeated_texture_coordinates() -> None:
    tiled = square()
    assert tiled.uv is not None
    _scene, body = with_swatches(Mesh(tiled.vertices_m, tiled.faces, uv=3 * tiled.uv - 1))
    which = np.zeros((16, 16), np.int64)
    which[:, 8:] = 1
    paint_picture(body, paint_of(picture(which), LEGEND))
    assert body.fine is not None
    x = body.fine.corners_m(body.mesh).mean(axis=1)[:, 0] / 0.02
    assert (parts(body.fine.paint)[0] == np.where(3 * x % 1 < 0.5, 1, 2)).all()


def test_huge_texture_coordinates_raise() -> None:
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]])
    for far in (1e3, 1e30):
        uv = np.array([[[0, 0], [far, 0], [0, far]]], np.float32)
        scene, body = with_swatches(Mesh(corners, np.array([[0, 1, 2]]), np.zeros(1, np.int16), ("all",), uv=uv))
        with pytest.raises(SceneError):
            picture_of(scene, body, {(0, 0, 0): 0}, (SIZE, SIZE))


def test_photograph_is_quantized(monkeypatch: pytest.MonkeyPatch) -> None:
    photograph = np.random.default_rng(3).integers(0, 256, (40, 40, 4), np.uint8)
    photograph[..., 3] = 255
    greys = {(0, 0, 0): 1, (255, 255, 255): 2}
    colours = {**greys, (255, 0, 0): 3}

    def whitish(legend: dict[tuple[int, int, int], int]) -> NDArray[np.float64]:
        monkeypatch.setattr(uv_paint, "FAR", 500.0)
        heavier, lighter, weight = parts(paint_of(photograph, legend))
        return np.where(heavier == 2, 1 - weight, np.where(lighter == 2, weight, 0))

    exact = whitish(greys)
    monkeypatch.setattr(uv_paint, "COLOUR_MAX", 100)
    assert 0 < np.abs(whitish(greys) - exact).max() <= 0.05
    assert whitish(colours).shape == (40, 40)


def test_colour_far_from_the_legend_raises(tmp_path: Path) -> None:
    image = picture(np.zeros((32, 32), np.int64))
    image[0, :5, :3] = (255, 0, 255)  # a few texels at edges are tolerated
    scene, body = with_swatches(square())
    paint_picture(body, paint_of(image, LEGEND))
    image[:8, :, :3] = (250, 240, 230)
    Image.fromarray(image).save(tmp_path / "map.png")
    with pytest.raises(SceneError, match="#faf0e6"):
        paint_by_picture(scene, None, tmp_path / "map.png", {c: scene.swatches[i] for c, i in LEGEND.items()})
