"""Picture of a swatch: a ball with its appearance, or with a relief computed from the spectrum of its texture."""

import io
import math
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.surface.look import Look
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_summary import FORCE_N, SPEED_M_S, figures
from hapscene.surface.texture import Texture

__all__ = ["BALL_PX", "ball_png", "plain_look", "relief"]

Array = NDArray[np.float64]

BALL_PX: Final = 72
"""Default width of a picture [pixels]."""

BALL_M: Final = 0.012
"""Width of the surface on the ball [m]: it shows periods from 0.3 to 6 mm, which cause audible vibration in a
stroke."""

FINER: Final = 2
"""Rendered pixels per pixel along each side [1]."""

TILE_PX: Final = 256
"""Size of a computed relief [pixels]; it shows `BALL_M`."""

SLOPE: Final = 0.3
"""RMS slope of the relief of a surface with `ROUGH_M_S2` [1]; it grows with the square root of the roughness."""

ROUGH_M_S2: Final = 2.0

LINE_DB: Final = 6.0
"""Minimum prominence of a spectral line [dB]."""

PERIOD_M: Final = (1.5e-4, 8e-3)
"""Range of detected periods [m]."""

LIGHT: Final = np.array([-0.45, 0.6, 0.66])

Rgb = tuple[float, float, float]


@lru_cache(maxsize=256)
def ball_png(swatch: Swatch, colour: Rgb | None = None, px: int = BALL_PX) -> bytes:
    """Return a PNG file of the ball on a transparent background; `colour` overrides the colour of the swatch."""
    from PIL import Image

    n = FINER * px
    x, y = np.meshgrid((np.arange(n) + 0.5) / n * 2 - 1, 1 - (np.arange(n) + 0.5) / n * 2)
    inside = x**2 + y**2 < 0.96**2
    x, y = np.where(inside, x, 0.0) / 0.97, np.where(inside, y, 0.0) / 0.97
    z = np.sqrt(1.0 - x**2 - y**2)
    look = swatch.look or plain_look(swatch)
    u, v = np.arcsin(x) / math.pi * 2, np.arcsin(y) / math.pi * 2  # from −1 to 1 over the visible part
    slopes, size_m = relief(swatch)
    normal = _bent(np.stack([x, y, z], axis=2), _sampled(slopes, u, v, size_m))
    albedo = look.albedo()
    flat = np.array(colour or swatch.albedo_rgb)
    base = np.broadcast_to(flat, (*x.shape, 3)) if albedo is None else _sampled(albedo, u, v, look.size_m)
    light = LIGHT / np.linalg.norm(LIGHT)
    half = light + np.array([0.0, 0.0, 1.0])  # half vector between light and viewer
    half /= np.linalg.norm(half)
    diffuse = np.clip(normal @ light, 0.0, 1.0)
    width = 2.0 / max(look.roughness, 0.1) ** 4
    shine = np.clip(normal @ half, 0.0, 1.0) ** width * (1.0 - look.roughness) * 0.9
    shaded = base * (0.28 + 0.8 * diffuse)[..., None] + shine[..., None]
    rim = np.hypot(x, y) > 0.94  # visible on light and dark backgrounds
    shaded[rim] = 0.5
    pixels = np.dstack([np.clip(shaded, 0.0, 1.0), inside])
    pixels[..., :3] *= pixels[..., 3:]
    small = pixels.reshape(px, FINER, px, FINER, 4).mean(axis=(1, 3))
    small[..., :3] /= np.maximum(small[..., 3:], 1e-6)
    file = io.BytesIO()
    Image.fromarray(np.rint(255 * small).astype(np.uint8), "RGBA").quantize(160).save(file, "PNG", optimize=True)
    return file.getvalue()


def plain_look(swatch: Swatch) -> Look:
    """Return the default appearance of a swatch: rough textures look matt."""
    roughness = figures(swatch).get("roughness_m_s2", 0.0)
    return Look(roughness=float(np.clip(0.25 + 0.3 * math.log10(1.0 + 10.0 * roughness), 0.25, 0.9)))


def _sampled(picture: Array, u: Array, v: Array, size_m: float) -> Array:
    """Sample a periodic picture at positions on the ball."""
    h, w = picture.shape[:2]
    column = np.floor(u * BALL_M / 2 / size_m * w).astype(int) % w
    row = np.floor(-v * BALL_M / 2 / size_m * h).astype(int) % h
    return np.asarray(picture[row, column])


