"""A body as its own file colours it, in few colours: what is unpainted is shown so; under paint, its light and dark."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.scene.mesh import Mesh
from hapscene.view.body_triangles import shade_of

COLOURS: Final = 16
"""Most colours that a file's own are brought down to [count]: each is drawn as a mesh of its own."""


@dataclass(frozen=True, eq=False)
class FileLook:
    """A file's colours.

    Attributes:
        rgb: (k, 3) the few, 0 to 1.
        shade: (k,) what each makes of a swatch's colour, as a factor.
        tint: (M,) uint8, which of them each face has.
    """

    rgb: NDArray[np.float64]
    shade: NDArray[np.float64]
    tint: NDArray[np.uint8]

    @staticmethod
    def of(mesh: Mesh) -> "FileLook | None":
        """That of a mesh; None where its file has no colours."""
        if mesh.colour_rgb is None:
            return None
        from PIL import Image

        picture = Image.fromarray(np.ascontiguousarray(mesh.colour_rgb[None]))
        few = picture.quantize(COLOURS, Image.Quantize.MEDIANCUT, kmeans=2, dither=Image.Dither.NONE)
        tint = np.asarray(few)[0].astype(np.uint8)
        count = np.bincount(tint)
        sums = [np.bincount(tint, mesh.colour_rgb[:, k]) / np.maximum(count, 1) for k in range(3)]
        rgb = np.stack(sums, axis=1)
        return FileLook(rgb / 255, shade_of(rgb, mesh.colour_rgb), tint)
