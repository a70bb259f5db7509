"""Pictures and films of a scene with the path of the tool and the forces of a recorded touch."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from hapscene.errors import ViewError
from hapscene.io.files import whole_file
from hapscene.render.recording import Recording
from hapscene.view.camera import fit_cameras, orbit, visible_size
from hapscene.view.feel_layer import Show
from hapscene.view.figure_parts import ARROW_SPACING, BODIES, arrow_ticks, make_figure_parts
from hapscene.view.legend import Legend, entries_of, measures_of
from hapscene.view.offscreen import draw
from hapscene.view.palette import AIR, FORCE, LIGHT, PATH, Theme, rgb
from hapscene.view.triangles import Drawing, Frame

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

__all__ = ["RATES_HZ", "write_picture"]

WIDTH: Final = 1600
"""Default width of a picture [pixels]."""

HEIGHTS: Final = (640, 1100)
"""Range of the default height of a drawing without its legend [pixels]."""

HEIGHT_MIN: Final = 64
"""Minimum height of a drawing with a given size [pixels]."""

OVERSAMPLING: Final = 2
"""Rendered pixels per pixel along each side [1], for smooth edges: OSMesa has no antialiasing."""

FILM_PX: Final = (800, 600)
"""Default size of a film with its legend [pixels]."""

SECONDS: Final = 6.0
"""Default length of a film without a touch [s]. A film with a touch is as long as the touch."""

RATES_HZ: Final = {".gif": 12.5, ".mp4": 25.0}
"""Frame rate of each film format [Hz]."""

GIF_COLOURS: Final = 255
"""Number of colours of a GIF [count]; the remaining one of 256 means "unchanged pixel", which reduces the size."""

GIF_MARK_PX: Final = 24
"""Rows of each colour of path and arrows that are added to the key frames [pixels], to keep it in the palette."""

KEY_FRAMES: Final = 5
"""Number of frames from which the palette of a GIF is computed [count]."""

Frames = Callable[[Sequence[int]], Iterator[Image.Image]]
"""Function that draws frames of a film by index."""


def write_picture(
    scene: "Scene",
    recording: Recording | None,
    path: str | Path,
    *,
    size: tuple[int, int] | None = None,
    seconds: float | None = None,
    theme: Theme = LIGHT,
    show: Show = "both",
) -> None:
    """Write a picture of a scene and a touch as PNG, or a film as GIF or MP4, depending on the suffix.

    Bodies have the materials of their file; the paint lies over them, with colour and grain of each swatch. A picture
    shows the path of the tool, on the surface during contact, and forces. A film shows the tool in real time; without a
    touch, the scene turns once. Results are deterministic for a given GL platform.

    Args:
        scene: scene to draw, with bodies at their poses.
        recording: recorded touch, or None.
        path: file to write.
        size: width and height including the legend [pixels]. Default: suitable for the scene; of films, `FILM_PX`.
        seconds: length of a film [s]; None for that of the touch, or `SECONDS`.
        theme: colours of background and text.
        show: visible layers of the bodies: look, feel, or both.

    Raises:
        ViewError: OpenGL or the extra `video` (for MP4) is not available, or the size is too small.
        OSError: the folder is missing or cannot be written.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind == ".mp4" and find_spec("imageio_ffmpeg") is None:
        raise ViewError("MP4 files need the extra `video`: pip install 'hapscene[video]', or write a .gif")
    if recording is not None and len(recording) < 2:
        recording = None
    ticks, turns_rad = None, [0.0]
    if kind in RATES_HZ:
        size = size or FILM_PX
        seconds = seconds or (SECONDS if recording is None else float(recording.t_s[-1] - recording.t_s[0]))
        count = max(round(seconds * RATES_HZ[kind]), 2)
        ticks = np.linspace(0, 0 if recording is None else len(recording) - 1, count).round().astype(np.int64)
        turns_rad = [0.0] * count if recording is not None else (2.0 * np.pi * np.arange(count) / count).tolist()
    drawing, strip = _compose(scene, recording, ticks, turns_rad, size, theme, show)

    def frames(order: Sequence[int]) -> Iterator[Image.Image]:
        return _drawn(replace(drawing, frames=[drawing.frames[i] for i in order]), strip)

    with whole_file(path) as part:
        {".gif": _write_gif, ".mp4": _write_mp4}.get(kind, _write_png)(part, frames, len(turns_rad))


