"""Paint from an image over the texture coordinates of a body, and export of paint as an image.

A *legend* assigns a swatch to each colour. A colour between two colours of the legend is a blend of their swatches, so
a grey map can blend two swatches, or two variants of one swatch with scaled parameters. Transparent texels are not
painted. The legend of `map.png` is the file `map.json` beside it:

    {"#b5651d": "wood", "#000000": {"swatch": "rubber", "stiffness": 0.5}, "#ffffff": {"swatch": "rubber"}}
"""

import io
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import SceneError, no_such
from hapscene.io.files import Json, check_keys, parse_json, read_bytes, refusing, write_whole
from hapscene.scene.fine_paint import (
    LEVEL_MAX,
    NOTHING,
    SUBFACE_MAX,
    FinePaint,
    blend,
    halves,
    parts,
    set_subfaces,
    whole_faces,
)
from hapscene.scene.topology import Index
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
"""Index of the swatch for each colour (red, green, blue from 0 to 255)."""

Meanings = Mapping[tuple[int, int, int], SwatchLike]
"""Swatch for each colour (red, green, blue from 0 to 255)."""

FILE_MAX_B: Final = 64_000_000
"""Maximum size of an image file [bytes]."""

TEXEL_MAX: Final = 4096 * 4096
"""Maximum number of texels of an image [count]."""

NEAR: Final = 20.0
"""Distance in RGB, of 255 per channel, within which a colour counts as a colour of the legend: JPEG noise on a
surface."""

FAR: Final = 80.0
"""Maximum distance in RGB, of 255 per channel, from all colours of the legend and their blends; a few texels may exceed
it, since JPEG distorts edges."""

FAR_SHARE: Final = 0.005
"""Maximum share of texels that exceed `FAR` [1]."""

BLEND_STEPS: Final = 32
"""Number of steps of the weight of a blend [count]: steps of 3 %. The just noticeable difference of stiffness is 8 %
(Jones and Hunter 1990)."""

SPAN_MAX: Final = 4_000_000
"""Maximum number of texels that are written at once [count]."""

COLOUR_MAX: Final = 65_536
"""Maximum number of distinct colours of an image [count]; beyond it, as in photographs, colours are quantized to steps
of 8."""

LEGEND_MAX: Final = 200
"""Maximum number of colours of a legend [count]: any two of them may be blended."""

REPEAT_MAX: Final = 64
"""Maximum coverage of an exported image [count]: where texture coordinates repeat the image, texels are ambiguous."""

SCALED: Final = ("stiffness", "friction", "texture")
"""Parameters of a swatch that a legend may scale."""


def read_picture(source: Path | bytes, name: str = "picture") -> NDArray[np.uint8]:
    """Load an untrusted image (h, w, 4) from a file or from bytes.

    Raises:
        SceneError: the file is missing, too large, damaged, or not PNG, JPEG, WebP, BMP or TIFF.
    """
    from PIL import Image

    where = str(source) if isinstance(source, Path) else name
    with refusing(SceneError):
        content = read_bytes(source, FILE_MAX_B, "image") if isinstance(source, Path) else source
    try:
        with Image.open(io.BytesIO(content), formats=("PNG", "JPEG", "WEBP", "BMP", "TIFF")) as image:
            if image.width * image.height > TEXEL_MAX:
                raise SceneError(
                    f"{where}: {image.width} × {image.height} pixels; at most {TEXEL_MAX:,} pixels are allowed"
                )
            return np.asarray(image.convert("RGBA"))
    except SceneError:
        raise
    except Exception:  # Pillow raises many classes for damaged files
        raise SceneError(f"{where}: not a valid image; expected PNG, JPEG, WebP, BMP or TIFF") from None


def read_legend(picture: Path, scene: "Scene") -> Legend:
    """Read the legend beside an image; without a legend file, use the colours of the swatches in the scene.

    Raises:
        SceneError: the legend is damaged or has an invalid entry.
        SwatchError: a swatch is unknown or invalid.
    """
    file = picture.with_suffix(".json")
    if not file.is_file():
        return legend_of(scene)
    with refusing(SceneError, file):
        content = parse_json(read_bytes(file, 1_000_000, "legend"), "a legend")
        if not isinstance(content, dict) or not 0 < len(content) <= LEGEND_MAX:
            raise SceneError(f'expected an object of at most {LEGEND_MAX} colours, as in {{"#b5651d": "wood"}}')
        return {_rgb(colour): _legend_swatch(entry, file, scene) for colour, entry in content.items()}


def _rgb(text: str) -> tuple[int, int, int]:
    if not re.fullmatch(r"#[0-9a-fA-F]{6}", text):
        raise SceneError(f"{text[:40]!r} is not a colour; expected #rrggbb, such as #b5651d")
    red, green, blue = bytes.fromhex(text[1:])
    return red, green, blue


