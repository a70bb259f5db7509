"""scene.png: the bodies with their swatches in colour, the path of the tool, a legend and a scale."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapscene.output import whole_file
from hapscene.recording import Recording
from hapscene.view.offscreen import Drawing, draw
from hapscene.view.palette import AIR, INK, PATH, albedo_colours
from hapscene.view.solid import Solid, joined, scene_solid, tube

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw
    from PIL.ImageFont import FreeTypeFont

    from hapscene.scene.scene import Scene

WIDTH: Final = 1600
HEIGHTS: Final = (640, 1100)
"""Width, and least and greatest height of the drawing [pixels]; the legend comes below it."""

OVERSAMPLING: Final = 2
"""Pixels drawn for each pixel shown, along each side: OSMesa itself smooths no edges."""

LEGEND_HEIGHT: Final = 96
"""Height of the legend [pixels]."""

MARGIN: Final = 1.08
"""How much wider than the scene the picture is [1]."""

VIEW_FROM: Final = (0.35, -1.0, 0.75)
"""Direction from the scene to the camera: from the front, above, a little from the right."""


def write_picture(scene: "Scene", recording: Recording | None, path: str | Path) -> None:
    """Draw the scene, and where the tool went, as PNG: the same pixels for the same input and kind of GL.

    Bodies stand at their poses in the scene. A face wears the albedo of its swatch, shaded by the colours in
    the mesh's file; a plain one those colours themselves. The path is drawn on the surface where the tool touched.

    Args:
        scene: what to draw.
        recording: whose path to draw, or None.
        path: where the file shall be.

    Raises:
        ViewError: no GL can draw here; one line says what to install.
        OSError: the folder is missing or cannot be written.
    """
    from PIL import Image

    solid = scene_solid(scene)
    low_m, high_m = solid.corner_m.min(axis=0), solid.corner_m.max(axis=0)
    diagonal_m = float(np.linalg.norm(high_m - low_m))
    if recording is not None and len(recording) > 1:
        solid = joined([solid, *_path_solids(recording, diagonal_m)])
    drawing, pixel_m = _frame(solid)
    pixels = Image.fromarray(draw(drawing)).reduce(OVERSAMPLING)
    picture = Image.new("RGB", (WIDTH, pixels.height + LEGEND_HEIGHT), "white")
    picture.paste(pixels, (0, 0))
    _draw_legend(picture, scene, recording is not None, pixel_m)
    with whole_file(path) as part:
        picture.save(part, format="PNG")


def _path_solids(recording: Recording, diagonal_m: float) -> list[Solid]:
    """The path as tubes: strong on the surface, thin in the air."""
    radius_m = diagonal_m * 2.2e-3
    touching = recording.touching
    # the proxy lies on the surface; half a tube is then seen above it
    line_m = recording.p_WP_m + np.where(touching[:, None], recording.nhat_W, 0.0) * radius_m * 0.5
    edges = np.flatnonzero(np.diff(touching)) + 1
    solids = []
    for start, stop in zip([0, *edges], [*edges, len(line_m)], strict=True):
        piece = line_m[max(start - 1, 0) : stop + 1] if not touching[start] else line_m[start:stop]
        radius = radius_m if touching[start] else radius_m * 0.4
        solids.append(tube(piece, radius, PATH if touching[start] else AIR))
    return solids


def _frame(solid: Solid) -> tuple[Drawing, float]:
    """A drawing whose camera just holds all of `solid`, and the size of a shown pixel [m]."""
    z = np.array(VIEW_FROM) / np.linalg.norm(VIEW_FROM)
    x = np.cross((0.0, 0.0, 1.0), z)
    x /= np.linalg.norm(x)
    R_WC = np.column_stack((x, np.cross(z, x), z))
    seen_m = solid.corner_m @ R_WC  # in the camera's axes
    low_m, high_m = seen_m.min(axis=0), seen_m.max(axis=0)
    middle_m = (low_m + high_m) / 2
    width_m, height_m, depth_m = np.maximum(high_m - low_m, 1e-9)
    height = int(np.clip(WIDTH * height_m / width_m, *HEIGHTS))
    pixel_m = MARGIN * max(width_m / WIDTH, height_m / height)
    far_m = 2.0 * max(width_m, height_m, depth_m)
    X_WC = np.eye(4)
    X_WC[:3, :3] = R_WC
    X_WC[:3, 3] = z * far_m / 2  # the scene is moved to the origin: GL counts in float32
    drawing = Drawing(
        position_m=(solid.corner_m - R_WC @ middle_m).astype(np.float32),
        normal=solid.normal.astype(np.float32),
        colour=solid.colour.astype(np.float32),
        X_WC=X_WC,
        extent_m=np.array([pixel_m * WIDTH / 2, pixel_m * height / 2, far_m]),
        size=np.array([WIDTH, height]) * OVERSAMPLING,
    )
    return drawing, float(pixel_m)


def _draw_legend(picture: Any, scene: "Scene", with_path: bool, pixel_m: float) -> None:
    """Swatches by name at the left, the path's two colours after them, a scale bar at the right."""
    from PIL import ImageDraw

    pen, font = ImageDraw.Draw(picture), _font(24)
    middle = picture.height - LEGEND_HEIGHT // 2
    bar_m = _round_down(WIDTH * 0.2 * pixel_m)
    bar_px = round(bar_m / pixel_m)
    right = WIDTH - 40
    pen.rectangle((right - bar_px, middle + 12, right, middle + 17), fill=INK)
    pen.text((right - bar_px / 2, middle + 6), _length(bar_m), fill=INK, font=font, anchor="ms")
    limit, x = right - max(bar_px, 120) - 40, 40
    used = np.unique(np.concatenate([body.face_swatch for body in scene.bodies]))
    colours = albedo_colours(scene.swatches)
    names = [swatch.name for swatch in scene.swatches]
    if any(body.mesh.colour_rgb is not None for body in scene.bodies):
        names[0] += " (colours of the file)"
    entries = [(names[i], colours[i], 24) for i in used]
    if with_path:
        entries += [("tool, touching", PATH, 8), ("tool, in the air", AIR, 4)]
    for name, colour, thickness in entries:
        x = _draw_entry(pen, font, (x, middle), limit, name, colour, thickness)