def _compose(
    scene: "Scene",
    recording: Recording | None,
    ticks: NDArray[np.int64] | None,
    turns_rad: Sequence[float],
    size: tuple[int, int] | None,
    theme: Theme,
    show: Show,
) -> tuple[Drawing, Image.Image]:
    """Return the drawing of all frames, and the legend.

    A frame shows the tool at one of the `ticks`; without ticks, it shows the forces of the whole touch.
    """
    touched, moving = recording is not None, ticks is not None
    last = np.array([0 if recording is None else len(recording) - 1])
    figure = make_figure_parts(scene, recording, theme, last if ticks is None else ticks, show)
    parts, R_SC, points_m = list(figure.parts), orbit(turns_rad), figure.points_m(tool=moving)
    if ticks is not None:
        shown = [figure.shown(int(tick) if touched else None) for tick in ticks]
    else:
        shown = [figure.shown()]
        if recording is not None:
            shown[0] += [(len(parts) - 1, np.eye(4)), (len(parts), np.eye(4))]
            parts.append(figure.arrows(arrow_ticks(recording, ARROW_SPACING * figure.size_m)))
    width = WIDTH if size is None else size[0]
    legend = Legend(entries_of(scene, theme, path=touched, tool=touched and moving), width, theme)
    if size is None:
        width_m, height_m = visible_size(points_m, R_SC)
        size = width, int(np.clip(width * height_m / width_m, *HEIGHTS)) + legend.height
    area = _area_over(legend, size)
    poses, extent_m, pixel_m = fit_cameras(points_m, R_SC, area)
    frames = [Frame(X_SC, these) for X_SC, these in zip(poses, shown, strict=True)]
    bodies = range(BODIES, BODIES + figure.body_count)
    drawing = Drawing(parts, frames, extent_m, area, theme.background, OVERSAMPLING, casters=bodies)
    return drawing, legend.draw(measures_of(pixel_m, width, theme, figure.arrow_m_N, figure.f_max_N))


def _area_over(legend: Legend, size: tuple[int, int]) -> tuple[int, int]:
    """Return width and height of the drawing above a legend in a picture of `size` [pixels]; it may be too small."""
    height = size[1] - legend.height
    if height < HEIGHT_MIN:
        raise ViewError(
            f"{size[0]}x{size[1]} is too small for a drawing above a legend of {legend.height} pixels; increase --size"
        )
    return size[0], height


def _drawn(drawing: Drawing, strip: Image.Image) -> Iterator[Image.Image]:
    """Draw each frame above the legend."""
    for pixels in draw(drawing):
        picture = Image.new("RGB", (strip.width, pixels.shape[0] + strip.height))
        picture.paste(Image.fromarray(pixels), (0, 0))
        picture.paste(strip, (0, pixels.shape[0]))
        yield picture


def _write_png(part: Path, frames: Frames, count: int) -> None:
    (picture,) = frames(range(count))
    picture.save(part, format="PNG")


def _write_gif(part: Path, frames: Frames, count: int) -> None:
    """Write a GIF with one palette for all frames, since separate palettes cause flicker."""
    key = np.unique(np.linspace(0, count - 1, KEY_FRAMES).round().astype(int)).tolist()
    rows = [np.asarray(picture) for picture in frames(key)]
    rows += [np.broadcast_to(255 * rgb(mark), (GIF_MARK_PX, *rows[0].shape[1:])) for mark in (PATH, FORCE, AIR)]
    sheet = Image.fromarray(np.concatenate(rows).round().astype(np.uint8))
    palette = sheet.quantize(GIF_COLOURS, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    pictures = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames(range(count)))
    next(pictures).save(
        part,
        format="GIF",
        save_all=True,
        append_images=pictures,
        duration=round(1e3 / RATES_HZ[".gif"]),
        loop=0,
        optimize=False,
    )


def _write_mp4(part: Path, frames: Frames, count: int) -> None:
    import imageio_ffmpeg

    pictures = frames(range(count))
    first = next(pictures)
    writer = imageio_ffmpeg.write_frames(
        str(part),
        first.size,
        fps=RATES_HZ[".mp4"],
        codec="libx264",
        quality=7,
        macro_block_size=2,
        output_params=["-movflags", "+faststart", "-fflags", "+bitexact", "-threads", "1"],
    )
    writer.send(None)
    try:
        for frame in chain([first], pictures):
            writer.send(frame.tobytes())
    finally:
        writer.close()
