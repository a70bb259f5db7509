"""Painting by picture: an image over a body's texture coordinates says which swatch is where, to a texel; in and out.

A *legend* says what its colours mean: a swatch each. A colour between two of them is a blend of the two by weight: so a
grey map from black to white goes from one swatch to another, which may be one swatch with a number scaled. Where a
picture is transparent, the painting stays. The legend of `map.png` is `map.json` beside it:

    {"#b5651d": "wood", "#000000": {"swatch": "rubber", "stiffness": 0.5}, "#ffffff": {"swatch": "rubber"}}
"""

import io
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import SceneError, no_such
from hapscene.io.files import check_keys, parse_json, read_bytes, refusing, write_whole
from hapscene.scene.fine_paint import (
    LEAF_MAX,
    LEVEL_MAX,
    NOTHING,
    FinePaint,
    blend,
    halves,
    parts,
    put_leaves,
    whole_faces,
)
from hapscene.surface.swatch import FRICTION_MAX, Swatch, SwatchLike

if TYPE_CHECKING:
    from hapscene.scene.body import Body
    from hapscene.scene.scene import Scene

__all__ = [
    "body_with_uv",
    "paint_by_picture",
    "paint_of",
    "paint_picture",
    "picture_of",
    "read_picture",
    "save_picture",
    "scaled",
]

Legend = Mapping[tuple[int, int, int], int]
"""The scene's swatch of each colour, 0 to 255."""

Meanings = Mapping[tuple[int, int, int], SwatchLike]
"""What each colour means, 0 to 255."""

FILE_MAX_B: Final = 64_000_000
"""Largest picture file that is read [bytes]."""

TEXEL_MAX: Final = 4096 * 4096
"""Most texels of a picture [count]."""

NEAR: Final = 20.0
"""How far a colour may be from one of the legend's and still be it, of 255 a channel: what JPEG makes of a surface."""

FAR: Final = 80.0
"""How far a colour may be from all that the legend means, blends too, of 255 a channel, before it is refused; a few
texels may, where a JPEG has an edge."""

FAR_SHARE: Final = 0.005
"""Most texels that may be so far, of all [1]."""

BLEND_STEPS: Final = 32
"""Weights of a blend are whole parts of this [count]: 3 %, where 8 % of a stiffness is felt (Jones and Hunter 1990)."""

SPAN_MAX: Final = 4_000_000
"""Most texels that are written at once [count]."""

COLOUR_MAX: Final = 65_536
"""Most colours of a picture that are told apart [count]: in a photograph those that differ by less than 8 of 255 are
one."""

LEGEND_MAX: Final = 200
"""Most colours of a legend [count]: any two of them may blend."""

REPEAT_MAX: Final = 64
"""How often a picture may be covered that is written [count]: texture coordinates that repeat it have no one colour."""

SCALED: Final = ("stiffness", "friction", "texture")
"""Numbers of a swatch that a legend may scale."""


def read_picture(source: Path | bytes, name: str = "picture") -> NDArray[np.uint8]:
    """A picture (h, w, 4) of a file, or of its content, from anybody.

    Raises:
        SceneError: it is missing, no PNG, JPEG, WebP, BMP or TIFF, damaged, or too large.
    """
    from PIL import Image

    where = str(source) if isinstance(source, Path) else name
    with refusing(SceneError):
        content = read_bytes(source, FILE_MAX_B, "picture") if isinstance(source, Path) else source
    try:
        with Image.open(io.BytesIO(content), formats=("PNG", "JPEG", "WEBP", "BMP", "TIFF")) as image:
            if image.width * image.height > TEXEL_MAX:
                raise SceneError(f"{where}: {image.width} × {image.height} pixels; at most {TEXEL_MAX:,} are read")
            return np.asarray(image.convert("RGBA"))
    except SceneError:
        raise
    except Exception:  # its readers raise anything at all on a damaged file
        raise SceneError(f"{where}: not a picture that can be read; expected PNG, JPEG, WebP, BMP or TIFF") from None


