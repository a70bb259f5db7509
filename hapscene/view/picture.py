"""Pictures and films of a scene with the path of the tool and the forces of a recorded touch."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from hapscene.errors import ViewError
from hapscene.io.files import whole_file
from hapscene.render.recording import Recording
from hapscene.scene.mesh_doctor import length as length_text
from hapscene.view.feel_layer import Show, used_swatches
from hapscene.view.figure_parts import ARROW_SPACING, BODIES, PROXY_COLOUR, arrow_ticks, make_figure_parts
from hapscene.view.offscreen import draw
from hapscene.view.palette import AIR, EDGE, FORCE, LIGHT, PATH, Theme, distinct_colours, rgb
from hapscene.view.triangles import Drawing, Frame, fit_cameras, orbit, visible_size

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

__all__ = ["RATES_HZ", "Legend", "LegendEntry", "entries_of", "measures_of", "write_picture"]

# Legend of a picture: meaning of the colours, a scale bar, and a force arrow of round length.


NAME_MAX: Final = 28
"""Maximum length of a name [characters]."""

MEASURE_MAX: Final = 0.2
"""Maximum length of the scale bar and the arrow, relative to the width of the picture [1]."""


class LegendEntry(NamedTuple):
    """A symbol and its text. `kind` is patch, line, thread, ball, bar or arrow; bars and arrows have a length."""

    text: str
    colour: str
    kind: str = "patch"
    length_px: int = 0


def entries_of(scene: "Scene", theme: Theme, path: bool = False, tool: bool = False) -> list[LegendEntry]:
    """Return the entries of a legend: used swatches, path, tool."""
    used = used_swatches(scene)
    colours = distinct_colours(scene.swatches, used)
    names = [swatch.name for swatch in scene.swatches]
    if any(body.mesh.colour_rgb is not None for body in scene.bodies):
        names[0] += " (look of the file)"
    names = [name if len(name) <= NAME_MAX else name[: NAME_MAX - 1] + "…" for name in names]
    entries = [LegendEntry(names[i], colours[i]) for i in used]
    if tool:
        entries += [LegendEntry("tool", theme.tool, "line"), LegendEntry("proxy", PROXY_COLOUR, "ball")]
    if path:
        entries += [LegendEntry("path on the surface", PATH, "line"), LegendEntry("in the air", AIR, "thread")]
    return entries


def measures_of(pixel_m: float, width: int, theme: Theme, arrow_m_N: float, f_max_N: float) -> list[LegendEntry]:
    """Return a scale bar and, if there are arrows, a force arrow, both of round length."""
    longest_m = MEASURE_MAX * width * pixel_m
    bar_m = round_down(longest_m)
    measures = [LegendEntry(length_text(bar_m), theme.ink, "bar", round(bar_m / pixel_m))]
    if arrow_m_N > 0:
        force_N = round_down(min(longest_m / arrow_m_N, f_max_N))
        text = f"force, {force_N:g} N" if force_N >= 0.00999 else f"force, {force_N * 1e3:g} mN"
        measures.insert(0, LegendEntry(text, FORCE, "arrow", round(force_N * arrow_m_N / pixel_m)))
    return measures


class Legend:
    """Draws entries in rows, and a last row of right-aligned measures.

    Attributes:
        height: total height [pixels].
    """

    def __init__(self, entries: Sequence[LegendEntry], width: int, theme: Theme) -> None:
        self._width, self._theme = width, theme
        self._size = max(11, round(width * 0.015))  # height of the text
        self._font = _font(self._size)
        self._rows: list[list[tuple[int, LegendEntry]]] = [[]]
        x = self._size
        for entry in entries:
            entry_width = self._entry_width(entry)
            if self._rows[-1] and x + entry_width > width - self._size:
                self._rows.append([])
                x = self._size
            self._rows[-1].append((x, entry))
            x += entry_width + 2 * self._size
        self.height = self._middle(len(self._rows)) + round(1.5 * self._size)

    def draw(self, measures: Sequence[LegendEntry]) -> Image.Image:
        """Draw the legend with these measures."""
        strip = Image.new("RGB", (self._width, self.height), self._theme.page)
        pen = ImageDraw.Draw(strip)
        last: list[tuple[int, LegendEntry]] = []
        x = self._width - self._size
        for entry in reversed(measures):
            x -= self._entry_width(entry)
            last.append((x, entry))
            x -= 2 * self._size
        for row, entries in enumerate([*self._rows, last]):
            for x, entry in entries:
                self._draw_sign(pen, entry, x, self._middle(row))
                text_x = x + self._sign_width(entry) + self._size // 2
                pen.text((text_x, self._middle(row)), entry.text, fill=self._theme.ink, font=self._font, anchor="lm")
        return strip

    def _draw_sign(self, pen: ImageDraw.ImageDraw, entry: LegendEntry, x: int, y: int) -> None:
        size, colour = self._size, entry.colour
        right = x + self._sign_width(entry)
        if entry.kind == "ball":
            middle, r = (x + right) // 2, round(size * 0.4)
            pen.ellipse((middle - r, y - r, middle + r, y + r), fill=colour, outline=self._theme.ink)
            return
        half = max(size // {"patch": 2, "line": 6, "thread": 12}.get(entry.kind, 8), 1)
        head = min(size, right - x) if entry.kind == "arrow" else 0
        edge = EDGE if entry.kind == "patch" else None
        pen.rectangle((x, y - half, right - head // 2, y + half), fill=colour, outline=edge)
        if entry.kind == "arrow":
            pen.polygon(((right, y), (right - head, y - head // 2), (right - head, y + head // 2)), fill=colour)
        elif entry.kind == "bar":  # with end marks
            for end in (x, right):
                pen.line((end, y - size // 2, end, y + size // 2), fill=colour, width=size // 10)

    def _entry_width(self, entry: LegendEntry) -> int:
        return self._sign_width(entry) + self._size // 2 + int(np.ceil(self._font.getlength(entry.text)))

    def _sign_width(self, entry: LegendEntry) -> int:
        return entry.length_px or (self._size if entry.kind == "ball" else round(1.4 * self._size))

    def _middle(self, row: int) -> int:
        return round((1.5 + 1.9 * row) * self._size)


@cache
def _font(size: int) -> ImageFont.FreeTypeFont:
    """Return the sans-serif font of matplotlib, which is the same on every machine."""
    package = find_spec("matplotlib")  # importing matplotlib takes longer than drawing a picture
    assert package is not None and package.origin is not None
    return ImageFont.truetype(Path(package.origin).parent / "mpl-data" / "fonts" / "ttf" / "DejaVuSans.ttf", size)


def round_down(value: float) -> float:
    """Round `value` > 0 down to 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1, 2, 5) if step * power <= value * (1 + 1e-9)))


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
    picture.save(part, format="PNG", compress_type=3)  # Z_RLE of zlib: same size, in a third of the time


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
