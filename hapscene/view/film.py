"""A picture that moves, GIF or MP4, a kind of its own: the camera goes around the scene, painted and touched."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from PIL import Image

from hapscene.errors import ViewError
from hapscene.io.files import whole_file
from hapscene.render.recording import Recording
from hapscene.view.camera import looks, place
from hapscene.view.figure_parts import make_figure_parts
from hapscene.view.legend import draw_strip, entries_of, lay_out, measures_of, strip_height
from hapscene.view.offscreen import draw
from hapscene.view.palette import AIR, FORCE, LIGHT, PATH, Theme, rgb
from hapscene.view.picture import OVERSAMPLING, area_over
from hapscene.view.triangles import Drawing, Frame

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

SECONDS: Final = 6.0
"""How long a film without a touch lasts, where no one says [s]; one with a touch lasts as long as it."""

RATES_HZ: Final = {".gif": 12.5, ".mp4": 25.0}
"""Frames a second, where no one says; also the kinds of films there are."""

GIF_RATE_MAX_HZ: Final = 50.0
"""Fastest GIF that viewers keep up with [Hz]: they play steps under 0.02 s slowly."""

PAINTING_SHARE: Final = 0.25
"""How much of a film that shows painting and touching is painting [1]; the rest is touching."""

GIF_COLOURS: Final = 255
"""Colours of a GIF [count]: one of 256 is left for "as before", which makes the file small."""

KEY_FRAMES: Final = 5
"""Frames, drawn before the others, from which a GIF's colours are chosen [count]."""


PATCH_PX: Final = 60
"""How much the thin things, arrows and paths, weigh among a GIF's colours: rows of pixels beside those frames."""

Frames = Callable[[Sequence[int]], Iterator[Any]]
"""Draws those pictures of a film, of Pillow's class Image, one after another."""


@dataclass(frozen=True)
class Film:
    """How a film shall be.

    Attributes:
        size: width and height with the legend [pixels].
        seconds: how long; else the touch's own time, or `SECONDS`.
        frame_count: else by `RATES_HZ`.
        turn_rad: by how much the camera goes around the scene.
        painting: whether the bodies begin plain and are painted swatch by swatch.
        theme: colours around the scene.
    """

    size: tuple[int, int] = (800, 600)
    seconds: float | None = None
    frame_count: int | None = None
    turn_rad: float = 2.0 * np.pi
    painting: bool = False
    theme: Theme = LIGHT