def read_legend(picture: Path, scene: "Scene") -> Legend:
    """The legend beside a picture; without one, the scene's own swatches by their colours.

    Raises:
        SceneError: it is damaged, or says no swatch.
        SwatchError: a swatch is unknown or broken.
    """
    file = picture.with_suffix(".json")
    if not file.is_file():
        return legend_of(scene)
    with refusing(SceneError, file):
        content = parse_json(read_bytes(file, 1_000_000, "legend"), "a legend")
        if not isinstance(content, dict) or not 0 < len(content) <= LEGEND_MAX:
            raise SceneError(f'expected an object of at most {LEGEND_MAX} colours, as in {{"#b5651d": "wood"}}')
        return {_rgb(colour): _meant(told, file, scene) for colour, told in content.items()}


def _rgb(text: str) -> tuple[int, int, int]:
    if not re.fullmatch(r"#[0-9a-fA-F]{6}", text):
        raise SceneError(f"{text[:40]!r} is no colour; expected one as #b5651d")
    red, green, blue = bytes.fromhex(text[1:])
    return red, green, blue


def _meant(told: Any, file: Path, scene: "Scene") -> int:
    """The scene's index of what a legend says: one of its swatches or of the library's by name, a file beside the
    legend, or one of them with numbers scaled."""
    if not isinstance(told, dict):
        told = {"swatch": told}
    check_keys("", told, ("swatch", "file", *SCALED), ("swatch",))
    factors = {what: value for what, value in told.items() if what in SCALED}
    name, beside = told["swatch"], told.get("file", "")
    if not isinstance(name, str) or not isinstance(beside, str):
        raise SceneError(f"expected the name of a swatch, found {str(name)[:40]!r}")
    own = next((swatch for swatch in scene.swatches if swatch.name == name), None)
    beside = beside or (name if name.endswith(".swatch") else "")
    found: SwatchLike = own or (file.parent / beside if beside else name)
    return scene.swatch_index(scaled(found, factors) if factors else found)


def legend_of(scene: "Scene") -> Legend:
    """The swatches of a scene by their colours, made distinct."""
    legend: dict[tuple[int, int, int], int] = {}
    for index, swatch in enumerate(scene.swatches):
        red, green, blue = (round(255 * c) for c in swatch.albedo_rgb)
        while (red, green, blue) in legend:
            blue = (blue + 37) % 256
        legend[red, green, blue] = index
    return legend


def scaled(swatch: SwatchLike, factors: Mapping[str, float]) -> Swatch:
    """A swatch with stiffness, friction or the gain of its texture times a factor, and a name that says so.

    Raises:
        SceneError: another number, or an invalid factor.
        SwatchError: the swatch is unknown or broken.
    """
    from hapscene.swatches.library import load_swatch

    found = swatch if isinstance(swatch, Swatch) else load_swatch(swatch)
    for what, factor in factors.items():
        if what not in SCALED:
            raise SceneError(no_such("number to scale", what, SCALED))
        if isinstance(factor, bool) or not isinstance(factor, int | float) or not 0.0 <= factor <= 100.0:
            raise SceneError(f"{what} is scaled by a number from 0 to 100, not {str(factor)[:40]}")
        if what == "stiffness":
            found = replace(found, stiffness_N_m=factor * found.stiffness_N_m)
        elif what == "friction":
            static, dynamic = (min(factor * f, FRICTION_MAX) for f in (found.friction_static, found.friction_dynamic))
            found = replace(found, friction_static=static, friction_dynamic=dynamic)
        else:
            own = {**found.effects.get("lpc_texture", {})}
            own["texture_gain"] = factor * own.get("texture_gain", 1.0)
            found = replace(found, effects={**found.effects, "lpc_texture": own})
    named = ", ".join(f"{what} ×{factor:g}" for what, factor in factors.items())
    return replace(found, name=f"{found.name} {named}", intervals={}, absent={}) if factors else found


