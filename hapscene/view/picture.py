"""Pictures and films of a scene: the bodies in the colours of their swatches, the path of the tool, its forces."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from PIL import Image

from hapscene.errors import ViewError
from hapscene.io.files import whole_file
from hapscene.render.recording import Recording
from hapscene.view.camera import looks, place, seen_size
from hapscene.view.figure_parts import ARROW_SPACING, arrow_ticks, make_figure_parts
from hapscene.view.legend import Legend, entries_of, measures_of
from hapscene.view.offscreen import draw
from hapscene.view.palette import LIGHT, Theme
from hapscene.view.triangles import Drawing, Frame

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

__all__ = ["RATES_HZ", "Film", "write_film", "write_picture"]

WIDTH: Final = 1600
"""Width of a picture without a given size [pixels]."""

HEIGHTS: Final = (640, 1100)
"""Least and greatest height of a drawing without a given size [pixels]; the legend comes below."""

HEIGHT_MIN: Final = 64
"""Least height of a drawing with a given size [pixels]."""

OVERSAMPLING: Final = 2
"""Pixels drawn for each pixel shown, along each side: OSMesa smooths no edges."""

SECONDS: Final = 6.0
"""Length of a film without a touch [s]. A film with a touch lasts as long as the touch."""

RATES_HZ: Final = {".gif": 12.5, ".mp4": 25.0}
"""Frames a second of each kind of film [Hz]."""

GIF_COLOURS: Final = 255
"""Colours of a GIF [count]: one of 256 is left for "as before", which makes the file small."""

KEY_FRAMES: Final = 5
"""Frames from which the colours of a GIF are chosen [count]."""

Frames = Callable[[Sequence[int]], Iterator[Image.Image]]
"""Draws frames of a film by their numbers."""


@dataclass(frozen=True)
class Film:
    """Settings of a film.

    Attributes:
        size: width and height with the legend [pixels].
        seconds: length; None: the touch's own, or `SECONDS`.
        turn_rad: angle that the camera goes around the scene.
        theme: colours around the scene.
    """

    size: tuple[int, int] = (800, 600)
    seconds: float | None = None
    turn_rad: float = 2.0 * np.pi
    theme: Theme = LIGHT


def write_picture(
    scene: "Scene",
    recording: Recording | None,
    path: str | Path,
    *,
    size: tuple[int, int] | None = None,
    theme: Theme = LIGHT,
) -> None:
    """Draw the scene, the path of the tool, and the force on it, as PNG: the same pixels for the same input and GL.

    Bodies stand at their poses in the scene. A face has the albedo of its swatch, shaded by the colours in the mesh's
    file; a plain face has those colours themselves. The path is drawn on the surface where the tool touched.

    Args:
        scene: what to draw.
        recording: whose path and forces to draw, or None.
        path: of the file.
        size: width and height with the legend [pixels]; None: as the scene needs.
        theme: colours around the scene.

    Raises:
        ViewError: no GL can draw here, or the size leaves no room.
        OSError: the folder is missing or cannot be written.
    """
    if recording is not None and len(recording) < 2:
        recording = None
    last = np.array([0 if recording is None else len(recording) - 1])
    figure = make_figure_parts(scene, recording, theme, last)
    shown, parts = figure.shown(), list(figure.parts)
    if recording is not None:
        arrows = figure.arrows(arrow_ticks(recording, ARROW_SPACING * figure.size_m))
        shown += [(len(parts) - 1, np.eye(4)), (len(parts), np.eye(4))]
        parts.append(arrows)
    R_SC, points_m = looks([0.0]), figure.points_m(tool=False)
    width = WIDTH if size is None else size[0]
    legend = Legend(entries_of(scene, theme, path=recording is not None), width, theme)
    if size is None:
        width_m, height_m = seen_size(points_m, R_SC)
        size = width, int(np.clip(width * height_m / width_m, *HEIGHTS)) + legend.height
    area = _area_over(legend, size)
    (X_SC,), extent_m, pixel_m = place(points_m, R_SC, area)
    drawing = Drawing(parts, [Frame(X_SC, shown)], extent_m, area, theme.background, OVERSAMPLING)
    strip = legend.draw(measures_of(pixel_m, width, theme, figure.arrow_m_N, figure.f_max_N))
    (picture,) = _drawn(drawing, strip)
    with whole_file(path) as part:
        picture.save(part, format="PNG")


def write_film(scene: "Scene", recording: Recording | None, path: str | Path, film: Film) -> None:
    """Draw the scene with a moving camera, and the touch as it goes on, as GIF or MP4 by the file's suffix.

    Args:
        scene: what to draw.
        recording: a touch to play, or None.
        path: of the file.
        film: settings.

    Raises:
        ViewError: no GL can draw here, an MP4 without the extra `video`, or the size leaves no room.
        OSError: the folder is missing or cannot be written.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind == ".mp4" and find_spec("imageio_ffmpeg") is None:
        raise ViewError("an MP4 needs the extra `video`: pip install 'hapscene[video]'; or write a .gif")
    if recording is not None and len(recording) < 2:
        recording = None
    seconds = film.seconds or (SECONDS if recording is None else float(recording.t_s[-1] - recording.t_s[0]))
    count = max(round(seconds * RATES_HZ[kind]), 2)
    drawing, strip = _compose(scene, recording, film, count)

    def frames(order: Sequence[int]) -> Iterator[Image.Image]:
        return _drawn(replace(drawing, frames=[drawing.frames[i] for i in order]), strip)

    with whole_file(path) as part:
        (_write_gif if kind == ".gif" else _write_mp4)(part, frames, count, film.size)


