"""Draw the pictures of the shipped swatches and write them to their files: python swatches/looks.py

The pictures are made up by rule, are periodic, and come out the same every time; run this after `fit.py`. They show a
square of `SIZE_M`, three times that of the relief which is computed from the texture of a swatch. Licence: MIT, as that
of the swatches.
"""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.spatial
from PIL import Image

from hapscene.surface.look import Look
from hapscene.surface.swatch_file import read_swatch, save_swatch
from hapscene.swatches.picture import plain_look

HERE = Path(__file__).parent
SIZE_M = 0.036
PX = 384
COLOURS = 24  # of the palette; more are not seen below the relief, and make larger files

u, v = np.meshgrid(np.arange(PX) / PX, np.arange(PX) / PX)


def main() -> None:
    for name, draw in (("wood", wood), ("leather", leather), ("paper", paper), ("epoxy", epoxy)):
        path = HERE / f"{name}.swatch"
        swatch = read_swatch(path)
        brightness = draw()
        pixels = np.array(swatch.albedo_rgb) * (brightness / brightness.mean(axis=(0, 1)))
        picture = Image.fromarray(np.rint(255 * np.clip(pixels, 0, 1)).astype(np.uint8))
        file = io.BytesIO()
        picture.quantize(COLOURS, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE).save(file, "PNG", optimize=True)
        look = Look(plain_look(swatch).roughness, SIZE_M, file.getvalue())
        save_swatch(replace(swatch, look=look), path)
        print(f"{name}: {len(file.getvalue()):,} bytes")


def noise(seed: int, across: float, along: float, steep: float = 2.0) -> np.ndarray:
    """Periodic noise with the standard deviation 1, of features of these sizes along v and u, relative to the tile."""
    f = np.fft.fftfreq(PX, 1 / PX)
    far = np.hypot(f[None, :] * along, f[:, None] * across)
    spectrum = np.fft.fft2(np.random.default_rng(seed).standard_normal((PX, PX))) / (1 + far**2) ** (steep / 2)
    spectrum[0, 0] = 0
    made = np.fft.ifft2(spectrum).real
    return made / made.std()


def tinted(brightness: np.ndarray, tint: tuple[float, float, float]) -> np.ndarray:
    """A colour whose channels follow the brightness with different strength."""
    return np.exp(brightness[..., None] * np.array(tint))


def wood() -> np.ndarray:
    """Oak, cut along the grain: rings of uneven width, with dark pores along them."""
    ring = 7 * v + 0.55 * noise(1, 0.5, 1.5, 4.0) + 0.05 * noise(2, 0.05, 0.6)
    late = (ring % 1) ** 3  # a ring darkens slowly and ends sharply
    pores = np.maximum(noise(3, 0.004, 0.12, 3.0) - 1.2, 0) * (0.4 + 0.6 * late)
    return tinted(-0.34 * late - 0.22 * pores + 0.05 * noise(4, 0.01, 0.4), (0.8, 1.0, 1.25))


def leather() -> np.ndarray:
    """Grain of leather: pebbles with dark creases between them, on clouds of dye."""
    rng = np.random.default_rng(5)
    middle = rng.random((420, 2))
    tiles = np.concatenate([middle + np.array((i, j)) for i in (-1, 0, 1) for j in (-1, 0, 1)])
    bent = np.stack([u + 0.008 * noise(6, 0.1, 0.1, 4.0), v + 0.008 * noise(7, 0.1, 0.1, 4.0)], axis=2)
    far, _ = scipy.spatial.KDTree(tiles).query(bent, k=2)
    crease = np.exp(-((far[..., 1] - far[..., 0]) / 0.008))
    return tinted(0.08 * noise(8, 0.3, 0.3, 3.0) - 0.35 * crease, (1.0, 1.1, 1.15))


def paper() -> np.ndarray:
    """Handmade paper: clouds, and fibres of all directions."""
    fibres = np.zeros((PX, PX))
    rng = np.random.default_rng(10)
    ends = rng.random((260, 3)) * (1, 1, 2 * np.pi)
    for (x, y, way), bend in zip(ends, rng.normal(size=260), strict=True):
        s = np.linspace(0, rng.uniform(0.03, 0.14), 90)
        turn = way + 9 * bend * s
        px = (np.stack([y + np.cumsum(np.sin(turn)) * s[1], x + np.cumsum(np.cos(turn)) * s[1]]) * PX).astype(int) % PX
        fibres[px[0], px[1]] = 1
    soft = np.fft.ifft2(np.fft.fft2(fibres) * np.exp(-((np.hypot(*np.meshgrid(*[np.fft.fftfreq(PX)] * 2)) / 0.2) ** 2)))
    return tinted(0.022 * noise(11, 0.12, 0.12) - 0.11 * soft.real, (0.8, 1.0, 1.5))


def epoxy() -> np.ndarray:
    """Cast resin: veils of pigment."""
    veil = np.abs(noise(12, 0.35, 0.5, 3.5) + 0.25 * noise(13, 0.06, 0.08, 3.0))
    return tinted(0.4 * np.exp(-3 * veil) - 0.12 * veil, (1.6, 0.9, 0.6))


if __name__ == "__main__":
    main()