def paint_of(picture: NDArray[np.uint8], legend: Legend) -> NDArray[np.int64]:
    """The paint (h, w) that a picture (h, w, 4) means, see `hapscene.scene.fine_paint.parts`; −1 where transparent.

    Raises:
        SceneError: a colour of it is far from all that the legend means.
    """
    known, swatches = np.array(list(legend), np.float64), np.array(list(legend.values()))
    packed = picture[..., :3].astype(np.uint32) @ np.array([65536, 256, 1], np.uint32)
    values, place = np.unique(packed, return_inverse=True)
    if len(values) > COLOUR_MAX:
        values, place = np.unique(packed & 0xF8F8F8 | 0x040404, return_inverse=True)
    colours = np.stack([values >> 16, values >> 8 & 255, values & 255], axis=1).astype(np.float64)
    away_least, nearest = np.full(len(colours), np.inf), np.zeros(len(colours), np.intp)
    for i, colour in enumerate(known):  # one by one: a photograph has millions of colours
        off = np.linalg.norm(colours - colour, axis=1)
        nearest[off < away_least] = i
        np.minimum(away_least, off, out=away_least)
    paint = np.array(swatches, np.int64)[nearest]
    between = np.flatnonzero(away_least > (NEAR if len(known) > 2 else 0.0))
    best = away_least[between]
    for i, j in combinations(range(len(known)), 2):
        way = known[j] - known[i]
        share = np.clip((colours[between] - known[i]) @ way / (way @ way), 0.0, 1.0)
        away = np.linalg.norm(colours[between] - known[i] - share[:, None] * way, axis=1)
        weight = np.rint(BLEND_STEPS * share) / BLEND_STEPS
        nearer = away < best
        paint[between[nearer]] = blend(swatches[i], swatches[j], weight[nearer])
        best = np.minimum(best, away)
    away_least[between] = best
    clear = picture[..., 3] < 128
    count = np.bincount(place.ravel(), ~clear.ravel()) * (away_least > FAR)
    if count.sum() > FAR_SHARE * clear.size:
        odd = "#{:02x}{:02x}{:02x}".format(*colours[count.argmax()].astype(int))
        meant = ", ".join("#{:02x}{:02x}{:02x}".format(*colour) for colour in list(legend)[:8])
        raise SceneError(
            f"its colour {odd} is far from all that mean a swatch ({meant}): paint it in those, or give a legend "
            f'beside it, as {{"{odd}": "wood"}}'
        )
    return np.where(clear, -1, paint[place].reshape(packed.shape))


def paint_picture(body: "Body", paint: NDArray[np.int64]) -> NDArray[np.int64]:
    """Paint a body as the paints (h, w) of a picture over its texture coordinates say; the faces that have any.

    Raises:
        SceneError: its mesh has no texture coordinates, or the picture needs more than `LEAF_MAX` leaves.
    """
    corners_px = _corners_px(body, paint.shape)
    faces = np.flatnonzero(np.isfinite(corners_px).all(axis=(1, 2)))
    had = (body.fine or NOTHING).of_faces(faces)
    plain = np.setdiff1d(faces, had.faces, assume_unique=True)
    front = had.with_faces(plain, whole_faces(plain, body.face_swatch[plain]))
    where_px = front.corners() @ corners_px[front.face]
    uniform = _Uniform(paint)
    done: list[FinePaint] = []
    while len(front):
        side_px = np.linalg.norm(where_px - np.roll(where_px, 1, axis=1), axis=2).max(axis=1)
        cut = (side_px > 1.0) & (front.level < LEVEL_MAX) & ~uniform.within(where_px)
        x, y = np.floor(where_px[~cut].mean(axis=1)).astype(np.int64).T
        found = paint[y % paint.shape[0], x % paint.shape[1]]
        leaves = front[~cut]
        done.append(replace(leaves, paint=np.where(found < 0, leaves.paint, found)))
        front, where_px = halves(front[cut], where_px[cut])
        if sum(map(len, done)) + len(front) > LEAF_MAX:
            raise SceneError(
                f"body {body.name!r}: this picture needs more than {LEAF_MAX:,} pieces; a smaller one, or one of fewer "
                "colours, needs fewer"
            )
    columns = zip(*((d.face, d.path, d.edge, d.level, d.paint) for d in (NOTHING, *done)), strict=True)
    leaves = FinePaint(*(np.concatenate(values) for values in columns))
    put_leaves(body, leaves[np.lexsort((leaves.path, leaves.face))])
    return faces


