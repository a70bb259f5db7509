"""Export of a scene as one HTML page that anyone can feel: stroke with mouse, pen or finger, and listen.

The page contains mesh, paint, appearance and swatches, and loads nothing: it works from a file. Its scripts are in
`hapscene/web/touch_page`; the texture synthesis is that of the effect `lpc_texture`, with the tables of the effect. All
names are untrusted and escaped, and a content security policy permits only the scripts of the page.
"""

import base64
import hashlib
import html
import json
import math
import re
import zlib
from collections.abc import Iterable
from contextlib import suppress
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import ACCELERATION_RATE_HZ
from hapscene.dsp.texture_voice import log_power
from hapscene.errors import SceneError, printable
from hapscene.exchange.cut_faces import cut_faces
from hapscene.io.files import Json, write_whole
from hapscene.scene.body import Body
from hapscene.scene.material import Material, picture_file
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.scene.topology import area_of
from hapscene.surface.effect import load_effect
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_summary import phrases
from hapscene.swatches.sound import FULL_SCALE_M_S2, swatch_sound
from hapscene.view.feel_layer import corner_normals, grain_of, used_swatches
from hapscene.view.palette import distinct_colours, rgb
from hapscene.view.triangles import GAMMA

if TYPE_CHECKING:
    from PIL import Image

__all__ = ["html_page", "scene_json", "write_html"]

SHOWN_MAX: Final = 150_000
"""Default of the largest number of triangles of a page [count]: about 2 MB."""

BORDER_FINER: Final = 4.0
"""Resolution of reduced meshes at borders of paint, relative to that elsewhere [1]."""

FELT_M: Final = (0.15, 0.5)
"""Range of the size of a scene [m], as seen on a screen. Other scenes are felt at another scale: the speed of a hand on
a model of this size."""

COLOUR_STEP: Final = 0.12
"""Difference from the mean colour around a vertex above which a face keeps its own colour [1]; smaller differences, as
in a texture, are drawn as a gradient."""

GRAIN_PX: Final = 192
"""Size of the picture of a relief [pixels]."""

PICTURE_PX: Final = 512
"""Size of the pictures of the materials of mesh files [pixels]."""

PICTURES_MAX: Final = 16
"""Maximum number of materials with a picture [count]; further ones have the mean colour of their faces."""

STEEPEST: Final = 1.0
"""Steepest slope of a relief [1]; steeper ones are clipped."""

HEADROOM: Final = 0.6
"""Level relative to the sound of a swatch [1]: fast and strong strokes are up to 15 dB louder than its stroke."""

Array = NDArray[Any]


def write_html(scene: Scene, path: Path) -> list[Path]:
    """Write a scene as a page. Raises SceneError: no body has a face with an area, or the file cannot be written."""
    write_whole(path, html_page(scene, path.stem).encode(), SceneError)
    return [path]


def html_page(scene: Scene, title: str, shown_max: int = SHOWN_MAX) -> str:
    """Return the HTML of a page of about `shown_max` triangles at most. Raises SceneError: no face has an area."""
    folder = files("hapscene.web").joinpath("touch_page")
    part = {
        name: folder.joinpath(name).read_text(encoding="utf-8")
        for name in ("page.css", "sound.js", "view.js", "page.js")
    }
    style, *scripts = (
        f"'sha256-{base64.b64encode(hashlib.sha256(t.encode()).digest()).decode()}'" for t in part.values()
    )
    part["policy"] = f"default-src 'none'; script-src {' '.join(scripts)} data:; style-src {style}; img-src data:"
    part["title"] = html.escape(printable(title, 70))
    part["scene"] = scene_json(scene, printable(title, 70), shown_max).replace("<", "\\u003c")
    page = folder.joinpath("page.html").read_text(encoding="utf-8")
    return re.sub(r"{{([\w.]+)}}", lambda found: part[found[1]], page)


class _Arrays:
    """Collects arrays into one compressed block; the page addresses each as [type, start in bytes, length]."""

    def __init__(self) -> None:
        self.chunks: list[bytes] = []
        self.size = 0

    def add(self, values: Array, dtype: str) -> list[Json]:
        data = np.ascontiguousarray(values, "<" + dtype).tobytes()
        place = [dtype, self.size, np.size(values)]
        self.chunks += [data, bytes(-len(data) % 4)]
        self.size += len(data) + -len(data) % 4
        return place

    def text(self) -> str:
        return base64.b64encode(zlib.compress(b"".join(self.chunks), 9)).decode()