def _legend_swatch(entry: Json, file: Path, scene: "Scene") -> int:
    """Return the index of the swatch in a legend entry: a swatch of the scene or the library by name, or a file beside
    the legend; optionally with scaled parameters."""
    if not isinstance(entry, dict):
        entry = {"swatch": entry}
    check_keys("", entry, ("swatch", "file", *SCALED), ("swatch",))
    factors = {what: value for what, value in entry.items() if what in SCALED}
    name, beside = entry["swatch"], entry.get("file", "")
    if not isinstance(name, str) or not isinstance(beside, str):
        raise SceneError(f"expected the name of a swatch, not {str(name)[:40]!r}")
    own = next((swatch for swatch in scene.swatches if swatch.name == name), None)
    beside = beside or (name if name.endswith(".swatch") else "")
    found: SwatchLike = own or (file.parent / beside if beside else name)
    return scene.swatch_index(scaled(found, factors) if factors else found)


def legend_of(scene: "Scene") -> Legend:
    """Return the swatches of a scene by their colours, which are made distinct."""
    legend: dict[tuple[int, int, int], int] = {}
    for index, swatch in enumerate(scene.swatches):
        red, green, blue = (round(255 * c) for c in swatch.albedo_rgb)
        while (red, green, blue) in legend:
            blue = (blue + 37) % 256
        legend[red, green, blue] = index
    return legend


def scaled(swatch: SwatchLike, factors: Mapping[str, float]) -> Swatch:
    """Return a swatch with scaled stiffness, friction or texture gain, and a name that states the factors.

    Raises:
        SceneError: an unknown parameter or an invalid factor.
        SwatchError: the swatch is unknown or invalid.
    """
    from hapscene.swatches.library import load_swatch

    found = swatch if isinstance(swatch, Swatch) else load_swatch(swatch)
    for what, factor in factors.items():
        if what not in SCALED:
            raise SceneError(no_such("parameter to scale", what, SCALED))
        if isinstance(factor, bool) or not isinstance(factor, int | float) or not 0.0 <= factor <= 100.0:
            raise SceneError(f"invalid factor of {what}: expected a number from 0 to 100, not {str(factor)[:40]}")
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
    """Convert an image (h, w, 4) to paint (h, w), see `hapscene.scene.fine_paint.blend`; −1 where transparent.

    Raises:
        SceneError: colours are too far from all colours of the legend and their blends.
    """
    known, swatches = np.array(list(legend), np.float64), np.array(list(legend.values()))
    packed = picture[..., :3].astype(np.uint32) @ np.array([65536, 256, 1], np.uint32)
    values, place = np.unique(packed, return_inverse=True)
    if len(values) > COLOUR_MAX:
        values, place = np.unique(packed & 0xF8F8F8 | 0x040404, return_inverse=True)
    colours = np.stack([values >> 16, values >> 8 & 255, values & 255], axis=1).astype(np.float64)
    away_least, nearest = np.full(len(colours), np.inf), np.zeros(len(colours), np.intp)
    for i, colour in enumerate(known):  # one at a time to save memory: a photograph has millions of colours
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
        outlier = "#{:02x}{:02x}{:02x}".format(*colours[count.argmax()].astype(int))
        known_colours = ", ".join("#{:02x}{:02x}{:02x}".format(*colour) for colour in list(legend)[:8])
        raise SceneError(
            f"colour {outlier} is far from all colours of the legend ({known_colours}): use those colours, or add "
            f'it to the legend file beside the image, as {{"{outlier}": "wood"}}'
        )
    return np.where(clear, -1, paint[place].reshape(packed.shape))


def paint_picture(body: "Body", paint: NDArray[np.int64]) -> NDArray[np.int64]:
    """Paint a body with paint (h, w) over its texture coordinates; return the faces that have texture coordinates.

    Raises:
        SceneError: the mesh has no texture coordinates, or the image needs more than `SUBFACE_MAX` subfaces.
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
        subfaces = front[~cut]
        done.append(replace(subfaces, paint=np.where(found < 0, subfaces.paint, found)))
        front, where_px = halves(front[cut], where_px[cut])
        if sum(map(len, done)) + len(front) > SUBFACE_MAX:
            raise SceneError(
                f"body {body.name!r}: the image needs more than {SUBFACE_MAX:,} subfaces; use a smaller image or fewer "
                "colours"
            )
    columns = zip(*((d.face, d.path, d.edge, d.level, d.paint) for d in (NOTHING, *done)), strict=True)
    subfaces = FinePaint(*(np.concatenate(values) for values in columns))
    set_subfaces(body, subfaces[np.lexsort((subfaces.path, subfaces.face))])
    return faces


class _Uniform:
    """Tests whether rectangles of an image have uniform paint, by summed-area tables of its changes."""

    def __init__(self, paint: NDArray[np.int64]) -> None:
        self._shape = paint.shape
        across, down = np.zeros(paint.shape, np.bool_), np.zeros(paint.shape, np.bool_)
        across[:, 1:], down[1:] = paint[:, 1:] != paint[:, :-1], paint[1:] != paint[:-1]
        self._across, self._down = (np.pad(_summed(change), ((1, 0), (1, 0))) for change in (across, down))

    def within(self, where_px: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether the bounding boxes of triangles (n, 3, 2) are uniform; False across the edge of the image."""
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


