"""Appearance of faces in a mesh file: materials with textures, in the metallic-roughness model of glTF 2.0.

Materials are for display only: a swatch defines what a face feels like, the material what it looks like.
"""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapscene.io.files import Json

if TYPE_CHECKING:
    from PIL import Image

__all__ = ["TEXTURES", "Material", "open_picture", "picture_file"]

JPEG_QUALITY: Final = 92
"""Quality of pictures in JPEG, from 1 to 95 [1]: no visible artefacts, at a fifth of the size of PNG."""

TEXTURES: Final = (
    *("baseColorTexture", "metallicRoughnessTexture"),
    *("normalTexture", "occlusionTexture", "emissiveTexture"),
)
"""Names of the textures of a material in glTF 2.0, sections 3.9.2 and 3.9.3."""


@dataclass(frozen=True, eq=False)
class Material:
    """A material of a mesh file.

    Attributes:
        name: name in the file; may be empty.
        colour: linear red, green, blue and opacity, which multiply the texture (4,), 0 to 1.
        metallic: 0 for dielectrics to 1 for metals.
        roughness: 0 for a mirror to 1 for a matt surface.
        emissive: linear light that the surface emits (3,).
        alpha: OPAQUE, MASK or BLEND.
        cutoff: opacity below which a face of the mode MASK is transparent.
        two_sided: whether back faces are visible.
        textures: pictures (PIL images) by name, see `TEXTURES`.
    """

    name: str = ""
    colour: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)
    metallic: float = 0.0
    roughness: float = 0.8
    emissive: tuple[float, ...] = (0.0, 0.0, 0.0)
    alpha: str = "OPAQUE"
    cutoff: float = 0.5
    two_sided: bool = False
    textures: "Mapping[str, Image.Image]" = field(default_factory=dict)

    @staticmethod
    def of(material: Any) -> "Material | None":
        """Convert a material of trimesh; None if it has an invalid value."""
        name = str(getattr(material, "name", None) or "")
        try:
            if hasattr(material, "image"):  # a SimpleMaterial, of OBJ files; a texture replaces its colour
                if material.image is not None:
                    return Material(name, textures={TEXTURES[0]: material.image})
                share = _numbers(np.asarray(material.diffuse, np.float64) / 255, 3)
                return Material(name, (*(c**2.2 for c in share), 1.0))
            found: dict[str, Any] = {key: getattr(material, key, None) for key in TEXTURES}
            colour = getattr(material, "baseColorFactor", None)  # trimesh keeps linear values as bytes
            return Material(
                name,
                (1.0,) * 4 if colour is None else (*_numbers(np.asarray(colour) / 255, 3), *_opacity(colour)),
                _number(material.metallicFactor, 1.0),
                _number(material.roughnessFactor, 1.0),
                (0.0,) * 3 if material.emissiveFactor is None else _numbers(material.emissiveFactor, 3),
                material.alphaMode if material.alphaMode in ("MASK", "BLEND") else "OPAQUE",
                _number(material.alphaCutoff, 0.5),
                bool(material.doubleSided),
                {key: picture for key, picture in found.items() if hasattr(picture, "save")},
            )
        except (AttributeError, TypeError, ValueError):
            return None

    @property
    def numbers(self) -> dict[str, object]:
        """Everything but the textures, with the names of glTF 2.0."""
        return {
            **{"name": self.name, "baseColorFactor": self.colour, "metallicFactor": self.metallic},
            **{"roughnessFactor": self.roughness, "emissiveFactor": self.emissive, "doubleSided": self.two_sided},
            **{"alphaMode": self.alpha, "alphaCutoff": self.cutoff},
        }

    @staticmethod
    def from_numbers(numbers: Mapping[str, Json], textures: "Mapping[str, Image.Image | None]") -> "Material | None":
        """Return a material from `numbers` of an untrusted file and from pictures by name; None if one is invalid."""
        try:
            colour = np.asarray(numbers["baseColorFactor"], np.float64) * 255
            pictures = {name: textures.get(name) for name in TEXTURES}
            return Material.of(SimpleNamespace(**{**numbers, **pictures, "baseColorFactor": colour}))
        except (KeyError, TypeError, ValueError):
            return None


def open_picture(content: bytes) -> "Image.Image":
    """Return a picture file (PNG or JPEG) as PIL image that is decoded later and keeps the file for `picture_file`."""
    from PIL import Image

    picture = Image.open(io.BytesIO(content), formats=("PNG", "JPEG"))
    vars(picture)["content"] = content
    return picture


def picture_file(picture: "Image.Image", kind: str = "") -> tuple[bytes, str]:
    """Return the content of a picture file and its type, PNG or JPEG; a picture from a JPEG file stays JPEG."""
    picture.load()  # raises if it is damaged
    kept: bytes | None = getattr(picture, "content", None)
    kind, content = kind or ("JPEG" if picture.format == "JPEG" else "PNG"), io.BytesIO()
    if kept is not None and kind == picture.format:
        return kept, kind
    if picture.mode not in ("RGB", "L", *(("RGBA", "LA", "P", "1") if kind == "PNG" else ())):
        picture = picture.convert("RGB" if kind == "JPEG" else "RGBA")
    picture.save(content, kind, **({"quality": JPEG_QUALITY} if kind == "JPEG" else {}))
    return content.getvalue(), kind


def _opacity(colour: Sequence[float]) -> tuple[float, ...]:
    return (float(np.clip(colour[3] / 255, 0.0, 1.0)) if len(colour) > 3 else 1.0,)


def _number(value: object, default: float) -> float:
    return default if value is None else _numbers([value], 1)[0]


def _numbers(values: object, count: int) -> tuple[float, ...]:
    """Return `count` numbers, limited to the range from 0 to 1."""
    found = np.clip(np.asarray(values, np.float64)[:count], 0.0, 1.0)
    if found.shape != (count,) or not np.isfinite(found).all():
        raise ValueError
    return tuple(found.tolist())
