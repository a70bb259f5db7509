"""MPEG_material_haptic in glTF: a DRAFT of MPEG-I scene description, ISO/IEC 23090-14, that may still change.

Fields and structure follow the public drafts among Khronos's vendor extensions: the one to CD Amendment 2 of 2023
(`MPEG_material_haptic`), and the one to the DIS of the second edition of 2025, which has the same fields and calls it
`MPEG_haptic_material`. Both names are written, so that readers of either find it. The published standard has not been
compared.

The file lists haptic materials; each mesh names one by its index. A material's properties are textures. A swatch is
the same all over, so its textures have one pixel, 16 bits grey, and the meshes' texture coordinates are all zero (an
accessor without data). How a pixel's value stands for stiffness is not in the drafts: here 65535 is `full_scale`, in
the texture's `extras` beside the exact `value`. Static and dynamic friction are two textures of `friction`, told apart
by `quantity` there. What the drafts have no field for (damping, and a vibration that depends on force and speed) stays
in the `extras` of the glTF materials; `hapscene swatch export hjif` writes a vibration in MPEG's own format.
"""

import io
from collections.abc import Callable, Sequence
from typing import Any, Final

from hapscene.surface.swatch import FRICTION_MAX, Swatch

DRAFT_NAMES: Final = ("MPEG_material_haptic", "MPEG_haptic_material")
"""The extension's name in the draft of 2023, and in that of 2025."""

_PIXEL_MAX: Final = 65535


def add_haptics(
    tree: dict[str, Any],
    swatch_of_mesh: Sequence[int],
    swatches: Sequence[Swatch],
    add_view: Callable[[bytes], int],
) -> None:
    """Add the draft extension to a glTF tree.

    Args:
        tree: of glTF, with its meshes.
        swatch_of_mesh: index into `swatches` for each of them.
        swatches: of the scene.
        add_view: puts bytes into the buffer and gives the index of their view.
    """
    used = sorted(set(swatch_of_mesh))
    stiffest_N_m = max(swatches[i].stiffness_N_m for i in used) or 1.0
    pictures = _Pictures(tree, add_view)
    materials = []
    for i in used:
        swatch = swatches[i]
        stiffness = pictures.pixel("stiffness_N_m", swatch.stiffness_N_m, stiffest_N_m)
        friction = [
            pictures.pixel(quantity, getattr(swatch, quantity), FRICTION_MAX)
            for quantity in ("friction_static", "friction_dynamic")
        ]
        materials.append({"name": swatch.name, "stiffness": [stiffness], "friction": friction})
    note = "draft extension of ISO/IEC 23090-14, which may still change; 65535 stands for full_scale, in the unit named"
    for name in DRAFT_NAMES:
        tree.setdefault("extensions", {})[name] = {"materials": materials, "extras": {"note": note}}
    tree["extensionsUsed"] = list(DRAFT_NAMES)
    for mesh, swatch_index in zip(tree["meshes"], swatch_of_mesh, strict=True):
        index = used.index(swatch_index)
        mesh["extensions"] = {name: {"hapticMaterialIndex": index} for name in DRAFT_NAMES}
        for primitive in mesh["primitives"]:
            count = tree["accessors"][primitive["attributes"]["POSITION"]]["count"]
            tree["accessors"].append({"componentType": 5126, "count": count, "type": "VEC2"})  # no data: all zero
            primitive["attributes"]["TEXCOORD_0"] = len(tree["accessors"]) - 1


class _Pictures:
    """Textures of one pixel, each value once."""

    def __init__(self, tree: dict[str, Any], add_view: Callable[[bytes], int]) -> None:
        self.tree, self.add_view = tree, add_view
        tree |= {"images": [], "textures": []}
        self.texture_of: dict[int, int] = {}

    def pixel(self, quantity: str, value: float, full_scale: float) -> dict[str, Any]:
        grey = round(min(value / full_scale, 1.0) * _PIXEL_MAX)
        if grey not in self.texture_of:
            view = self.add_view(_png(grey))
            self.tree["images"].append({"bufferView": view, "mimeType": "image/png"})
            self.tree["textures"].append({"source": len(self.tree["images"]) - 1})
            self.texture_of[grey] = len(self.tree["textures"]) - 1
        return {
            "texture": {"index": self.texture_of[grey]},
            "type": "Low_Resolution",
            "extras": {"quantity": quantity, "value": value, "full_scale": full_scale},
        }


def _png(grey: int) -> bytes:
    """A picture of one pixel, 16 bits grey."""
    from PIL import Image

    buffer = io.BytesIO()
    picture = Image.new("I;16", (1, 1))
    picture.putpixel((0, 0), grey)
    picture.save(buffer, "PNG")
    return buffer.getvalue()
