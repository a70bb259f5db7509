"""A still picture, as scene.png: the bodies with their swatches in colour, the path of the tool, its forces."""

from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from PIL import Image

from hapscene.errors import ViewError
from hapscene.io.files import whole_file
from hapscene.render.recording import Recording
from hapscene.view.camera import looks, place, seen_size
from hapscene.view.figure_parts import ARROW_SPACING, arrow_ticks, make_figure_parts
from hapscene.view.legend import draw_strip, entries_of, lay_out, measures_of, strip_height
from hapscene.view.offscreen import draw
from hapscene.view.palette import LIGHT, Theme
from hapscene.view.triangles import Drawing, Frame

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

WIDTH: Final = 1600
HEIGHTS: Final = (640, 1100)
"""Width, and least and greatest height of the drawing [pixels], where no size is asked for; the legend comes below."""

HEIGHT_MIN: Final = 64
"""Least height of a drawing [pixels], where a size is asked for."""

OVERSAMPLING: Final = 2
"""Pixels drawn for each pixel shown, along each side: OSMesa itself smooths no edges."""


def write_picture(
    scene: "Scene",
    recording: Recording | None,
    path: str | Path,
    *,
    size: tuple[int, int] | None = None,
    theme: Theme = LIGHT,
) -> None:
    """Draw the scene, where the tool went, and the force on it, as PNG: the same pixels for the same input and GL.

    Bodies stand at their poses in the scene. A face wears the albedo of its swatch, shaded by the colours in
    the mesh's file; a plain one those colours themselves. The path is drawn on the surface where the tool touched.

    Args:
        scene: what to draw.
        recording: whose path and forces to draw, or None.
        path: where the file shall be.
        size: width and height with the legend [pixels]; else what the scene needs.
        theme: colours around the scene.

    Raises:
        ViewError: no GL can draw here; one line says what to install.
        OSError: the folder is missing or cannot be written.
    """
    if recording is not None and len(recording) < 2:
        recording = None
    last = np.array([0 if recording is None else len(recording) - 1])
    stage = make_figure_parts(scene, recording, theme, last)
    shown, parts = stage.shown(), list(stage.parts)
    if recording is not None:
        arrows = stage.arrows(arrow_ticks(recording, ARROW_SPACING * stage.size_m))
        shown += [(len(parts) - 1, np.eye(4)), (len(parts), np.eye(4))]
        parts.append(arrows)
    R_SC, points_m = looks([0.0]), stage.points_m(tool=False)
    entries = entries_of(scene, theme, path=recording is not None)
    strip = strip_height(entries, 1 if recording is None else 2, WIDTH if size is None else size[0])
    if size is None:
        width_m, height_m = seen_size(points_m, R_SC)
        size = WIDTH, int(np.clip(WIDTH * height_m / width_m, *HEIGHTS)) + strip
    area = area_over(strip, size)
    (X_SC,), extent_m, pixel_m = place(points_m, R_SC, area)
    drawing = Drawing(parts, [Frame(X_SC, shown)], extent_m, area, theme.background, OVERSAMPLING)
    placed, _ = lay_out(entries, measures_of(pixel_m, size[0], theme, stage.arrow_m_N, stage.f_max_N), size[0])
    picture = Image.new("RGB", size, theme.page)
    for pixels in draw(drawing):
        picture.paste(Image.fromarray(pixels), (0, 0))
    picture.paste(draw_strip(placed, size[0], strip, theme), (0, area[1]))
    with whole_file(path) as part:
        picture.save(part, format="PNG")


def area_over(strip_px: int, size: tuple[int, int]) -> tuple[int, int]:
    """Width and height of what is drawn over a legend in a picture of `size` [pixels].

    Raises:
        ViewError: too little is left.
    """
    if size[1] - strip_px < HEIGHT_MIN:
        raise ViewError(
            f"{size[0]}x{size[1]} leaves no room over a legend of {strip_px} pixels; ask for a higher --size"
        )
    return size[0], size[1] - strip_px