def _sum(table: NDArray[np.int32], x0: Index, y0: Index, x1: Index, y1: Index) -> NDArray[np.int32]:
    """Return sums over the texels x0 … x1, y0 … y1, inclusive; 0 for empty ranges."""
    x1, y1 = np.maximum(x1 + 1, x0), np.maximum(y1 + 1, y0)
    return np.asarray(table[y1, x1] - table[y0, x1] - table[y1, x0] + table[y0, x0])


def _corners_px(body: "Body", shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return the corners of the faces in an image (h, w): x and y, downward (m, 3, 2) [texels]."""
    uv = body.mesh.uv
    if uv is None:
        raise SceneError(
            f"body {body.name!r}: the mesh has no texture coordinates: unwrap it in a mesh editor and export it as GLB "
            "or OBJ"
        )
    return np.asarray((uv * np.array([1.0, -1.0]) + np.array([0.0, 1.0])) * np.array(shape[1::-1]), np.float64)


def picture_of(scene: "Scene", body: "Body", legend: Legend, size: tuple[int, int] = (1024, 1024)) -> NDArray[np.uint8]:
    """Render the paint of a body as an image (h, w, 4): the colour of the paint at the centre of each texel.

    Blends have the weighted mean of both colours. Texels outside of all faces are transparent.

    Args:
        scene: the scene of the body.
        body: a body with texture coordinates.
        legend: colours of the swatches.
        size: height and width of the image [texels].

    Raises:
        SceneError: the mesh has no texture coordinates, or they cover the image more than `REPEAT_MAX` times.
    """
    corners_px = _corners_px(body, size)
    fine = body.fine or NOTHING
    whole = np.flatnonzero(np.isfinite(corners_px).all(axis=(1, 2)))
    whole = np.setdiff1d(whole, fine.faces, assume_unique=True)
    where_px = np.concatenate([corners_px[whole], fine.corners() @ corners_px[fine.face]])
    if (np.ptp(where_px, axis=1) + 1.0).prod(axis=1).sum() > REPEAT_MAX * size[0] * size[1]:
        raise SceneError(
            f"body {body.name!r}: the texture coordinates cover the image more than {REPEAT_MAX} times: unwrap the "
            "mesh without repetition in a mesh editor"
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


def _texels(where_px: NDArray[np.float64]) -> Iterator[tuple[Index, Index, Index]]:
    """Yield the texels whose centres are in triangles (n, 3, 2), in chunks: triangle, y and x of each texel."""
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
    """Return 0, 1, … for each count, concatenated."""
    return np.asarray(np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts))


def paint_by_picture(scene: "Scene", body: str | None, picture: Path, legend: Meanings | None = None) -> int:
    """Paint a body from an image file; return the number of faces that the image covers.

    Args:
        scene: modified in place; swatches of the legend are added.
        body: name of the body; None for the only one with texture coordinates.
        picture: the image file.
        legend: swatch of each colour. Default: see `read_legend`.

    Raises:
        SceneError: no such body, no texture coordinates, or an invalid image or legend.
        SwatchError: a swatch is unknown or invalid.
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
    """Return the body with this name, or the only body with texture coordinates if `name` is None.

    Raises:
        SceneError: there is no such body, or several.
    """
    if name is not None:
        return scene.body(name)
    found = [body for body in scene.bodies if body.mesh.uv is not None] or scene.bodies[:1]
    if len(found) != 1:
        names = ", ".join(body.name for body in found)
        raise SceneError(f"several bodies, specify one: {names}" if names else "the scene has no bodies")
    return found[0]


def save_picture(scene: "Scene", body: "Body", path: Path, size: tuple[int, int] = (1024, 1024)) -> list[Path]:
    """Export the paint of a body as a PNG image, with its legend and the swatches of the scene beside it.

    Returns:
        The files that were written.

    Raises:
        SceneError: the mesh has no texture coordinates, or a file cannot be written.
    """
    from PIL import Image

    from hapscene.surface.swatch_file import swatch_to_bytes

    legend, content = legend_of(scene), io.BytesIO()
    entries: dict[str, Json] = {}
    Image.fromarray(picture_of(scene, body, legend, size)).save(content, "PNG")
    files = {path: content.getvalue()}
    for colour, index in legend.items():
        swatch, source = scene.swatches[index], scene.swatch_source[index]
        entry: Json = swatch.name
        if not isinstance(source, str):  # not in the library, so the file goes beside the image
            plain = re.sub(r"[^\w.-]+", "_", swatch.name)[:40]
            entry = {"swatch": swatch.name, "file": f"{path.stem}.{plain}.swatch"}
            files[path.with_name(entry["file"])] = swatch_to_bytes(swatch)
        entries["#{:02x}{:02x}{:02x}".format(*colour)] = entry
    files[path.with_suffix(".json")] = (json.dumps(entries, indent=2, ensure_ascii=False) + "\n").encode()
    for file, data in files.items():
        write_whole(file, data, SceneError)
    return list(files)