class _Solid(NamedTuple):
    """Triangles of a body in the world frame, cut along its paint.

    Attributes:
        vertices_m: (n, 3) [m].
        faces: (m, 3) indices.
        swatch: (m,) index into the swatches of the scene.
        colour: (m, 3) colours of the mesh file or of the swatches, sRGB, 0 to 1.
        picture: (m,) index of the picture that replaces the colour; −1 for none.
        uv: (m, 3, 2) texture coordinates of the corners, v downward.
    """

    vertices_m: Array
    faces: Array
    swatch: Array
    colour: Array
    picture: Array
    uv: Array


def scene_json(scene: Scene, title: str, shown_max: int = SHOWN_MAX) -> str:
    """Return the data of a page as JSON: see `html_page`."""
    used = np.array(used_swatches(scene))
    colours = distinct_colours(scene.swatches, used.tolist())
    pictures: dict[Material, Image.Image] = {}
    rgbs = np.array([rgb(colour) for colour in colours])
    solids = _with_area((body, _solid(body, rgbs, pictures)) for body in scene.bodies)
    share = shown_max / sum(len(solid.faces) for _, solid in solids)
    if share < 1.0:
        solids = _with_area((body, _reduced(solid, max(round(share * len(solid.faces)), 12))) for body, solid in solids)
    rows, arrays = [_vertices(solid) for _, solid in solids], _Arrays()
    vertices_m, normals, rgbs, swatch, picture, uv = (np.concatenate([row[i] for row in rows]) for i in range(6))
    start = np.cumsum([0, *(len(row[0]) for row in rows)])
    low = vertices_m.min(axis=0)
    size = np.maximum(vertices_m.max(axis=0) - low, 1e-9)
    diagonal_m = float(np.linalg.norm(size))
    first, bodies = 0, list[dict[str, Json]]()
    for body, solid in solids:
        area_m2 = np.bincount(np.searchsorted(used, solid.swatch), area_of(solid.vertices_m[solid.faces]), len(used))
        by_area = [int(i) for i in np.argsort(-area_m2) if area_m2[i] > 0.0]
        count = solid.faces.size
        task = _task(body.name if len(solids) > 1 else "", [scene.swatches[used[i]] for i in by_area])
        name = printable(body.name, 60)
        bodies.append({"name": name, "task": task, "first": first, "count": count, "swatches": by_area})
        first += count
    main = max(range(len(bodies)), key=lambda i: (len(bodies[i]["swatches"]), bodies[i]["count"]))
    content = {
        "title": title,
        "main": main,  # the body that a narrow screen shows first
        "look": any(body.mesh.colour_rgb is not None for body in scene.bodies),
        "scale": min(max(1.0, FELT_M[0] / diagonal_m), FELT_M[1] / diagonal_m),
        "low": low.tolist(),
        "size": size.tolist(),
        "position": arrays.add(np.rint((vertices_m - low) / size * 65535), "u2"),
        "normal": arrays.add(normals, "i1"),
        "colour": arrays.add(rgbs, "u1"),
        "swatch": arrays.add(np.searchsorted(used, swatch), "u2"),
        "pictures": [_jpeg(picture) for picture in pictures.values()],
        "picture": arrays.add(picture if pictures else picture[:0], "u1"),  # 255 for none
        "uv": arrays.add(uv if pictures else uv[:0], "f4"),
        "faces": arrays.add(np.concatenate([row[6] + at for row, at in zip(rows, start[:-1], strict=True)]), "u4"),
        "bodies": bodies,
        "swatches": [
            {"plain": i == 0} | _swatch(scene.swatches[i], colours[i], diagonal_m, arrays) for i in used.tolist()
        ],
    }
    return json.dumps(content | {"data": arrays.text()}, allow_nan=False)


def _with_area(solids: Iterable[tuple[Body, _Solid]]) -> list[tuple[Body, _Solid]]:
    """Return the bodies that can be touched: those with a face of nonzero area. Raises SceneError without any."""
    found = [pair for pair in solids if area_of(pair[1].vertices_m[pair[1].faces]).any()]
    if not found:
        raise SceneError(
            "the scene has no face with an area, so its page cannot be touched; check it with `hapscene check`"
        )
    return found


def _task(body: str, swatches: list[Swatch]) -> str:
    """Return a task in one sentence, for a body ("" for the only one) with these swatches, by area."""
    what = f" the {printable(body, 40)}" if body else ""
    names = [printable(swatch.name, 40) for swatch in swatches]
    if len(names) > 1:
        return f"Close your eyes and stroke{what}: where does {names[0]} end and {names[1]} begin?"
    if swatches[0].texture is None:
        return f"No texture yet: paint{what or ' it'} with “hapscene paint”, then convert it again."
    return f"Stroke{what or ' ' + names[0]} slowly, then fast: what changes?"


# --- shape ---


