"""Appearance of faces in a mesh file: materials with textures, in the metallic-roughness model of glTF 2.0.

Materials are for display only: a swatch defines what a face feels like, the material what it looks like.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

__all__ = ["TEXTURES", "Material"]

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
    textures: Mapping[str, Any] = field(default_factory=dict)

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
            colour = getattr(material, "baseColorFactor", None)  # trimesh keeps linear values as bytes
            found = {key: getattr(material, key, None) for key in TEXTURES}
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


def _opacity(colour: Any) -> tuple[float, ...]:
    return (float(np.clip(colour[3] / 255, 0.0, 1.0)) if len(colour) > 3 else 1.0,)


def _number(value: object, default: float) -> float:
    return default if value is None else _numbers([value], 1)[0]


def _numbers(values: object, count: int) -> tuple[float, ...]:
    """Return `count` numbers, limited to the range from 0 to 1."""
    found = np.clip(np.asarray(values, np.float64)[:count], 0.0, 1.0)
    if found.shape != (count,) or not np.isfinite(found).all():
        raise ValueError
    return tuple(found.tolist())