def write_film(
    scene: "Scene",
    recording: Recording | None,
    path: str | Path,
    *,
    film: Film,
    say: Callable[[str], None] = lambda text: None,
) -> None:
    """Draw the scene from around, and the touch as it goes on, as GIF or MP4 by the file's suffix.

    Args:
        scene: what to draw.
        recording: a touch to play, or None.
        path: where the file shall be.
        film: how it shall be.
        say: is given the progress, piece by piece.

    Raises:
        ViewError: no GL can draw here, an MP4 without the extra `video` or of an odd size, a GIF too fast.
        OSError: the folder is missing or cannot be written.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if recording is not None and len(recording) < 2:
        recording = None
    seconds = film.seconds or (SECONDS if recording is None else len(recording) * _tick_s(recording))
    count = film.frame_count or max(round(seconds * RATES_HZ[kind]), 2)
    encode = _gif if kind == ".gif" else _mp4
    check = _check_gif if kind == ".gif" else _check_mp4
    check(film.size, count / seconds)
    drawing, strip = _compose(scene, recording, film, count)

    def frames(order: Sequence[int]) -> Iterator[Any]:
        said = 0
        for k, pixels in enumerate(draw(replace(drawing, frames=[drawing.frames[i] for i in order]))):
            picture = Image.new("RGB", film.size)
            picture.paste(Image.fromarray(pixels), (0, 0))
            picture.paste(strip, (0, pixels.shape[0]))
            yield picture
            if (k + 1) * 10 // len(order) > said:
                said = (k + 1) * 10 // len(order)
                say(f"{said * 10} % ")

    with whole_file(path) as part:
        encode(part, frames, count, seconds, film.size)


def _compose(scene: "Scene", recording: Recording | None, film: Film, count: int) -> tuple[Drawing, Any]:
    """All frames to draw, and the strip under each."""
    painting_count = 0
    if film.painting:
        painting_count = count if recording is None else round(PAINTING_SHARE * count)
    ticks = np.zeros(0, np.int64)
    if recording is not None:
        ticks = np.linspace(0, len(recording) - 1, max(count - painting_count, 2)).round().astype(np.int64)
    stage = make_figure_parts(scene, recording, film.theme, ticks, film.painting)
    turns_rad = film.turn_rad * np.arange(count) / count
    R_SC = looks(turns_rad.tolist() if film.turn_rad else [0.0])
    entries = entries_of(scene, film.theme, path=recording is not None, tool=recording is not None)
    strip_px = strip_height(entries, 1 if recording is None else 2, film.size[0])
    area = area_over(strip_px, film.size)
    poses, extent_m, pixel_m = place(stage.points_m(tool=True), R_SC, area)
    frames = []
    for k in range(count):
        tick = int(ticks[min(k - painting_count, len(ticks) - 1)]) if k >= painting_count and len(ticks) else None
        share = min((k + 1) / (0.85 * painting_count), 1.0) if painting_count else 1.0
        frames.append(Frame(poses[k % len(poses)], stage.shown(tick, round(share * stage.slice_count))))
    placed, _ = lay_out(entries, measures_of(pixel_m, area[0], film.theme, stage.arrow_m_N, stage.f_max_N), area[0])
    drawing = Drawing(stage.parts, frames, extent_m, area, film.theme.background, OVERSAMPLING)
    return drawing, draw_strip(placed, area[0], strip_px, film.theme)


def _gif(part: Path, frames: Frames, count: int, seconds: float, size: tuple[int, int]) -> None:
    key = np.unique(np.linspace(0, count - 1, KEY_FRAMES).round().astype(int)).tolist()
    drawn = frames([*key, *range(count)])
    palette = _palette([next(drawn) for _ in key])
    pictures = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in drawn]
    ends_cs = np.round(100.0 * seconds * np.linspace(0, 1, count + 1)).astype(int)  # GIF counts in 1/100 s
    first, *rest = pictures
    first.save(
        part,
        format="GIF",
        save_all=True,
        append_images=rest,
        duration=[10 * int(b - a) for a, b in pairwise(ends_cs)],
        loop=0,
        optimize=False,
    )


def _palette(sample: list[Any]) -> Any:
    """One palette for all frames, or what stands still would flicker: from some of them, and of thin things by hand."""
    signs = np.array([rgb(colour) for colour in (FORCE, PATH, AIR)]) * 255
    shades = (signs[:, None] * np.linspace(0.6, 1.0, 5)[:, None]).reshape(-1, 3).clip(0, 255).astype(np.uint8)
    width = sample[0].width
    patches = np.broadcast_to(shades[np.arange(width) * len(shades) // width], (PATCH_PX, width, 3))
    sheet = np.concatenate([*(np.asarray(picture) for picture in sample), patches])
    return Image.fromarray(sheet).quantize(GIF_COLOURS, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)


def _check_gif(size: tuple[int, int], rate_Hz: float) -> None:
    if rate_Hz > GIF_RATE_MAX_HZ:
        raise ViewError(
            f"{rate_Hz:.1f} frames a second are too many for a GIF, which has at most {GIF_RATE_MAX_HZ:g}: "
            "fewer --frames, more --seconds, or .mp4"
        )


def _mp4(part: Path, frames: Frames, count: int, seconds: float, size: tuple[int, int]) -> None:
    import imageio_ffmpeg

    writer = imageio_ffmpeg.write_frames(
        str(part),
        size,
        fps=count / seconds,
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


def _check_mp4(size: tuple[int, int], rate_Hz: float) -> None:
    if find_spec("imageio_ffmpeg") is None:
        raise ViewError(
            "an MP4 needs the extra `video`: pip install 'hapscene[video]'; or write a .gif, which needs nothing more"
        )
    if size[0] % 2 or size[1] % 2:
        raise ViewError(f"an MP4 has an even width and height; {size[0]}x{size[1]} has not")


def _tick_s(recording: Recording) -> float:
    return float(np.median(np.diff(recording.t_s)))