def _solid(body: Body, colours: Array, pictures: "dict[Material, Image.Image]") -> _Solid:
    """Return the triangles of a body, with the look of its mesh file, or else with the colours of swatches.

    Pictures of materials are added to `pictures`.
    """
    cut, mesh = cut_faces(body), body.mesh
    colour = colours[cut.swatch] if mesh.colour_rgb is None else mesh.colour_rgb[cut.face] / 255
    picture, uv = np.full(len(cut.face), -1), np.zeros((len(cut.face), 3, 2))
    if mesh.uv is not None and mesh.material is not None:
        for index, material in enumerate(mesh.materials):
            found = material.textures.get("baseColorTexture")
            if found is not None and material not in pictures and len(pictures) < PICTURES_MAX:
                with suppress(Exception):  # PIL raises many classes for damaged pictures
                    pictures[material] = _coloured(found, material)
            if material in pictures:
                picture[mesh.material[cut.face] == index] = list(pictures).index(material)
        uv = np.nan_to_num(cut.corners(mesh.uv, np.arange(len(cut.face)))) * (1.0, -1.0) + (0.0, 1.0)
        uv -= np.floor(uv.min(axis=1, keepdims=True))  # pictures repeat; small numbers are exact
    vertices_m = cut.vertices_m @ body.X_WB[:3, :3].T + body.X_WB[:3, 3]
    return _Solid(vertices_m, cut.faces, cut.swatch, colour, picture, uv)


def _coloured(picture: "Image.Image", material: Material) -> "Image.Image":
    """Return the picture of a material, multiplied by its colour."""
    from PIL import Image

    pixels = np.asarray(picture.convert("RGB").resize((PICTURE_PX, PICTURE_PX)), np.float64)
    factor = np.clip(material.colour[:3], 0.0, 1.0) ** (1 / GAMMA)
    return Image.fromarray(np.rint(pixels * factor).astype(np.uint8))


def _jpeg(picture: "Image.Image") -> str:
    return "data:image/jpeg;base64," + base64.b64encode(picture_file(picture, "JPEG")[0]).decode()


def _vertices(solid: _Solid) -> tuple[Array, ...]:
    """Return vertices for drawing, repeated for each normal, swatch and different colour, so that borders are sharp.

    Returns:
        Positions (n, 3) [m], octahedral normals (n, 2) with 127 for 1, colours (n, 3) from 0 to 255, swatches (n,),
        pictures (n,), texture coordinates (n, 2), and the corners of the faces (m, 3).
    """
    normal = corner_normals(Mesh(solid.vertices_m, solid.faces.astype(np.int32)))
    x, y, z = (normal / np.maximum(np.abs(normal).sum(axis=1, keepdims=True), 1e-12)).T
    # the lower half is folded over the upper one (Meyer et al. 2010, On floating-point normal vectors)
    folded = z < 0.0
    x, y = np.where(folded, np.copysign(1 - abs(y), x), x), np.where(folded, np.copysign(1 - abs(x), y), y)
    octahedral = np.rint(127 * np.stack([x, y], axis=1)).astype(np.int64)
    vertex, swatch = solid.faces.ravel().astype(np.int64), np.repeat(solid.swatch, 3).astype(np.int64)
    colour = np.repeat(solid.colour, 3, axis=0)
    other = np.abs(colour - _means(vertex, len(solid.vertices_m), colour)[vertex]).max(axis=1) > COLOUR_STEP
    kind = np.where(other, 1 + np.rint(7 * colour).astype(np.int64) @ (64, 8, 1), 0)
    key = vertex << 42 | kind << 32 | swatch << 16 | (octahedral[:, 0] + 128) << 8 | octahedral[:, 1] + 128
    picture, uv = np.repeat(solid.picture, 3), solid.uv.reshape(-1, 2)
    _, key = np.unique(key, return_inverse=True)
    place = np.where(picture < 0, 0, np.unique(np.rint(uv * 4096), axis=0, return_inverse=True)[1].reshape(-1) + 1)
    _, first, corners = np.unique(key * (place.max() + 1) + place, return_index=True, return_inverse=True)
    rgbs = np.rint(255 * _means(corners, len(first), colour))
    shown = octahedral[first], rgbs, swatch[first], picture[first] % 256, uv[first]
    return solid.vertices_m[vertex[first]], *shown, corners.reshape(-1, 3)


def _means(group: Array, count: int, values: Array) -> Array:
    """Return the mean (count, k) of values (n, k) by their group (n,)."""
    size = np.maximum(np.bincount(group, minlength=count), 1)
    return np.stack([np.bincount(group, column, count) / size for column in values.T], axis=1)


def _reduced(solid: _Solid, count: int) -> _Solid:
    """Reduce triangles to about `count` by vertex clustering (Rossignac & Borrel 1993), finer at borders of paint."""
    low, high, best = 1.0, 8192.0, solid  # cells along the longest side
    while high / low > 1.05:
        cells = math.sqrt(low * high)
        found = _clustered(solid, cells)
        if len(found.faces) > count:
            high = cells
        else:
            low, best = cells, found
    return best