def _draw_entry(
    pen: "ImageDraw",
    font: "FreeTypeFont",
    at: tuple[int, int],
    limit: int,
    name: str,
    colour: str,
    thickness: int,
) -> int:
    """One entry of the legend, unless it would pass `limit`; return where the next one starts."""
    x, middle = at
    text = name if len(name) <= 28 else name[:27] + "…"
    after = x + 44 + round(font.getlength(text)) + 36
    if after > limit:
        return after  # no room: nothing more is written
    outline = "#777777" if thickness > 10 else None
    pen.rectangle((x, middle - thickness // 2, x + 32, middle + thickness // 2), fill=colour, outline=outline)
    pen.text((x + 44, middle), text, fill=INK, font=font, anchor="lm")
    return after


def _font(size: int) -> "FreeTypeFont":
    """The sans serif that comes with matplotlib: the same on every machine."""
    import matplotlib
    from PIL import ImageFont

    return ImageFont.truetype(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf", size)


def _round_down(length_m: float) -> float:
    """The greatest 1, 2 or 5 times a power of ten that is not over `length_m`."""
    power = 10.0 ** np.floor(np.log10(length_m))
    return float(power * max(step for step in (1, 2, 5) if step * power <= length_m * (1 + 1e-9)))


def _length(length_m: float) -> str:
    """A length with the unit that makes it readable."""
    for unit, scale in (("m", 1.0), ("mm", 1e-3), ("µm", 1e-6)):
        if length_m >= scale * 0.999:
            return f"{length_m / scale:g} {unit}"
    return f"{length_m:g} m"