def _compose(scene: "Scene", recording: Recording | None, film: Film, count: int) -> tuple[Drawing, Image.Image]:
    """All frames to draw, and the legend under each."""
    touched = recording is not None
    ticks = np.linspace(0, 0 if recording is None else len(recording) - 1, count).round().astype(np.int64)
    figure = make_figure_parts(scene, recording, film.theme, ticks)
    R_SC = looks((film.turn_rad * np.arange(count) / count).tolist())
    legend = Legend(entries_of(scene, film.theme, path=touched, tool=touched), film.size[0], film.theme)
    area = _area_over(legend, film.size)
    poses, extent_m, pixel_m = place(figure.points_m(tool=True), R_SC, area)
    shown = [figure.shown(int(tick) if touched else None) for tick in ticks]
    frames = [Frame(X_SC, parts) for X_SC, parts in zip(poses, shown, strict=True)]
    drawing = Drawing(figure.parts, frames, extent_m, area, film.theme.background, OVERSAMPLING)
    return drawing, legend.draw(measures_of(pixel_m, area[0], film.theme, figure.arrow_m_N, figure.f_max_N))


def _area_over(legend: Legend, size: tuple[int, int]) -> tuple[int, int]:
    """Width and height of the drawing over a legend in a picture of `size` [pixels].

    Raises:
        ViewError: too little is left.
    """
    height = size[1] - legend.height
    if height < HEIGHT_MIN:
        raise ViewError(f"{size[0]}x{size[1]} leaves no room over a legend of {legend.height} pixels; increase --size")
    return size[0], height


def _drawn(drawing: Drawing, strip: Image.Image) -> Iterator[Image.Image]:
    """Each frame over the legend."""
    for pixels in draw(drawing):
        picture = Image.new("RGB", (strip.width, pixels.shape[0] + strip.height))
        picture.paste(Image.fromarray(pixels), (0, 0))
        picture.paste(strip, (0, pixels.shape[0]))
        yield picture


def _write_gif(part: Path, frames: Frames, count: int, size: tuple[int, int]) -> None:
    """One palette for all frames: with a palette each, what stands still flickers."""
    key = np.unique(np.linspace(0, count - 1, KEY_FRAMES).round().astype(int)).tolist()
    sheet = Image.fromarray(np.concatenate([np.asarray(picture) for picture in frames(key)]))
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


def _write_mp4(part: Path, frames: Frames, count: int, size: tuple[int, int]) -> None:
    import imageio_ffmpeg

    writer = imageio_ffmpeg.write_frames(
        str(part),
        size,
        fps=RATES_HZ[".mp4"],
        codec="libx264",
        quality=7,
        macro_block_size=2,
        output_params=["-movflags", "+faststart", "-fflags", "+bitexact", "-threads", "1"],
    )
    writer.send(None)
    try:
        for frame in frames(range(count)):
            writer.send(frame.tobytes())
    finally:
        writer.close()