def relief(swatch: Swatch) -> tuple[Array, float]:
    """Return the slopes (h, w, 2) of a periodic relief along its tangents, to the right and up, and its size [m].

    It is the normal map of the swatch, else computed from its texture; (1, 1, 2) zeros for a swatch without both.
    """
    normal = None if swatch.look is None else swatch.look.normal()
    if normal is not None and swatch.look is not None:
        return -normal[..., :2] / normal[..., 2:], swatch.look.size_m
    if swatch.texture is None:
        return np.zeros((1, 1, 2)), BALL_M
    roughness = swatch.parameter("lpc_texture", "texture_gain", 1.0) * figures(swatch)["roughness_m_s2"]
    return SLOPE * min(math.sqrt(roughness / ROUGH_M_S2), 1.7) * _slopes(swatch.texture), BALL_M


@lru_cache(maxsize=256)
def _slopes(texture: Texture) -> Array:
    """Return slopes (n, n, 2) with rms 1 of a height field with the spectrum of a texture at a stroke.

    A vibration at frequency f and speed v has the period v/f; its height is its acceleration divided by (2π f)².
    """
    force, speed = min(FORCE_N, texture.force_max_N), min(SPEED_M_S, texture.speed_max_m_s)
    period = _period_m(texture, force)
    if period is not None:  # parallel grooves
        count = max(round(BALL_M / period), 1)
        across = math.sqrt(2) * np.sin(2 * np.pi * count * np.arange(TILE_PX) / TILE_PX)
        return np.asarray(np.stack([np.tile(across, (TILE_PX, 1)), np.zeros((TILE_PX, TILE_PX))], axis=2))
    f = np.geomspace(20.0, 1000.0, 500)
    power = texture.density([force], [speed], frequency_Hz=f)[0] * f  # power per logarithmic frequency interval
    wave = np.fft.fftfreq(TILE_PX, BALL_M / TILE_PX)
    qx, qy = np.meshgrid(wave, wave)
    q = np.hypot(qx, qy)
    q[0, 0] = np.inf
    level = np.interp(np.log(q * speed), np.log(f), np.log(power), left=-np.inf, right=-np.inf)
    height = np.sqrt(np.exp(level)) / (q * speed) ** 3  # density over the plane: power/(f f⁴) divided by q
    phase = np.fft.fft2(np.random.default_rng(7).standard_normal((TILE_PX, TILE_PX)))
    made = np.stack([np.fft.ifft2(2j * np.pi * k * height * phase).real for k in (qx, qy)], axis=2)
    return np.asarray(made / max(float(np.sqrt(np.mean(made**2) * 2)), 1e-300))


def _period_m(texture: Texture, force_N: float) -> float | None:
    """Return the period of a periodic profile [m] or None; unlike resonances, its frequency grows with the speed."""
    q = np.geomspace(1.0 / PERIOD_M[1], 1.0 / PERIOD_M[0], 800)
    lines = []
    for v in (texture.speed_max_m_s, texture.speed_max_m_s / 2):
        level = 10.0 * np.log10(np.maximum(texture.density([force_N], [v], frequency_Hz=q * v)[0], 1e-30))
        lines.append(q[_peaks(level)])
    found = [peak for peak in lines[0] if np.any(np.abs(lines[1] / peak - 1.0) < 0.06)]
    return 1.0 / found[0] if found else None


def _peaks(level: Array) -> list[int]:
    """Return the indices of maxima with a prominence of `LINE_DB`; importing `scipy.signal` would take a second."""
    found = []
    for i in np.flatnonzero((level[1:-1] > level[:-2]) & (level[1:-1] > level[2:])) + 1:
        higher = np.flatnonzero(level > level[i])
        left, right = higher[higher < i].max(initial=0), higher[higher > i].min(initial=len(level))
        if level[i] - max(level[left : i + 1].min(), level[i:right].min()) >= LINE_DB:
            found.append(int(i))
    return found


def _bent(normal: Array, slope: Array) -> Array:
    """Return the unit normals (…, 3) of a ball, tilted by slopes (…, 2) along its tangents to the right and up."""
    right = np.stack([normal[..., 2], np.zeros(normal.shape[:2]), -normal[..., 0]], axis=2)
    right /= np.maximum(np.linalg.norm(right, axis=2, keepdims=True), 1e-9)
    up = np.cross(normal, right)
    bent = normal - slope[..., :1] * right - slope[..., 1:] * up
    return np.asarray(bent / np.linalg.norm(bent, axis=2, keepdims=True))
