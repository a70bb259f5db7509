"""Appearance of a swatch beyond its colour: small pictures that repeat over the surface.

Swatch files come from untrusted sources. Pictures must be PNG, and their size in bytes and pixels is checked in the
header before they are decompressed.
"""

import io
import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import SwatchError

__all__ = ["PICTURE_BYTES_MAX", "Look"]

PICTURE_BYTES_MAX: Final = 256 * 1024
"""Largest size of a picture file [bytes]."""

PICTURE_PX_MAX: Final = 512
"""Longest side of a picture [pixels]."""

SIZE_M: Final = (1e-4, 10.0)
"""Range of the side length that a picture shows [m]."""

_HEAD: Final = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR"


@dataclass(frozen=True)
class Look:
    """Pictures of a surface, which repeat.

    Attributes:
        roughness: 0 for a mirror to 1 for a matt surface.
        size_m: side of the square that the pictures show [m].
        albedo_png: colours, as the content of a PNG file; empty to use the colour of the swatch.
        normal_png: normals (x right, y up, z outwards; 0 to 255 for −1 to 1), as the content of a PNG file; empty to
            make a relief from the spectrum of the texture.

    Raises:
        SwatchError: a number is out of range, or a picture is not PNG or too large.
    """

    roughness: float = 0.6
    size_m: float = 0.01
    albedo_png: bytes = b""
    normal_png: bytes = b""

    def __post_init__(self) -> None:
        low, high = SIZE_M
        for name, least, most in (("roughness", 0.0, 1.0), ("size_m", low, high)):
            value = getattr(self, name)
            if not (math.isfinite(value) and least <= value <= most):
                raise SwatchError(f"look.{name} must be from {least:g} to {most:g}, is {value}")
        for name in ("albedo_png", "normal_png"):
            _check_png(name, getattr(self, name))

    def __repr__(self) -> str:
        pictures = [name for name in ("albedo", "normal") if getattr(self, f"{name}_png")]
        return f"<Look: roughness {self.roughness:g}, {' and '.join(pictures) or 'no'} picture>"

    def albedo(self) -> NDArray[np.float64] | None:
        """Return colours (h, w, 3), 0 to 1; None if there is no picture, or it is damaged."""
        return _pixels(self.albedo_png)

    def normal(self) -> NDArray[np.float64] | None:
        """Return unit normals (h, w, 3); None if there is no picture, or it is damaged."""
        pixels = _pixels(self.normal_png)
        if pixels is None:
            return None
        n = 2.0 * pixels - 1.0
        n[..., 2] = np.maximum(n[..., 2], 0.05)
        return np.asarray(n / np.linalg.norm(n, axis=2, keepdims=True))


def _check_png(name: str, content: bytes) -> None:
    """Check size and header of a PNG file."""
    if not content:
        return
    if len(content) > PICTURE_BYTES_MAX:
        raise SwatchError(f"look.{name} has {len(content):,} bytes; expected at most {PICTURE_BYTES_MAX:,}")
    if not content.startswith(_HEAD) or len(content) < len(_HEAD) + 8:
        raise SwatchError(f"look.{name} is not a PNG picture")
    width, height = (int.from_bytes(content[i : i + 4], "big") for i in (len(_HEAD), len(_HEAD) + 4))
    if not (1 <= width <= PICTURE_PX_MAX and 1 <= height <= PICTURE_PX_MAX):
        raise SwatchError(f"look.{name} is {width} × {height} pixels; each side must be from 1 to {PICTURE_PX_MAX}")


def _pixels(png: bytes) -> NDArray[np.float64] | None:
    """Return pixels (h, w, 3), 0 to 1; None without a picture, or if it cannot be read."""
    if not png:
        return None
    from PIL import Image

    try:
        with Image.open(io.BytesIO(png), formats=("PNG",)) as picture:
            if max(picture.size) > PICTURE_PX_MAX:  # a second header with another size
                return None
            return np.asarray(picture.convert("RGB"), np.float64) / 255.0
    except Exception:  # a damaged picture must not prevent use of the swatch
        return None
