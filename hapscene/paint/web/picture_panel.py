"""Painting by picture, in the tab File: an image over the texture coordinates of a body in, and out."""

import asyncio
import io
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from hapscene.errors import SceneError
from hapscene.paint.web.page_context import PageContext, bounded, card_html, set_html, upload_html
from hapscene.scene.uv_paint import SCALED, Meanings, paint_by_picture, save_picture, scaled

PICTURES: Final = (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff")
LEGEND: Final = ".json"
NONE: Final = "…"

COLOURS: Final = "its colours mean swatches"
GREYS: Final = {f"its greys scale {what} of the chosen swatch": what for what in SCALED}

HINT: Final = (
    "Each colour means the swatch of the scene that has it; colours between two are blends. What is transparent stays. "
    "Download the picture to paint on in another program."
)
BARE: Final = "No mesh here has texture coordinates to lay a picture on: unwrap it in a modeller, export GLB or OBJ."


class PicturePanel:
    """Its folder.

    Args:
        context: the page.
        container: the tab it is in.
    """

    def __init__(self, context: PageContext, container: Any) -> None:
        self._context = context
        gui = context.server.gui
        with container, gui.add_folder("Paint by picture", expand_by_default=False):
            self._told = gui.add_html("")
            self._body = gui.add_dropdown("Body", (NONE,), hint="Whose painting the picture is")
            self._means = gui.add_dropdown("Meaning", (COLOURS, *GREYS))
            self._low = gui.add_number("Black", 0.5, min=0.0, max=10.0, step=0.1, hint="Factor where it is black")
            self._high = gui.add_number("White", 1.5, min=0.0, max=10.0, step=0.1, hint="Factor where it is white")
            hint = "Paints the body, in one step; its legend may come along"
            self._up = gui.add_html(upload_html("Upload picture …", (*PICTURES, LEGEND), hint))
            self._down = gui.add_button("Download picture", hint="A colour for each swatch, and its legend beside it")
        self._means.on_update(context.callback(lambda target: self.show()))
        self._down.on_click(context.downloading(self._picture))
        self.show()

    def show(self) -> None:
        """Offer the bodies that there are by now."""
        names = tuple(body.name for body in self._context.session.scene.bodies if body.mesh.uv is not None)
        if tuple(self._body.options) != (names or (NONE,)):
            self._body.options = names or (NONE,)
        set_html(self._told, card_html(HINT if names else BARE, dim=True))
        grey = self._means.value in GREYS
        for field, seen in ((self._body, True), (self._means, True), (self._low, grey), (self._high, grey)):
            field.visible = bool(names) and seen
        self._up.visible = self._down.visible = bool(names)

    async def take(self, files: Sequence[Path]) -> None:
        """Paint by a picture that was dropped on the page, or chosen; with its legend, if that came along.

        Raises:
            HapsceneError: it is none, or more than one, or what it means is not known; or the scene changed meanwhile.
        """
        pictures = [file for file in files if file.suffix.lower() in PICTURES]
        self.show()
        if self._body.value == NONE:
            raise SceneError(BARE)
        if len(pictures) != 1:
            raise SceneError("drop one picture, and its legend (.json) with it")
        painting, body, legend = self._context.session.painting, str(self._body.value), self._greys()
        scene, state = painting.snapshot(), painting.state
        await asyncio.to_thread(paint_by_picture, scene, body, pictures[0], legend)
        if painting.state != state:
            raise SceneError(f"{pictures[0].name}: the scene was changed meanwhile: drop the picture again")
        said = painting.take_painting(scene, f"picture {pictures[0].name}")
        self._context.socket.say(f"Painted: {said}.")
        self._context.refresh()

    def _greys(self) -> Meanings | None:
        """What black and white mean; None where colours mean swatches."""
        what = GREYS.get(self._means.value)
        if what is None:
            return None
        context = self._context
        swatch = context.session.scene.swatches[context.tools.ensure_swatch()]
        low, high = (bounded(field.value, 0.0, 10.0, 1.0) for field in (self._low, self._high))
        if low == high:
            raise SceneError("black and white mean the same: give two factors that differ")
        return {(0, 0, 0): scaled(swatch, {what: low}), (255, 255, 255): scaled(swatch, {what: high})}

    async def _picture(self) -> tuple[str, bytes]:
        scene, stem = self._context.session.painting.snapshot(), self._context.stem
        body = scene.body(str(self._body.value))

        def make() -> bytes:
            packed = io.BytesIO()
            with tempfile.TemporaryDirectory() as folder, zipfile.ZipFile(packed, "w") as archive:
                for file in save_picture(scene, body, Path(folder) / f"{stem}_{body.name}.png"):
                    archive.write(file, file.name)
            return packed.getvalue()

        return f"{stem}_picture.zip", await asyncio.get_running_loop().run_in_executor(None, make)