class _Uniform:
    """Tells where a picture has one paint: sums of its changes over rectangles, one look-up each."""

    def __init__(self, paint: NDArray[np.int64]) -> None:
        self._shape = paint.shape
        across, down = np.zeros(paint.shape, np.bool_), np.zeros(paint.shape, np.bool_)
        across[:, 1:], down[1:] = paint[:, 1:] != paint[:, :-1], paint[1:] != paint[:-1]
        self._across, self._down = (np.pad(_summed(change), ((1, 0), (1, 0))) for change in (across, down))

    def within(self, where_px: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether the boxes around triangles (n, 3, 2) have one paint each; over the picture's edge they have not."""
        low = np.floor(where_px.min(axis=1)).astype(np.int64)
        high = np.maximum(np.ceil(where_px.max(axis=1)).astype(np.int64) - 1, low)
        size = np.array(self._shape[::-1])
        tile = low // size
        (x0, y0), (x1, y1) = (low - tile * size).T, (high - tile * size).T
        inside = (high // size == tile).all(axis=1)
        x1, y1 = np.where(inside, x1, x0), np.where(inside, y1, y0)
        changes = _sum(self._across, x0 + 1, y0, x1, y1) + _sum(self._down, x0, y0 + 1, x1, y1)
        return np.asarray(inside & (changes == 0))


def _summed(change: NDArray[np.bool_]) -> NDArray[np.int32]:
    return np.asarray(change.cumsum(axis=0, dtype=np.int32).cumsum(axis=1, dtype=np.int32))


def _sum(table: NDArray[np.int32], x0: Any, y0: Any, x1: Any, y1: Any) -> NDArray[np.int32]:
    """Sums over texels x0 … x1, y0 … y1, both counted; 0 where there are none."""
    x1, y1 = np.maximum(x1 + 1, x0), np.maximum(y1 + 1, y0)
    return np.asarray(table[y1, x1] - table[y0, x1] - table[y1, x0] + table[y0, x0])


def _corners_px(body: "Body", shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Where the corners of the faces are in a picture (h, w), x and y downward (m, 3, 2) [texels]."""
    uv = body.mesh.uv
    if uv is None:
        raise SceneError(
            f"body {body.name!r}: its mesh has no texture coordinates to lay a picture on; unwrap it in a modeller, "
            "and export it as GLB or OBJ"
        )
    return np.asarray((uv * np.array([1.0, -1.0]) + np.array([0.0, 1.0])) * np.array(shape[1::-1]), np.float64)


def picture_of(scene: "Scene", body: "Body", legend: Legend, size: tuple[int, int] = (1024, 1024)) -> NDArray[np.uint8]:
    """The painting of a body as a picture (h, w, 4): at each texel's middle the colour of what is painted there.

    Blends have the mean of their two colours by weight; where no face is, it is transparent.

    Args:
        scene: that has the body.
        body: with texture coordinates.
        legend: colours of the scene's swatches.
        size: (h, w) [texels].

    Raises:
        SceneError: its mesh has no texture coordinates, or they repeat the picture more than `REPEAT_MAX` times.
    """
    corners_px = _corners_px(body, size)
    fine = body.fine or NOTHING
    whole = np.flatnonzero(np.isfinite(corners_px).all(axis=(1, 2)))
    whole = np.setdiff1d(whole, fine.faces, assume_unique=True)
    where_px = np.concatenate([corners_px[whole], fine.corners() @ corners_px[fine.face]])
    if (np.ptp(where_px, axis=1) + 1.0).prod(axis=1).sum() > REPEAT_MAX * size[0] * size[1]:
        raise SceneError(
            f"body {body.name!r}: its texture coordinates cover a picture more than {REPEAT_MAX} times, as tiles do; "
            "unwrap it in a modeller"
        )
    colour = np.zeros((len(scene.swatches), 3))
    colour[list(legend.values())] = list(legend)
    first, second, weight = parts(np.concatenate([body.face_swatch[whole].astype(np.int64), fine.paint]))
    shown = np.rint((1 - weight[:, None]) * colour[first] + weight[:, None] * colour[second])
    picture = np.zeros((*size, 4), np.uint8)
    for row, y, x in _texels(where_px):
        picture[y % size[0], x % size[1], :3] = shown[row]
        picture[y % size[0], x % size[1], 3] = 255
    return picture


def _texels(where_px: NDArray[np.float64]) -> Iterator[tuple[NDArray[Any], NDArray[Any], NDArray[Any]]]:
    """Triangles (n, 3, 2), and y and x of the texels whose middles are in them, some at a time."""
    low = np.ceil(where_px[..., 1].min(axis=1) - 0.5).astype(np.int64)
    rows = np.maximum(np.floor(where_px[..., 1].max(axis=1) - 0.5).astype(np.int64) + 1 - low, 0)
    wide = np.ceil(np.ptp(where_px[..., 0], axis=1)).astype(np.int64) + 1
    chunk = np.cumsum(rows * wide) // SPAN_MAX
    for part in np.split(np.arange(len(rows)), np.flatnonzero(np.diff(chunk)) + 1):
        line = np.repeat(part, rows[part])
        y = low[line] + _counted(rows[part])
        a, b = where_px[line], np.roll(where_px[line], -1, axis=1)
        middle = y[:, None] + 0.5
        crossed = (a[..., 1] <= middle) != (b[..., 1] <= middle)
        rise = np.where(crossed, b[..., 1] - a[..., 1], 1.0)
        x = a[..., 0] + (middle - a[..., 1]) / rise * (b[..., 0] - a[..., 0])
        begin = np.ceil(np.where(crossed, x, np.inf).min(axis=1, initial=np.inf) - 0.5)
        end = np.ceil(np.where(crossed, x, -np.inf).max(axis=1, initial=-np.inf) - 0.5)
        there = np.flatnonzero(crossed.any(axis=1) & (end > begin))
        count = (end - begin)[there].astype(np.int64)
        span = np.repeat(there, count)
        yield line[span], y[span], begin[span].astype(np.int64) + _counted(count)


def _counted(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """0, 1, … of each count, one after the other."""
    return np.asarray(np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts))


def paint_by_picture(scene: "Scene", body: str | None, picture: Path, legend: Meanings | None = None) -> int:
    """Paint a body of a scene as a picture says; how many faces it covers.

    Args:
        scene: painted in place; swatches of the legend are put into it.
        body: its name; None for the only one with texture coordinates.
        picture: its file.
        legend: what its colours mean; None: see `read_legend`.

    Raises:
        SceneError: no such body, none with texture coordinates, or a picture or legend that cannot be read.
        SwatchError: a swatch is unknown or broken.
    """
    painted, colours = body_with_uv(scene, body), read_picture(picture)
    if legend is None:
        found = read_legend(picture, scene)
    else:
        found = {colour: scene.swatch_index(swatch) for colour, swatch in legend.items()}
    with refusing(SceneError, picture.name):
        paint = paint_of(colours, found)
    return len(paint_picture(painted, paint))


def body_with_uv(scene: "Scene", name: str | None) -> "Body":
    """The body of that name; None for the only one with texture coordinates.

    Raises:
        SceneError: there is none, or more than one.
    """
    if name is not None:
        return scene.body(name)
    found = [body for body in scene.bodies if body.mesh.uv is not None] or scene.bodies[:1]
    if len(found) != 1:
        names = ", ".join(body.name for body in found)
        raise SceneError(f"a picture is of one body; say which has it: {names}" if names else "the scene has no body")
    return found[0]


def save_picture(scene: "Scene", body: "Body", path: Path, size: tuple[int, int] = (1024, 1024)) -> list[Path]:
    """Write the painting of a body as a picture, PNG, and beside it its legend and its own swatches; the files.

    Raises:
        SceneError: its mesh has no texture coordinates, or a file cannot be written.
    """
    from PIL import Image

    from hapscene.surface.swatch_file import swatch_to_bytes

    legend, content = legend_of(scene), io.BytesIO()
    told: dict[str, Any] = {}
    Image.fromarray(picture_of(scene, body, legend, size)).save(content, "PNG")
    files = {path: content.getvalue()}
    for colour, index in legend.items():
        swatch, source = scene.swatches[index], scene.swatch_source[index]
        meant: Any = swatch.name
        if not isinstance(source, str):  # no other scene knows it
            plain = re.sub(r"[^\w.-]+", "_", swatch.name)[:40]
            meant = {"swatch": swatch.name, "file": f"{path.stem}.{plain}.swatch"}
            files[path.with_name(meant["file"])] = swatch_to_bytes(swatch)
        told["#{:02x}{:02x}{:02x}".format(*colour)] = meant
    files[path.with_suffix(".json")] = (json.dumps(told, indent=2, ensure_ascii=False) + "\n").encode()
    for file, data in files.items():
        write_whole(file, data, SceneError)
    return list(files)
