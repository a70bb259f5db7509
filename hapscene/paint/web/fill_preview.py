"""What a click of the bucket will take, lit up under the pointer before it is clicked."""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.paint.web.scene_view import SceneView

OPACITY: Final = 0.55


class FillPreview:
    """The light over the faces that a fill will take.

    Args:
        view: that it lies in.
    """

    def __init__(self, view: SceneView) -> None:
        self._view = view
        self._light: Any = None
        self._shown: object = None

    def show(self, body: int, faces: NDArray[np.bool_], colour: str, key: object) -> None:
        """Light up faces (M,) of a body; what has the same key is shown already."""
        if key != self._shown:
            self.hide()
            self._shown, self._light = key, self._view.add_light(body, faces, colour, OPACITY)

    def hide(self) -> None:
        """Put it out."""
        if self._light is not None:
            self._light.remove()
        self._shown = self._light = None