def _clustered(solid: _Solid, cells: float) -> _Solid:
    """Merge the vertices in each cell of a grid; faces that collapse are removed."""
    vertex, swatch = solid.faces.ravel(), np.repeat(solid.swatch, 3)
    least, most = np.full(len(solid.vertices_m), 1 << 15), np.full(len(solid.vertices_m), -1)
    np.minimum.at(least, vertex, swatch)
    np.maximum.at(most, vertex, swatch)
    border = (least != most)[:, None]
    place = solid.vertices_m - solid.vertices_m.min(axis=0)
    cell = np.floor(place * np.where(border, BORDER_FINER, 1.0) * (cells / place.max())).astype(np.int64)
    key = (cell[:, 0] << 40 | cell[:, 1] << 20 | cell[:, 2]) * 2 + border[:, 0]
    _, first, key = np.unique(key, return_index=True, return_inverse=True)
    normal = _normals(solid)
    behind = (normal * normal[first[key]]).sum(axis=1) < 0.0  # keeps the two sides of a thin wall apart
    _, group = np.unique(2 * key + behind, return_inverse=True)
    faces = group[solid.faces]
    kept = np.flatnonzero((faces != np.roll(faces, 1, axis=1)).all(axis=1))
    _, first = np.unique(np.sort(faces[kept], axis=1), axis=0, return_index=True)
    kept = kept[first]
    vertices_m = _means(group, int(group.max()) + 1, solid.vertices_m)
    return _Solid(vertices_m, faces[kept], *(column[kept] for column in solid[2:]))


def _normals(solid: _Solid) -> Array:
    """Return the normal (n, 3) at each vertex, of any length."""
    a, b, c = np.moveaxis(solid.vertices_m[solid.faces], 1, 0)
    normal = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    return np.stack([np.bincount(solid.faces.ravel(), part, len(solid.vertices_m)) for part in normal.T], axis=1)


# --- feel ---


def _swatch(swatch: Swatch, colour: str, diagonal_m: float, arrays: _Arrays) -> dict[str, Json]:
    """Return what the page needs of a swatch: see class `Voice` in sound.js."""
    texture, effect, sound = swatch.texture, load_effect("lpc_texture"), swatch_sound(swatch)
    table = np.zeros(0) if effect.table is None else effect.table(swatch, ACCELERATION_RATE_HZ)
    depth = swatch.parameter("lpc_texture", "texture_life", 1.0)
    return {
        "name": printable(swatch.name, 60),
        "words": ", ".join(phrase.word for phrase in phrases(swatch)[:3]),
        "colour": colour,
        "table": arrays.add(table, "f4"),
        "gain": swatch.parameter("lpc_texture", "texture_gain", 1.0),
        "depth": depth,
        "norm": log_power(0.0 if texture is None else depth * texture.log_spread),
        "tap": arrays.add(np.trim_zeros(sound.a_m_s2[: sound.start], "b"), "f4"),
        "listen": HEADROOM * sound.gain / FULL_SCALE_M_S2,  # factor from acceleration to sound: texture,
        "knock": HEADROOM / FULL_SCALE_M_S2,  # and taps
        **_grain(swatch, diagonal_m, arrays),
    }


def _grain(swatch: Swatch, diagonal_m: float, arrays: _Arrays) -> dict[str, Json]:
    """Return a periodic grain (GRAIN_PX, GRAIN_PX, 3), its size, and the gloss.

    Its bytes are two slopes of the relief, 1 to 255 for ±`STEEPEST`, and a brightness, 128 for that of the colour. It
    is magnified on large scenes.
    """
    from PIL import Image

    grain = grain_of(swatch)
    slopes = -grain.normal[..., :2] / grain.normal[..., 2:]
    shade = np.ones((1, 1, 1)) if grain.albedo is None else grain.albedo.mean(axis=2, keepdims=True)
    shade = np.broadcast_to(shade / max(shade.mean(), 0.05), (*slopes.shape[:2], 1))
    rows = np.concatenate([127 * np.clip(slopes / STEEPEST, -1.0, 1.0), 128 * np.clip(shade - 1.0, -1.0, 0.99)], axis=2)
    picture = Image.fromarray((128 + np.rint(rows)).astype(np.uint8))
    small = picture.resize((GRAIN_PX, GRAIN_PX), Image.Resampling.BOX)
    tile_m = grain.tile_m(diagonal_m)
    return {"grain": arrays.add(np.asarray(small), "u1"), "grain_m": tile_m, "gloss": 1.0 - grain.roughness}
