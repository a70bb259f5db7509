"""Sharing, in the tab File: the scene down and up through the browser as one file, and the page's address."""

import asyncio
import tempfile
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Any, Final

from hapscene.errors import SceneError
from hapscene.paint.composing import numbered
from hapscene.paint.web.page_context import PageContext, card_html, escape_html, upload_html
from hapscene.scene.scene_bundle import ZIP_SUFFIX, save_bundle, unpack_bundle

ALONE: Final = (
    "This page is open to this computer alone. To share it on your network, start it with <code>--host 0.0.0.0</code>."
)
OPEN: Final = (
    "Whoever on your network opens this address may do all that you can here: paint, touch, save and export over your "
    "files, and change your library. It holds a secret, drawn anew at each start; send it to no one else."
)
ADDRESS: Final = (
    '<input readonly aria-label="Address" style="display:block;width:100%" value="{}" onfocus="this.select()">'
)


class SharePanel:
    """Its folder.

    Args:
        context: the page.
        container: the tab it is in.
        addresses: that open the page from other computers; none where it is open to this one alone.
        open_scene: shows another scene file in the place of this one.
    """

    def __init__(
        self,
        context: PageContext,
        container: Any,
        addresses: Sequence[str],
        open_scene: Callable[[Path], Awaitable[None]],
    ) -> None:
        self._context, self._open = context, open_scene
        gui = context.server.gui
        with container, gui.add_folder("Share", expand_by_default=False):
            down = gui.add_button(
                "Download scene", hint=f"All in one file, NAME{ZIP_SUFFIX}: hapscene paint opens it anywhere"
            )
            gui.add_html(
                upload_html("Upload scene …", (".zip",), f"Unpacks NAME{ZIP_SUFFIX} beside this one, and opens it")
            )
            links = "".join(ADDRESS.format(escape_html(url)) for url in addresses)
            gui.add_html(card_html(f"{OPEN}{links}" if addresses else ALONE))
        down.on_click(context.downloading(self._bundle))

    async def _bundle(self) -> tuple[str, bytes]:
        scene, name = self._context.session.painting.snapshot(), f"{self._context.stem}{ZIP_SUFFIX}"

        def make() -> bytes:
            with tempfile.TemporaryDirectory() as folder:
                file = Path(folder) / name
                save_bundle(scene, file)
                return file.read_bytes()

        return name, await asyncio.get_running_loop().run_in_executor(None, make)

    async def take(self, files: Sequence[Path]) -> None:
        """Unpack a scene that was dropped on the page, or chosen, beside this one, and open it.

        Raises:
            HapsceneError: it is none, or cannot be opened.
        """
        file, path = files[0], self._context.session.path
        assert path is not None  # of a page's session
        if len(files) > 1 or not file.name.endswith(ZIP_SUFFIX):
            raise SceneError(
                f"{file.name}: not a scene in one file, NAME{ZIP_SUFFIX}; unpack it, and drop what it holds"
            )
        taken = [other.name for other in path.parent.iterdir()]
        folder = path.parent / numbered(file.name.removesuffix(ZIP_SUFFIX), taken)
        try:
            scene = await asyncio.get_running_loop().run_in_executor(None, unpack_bundle, file, folder)
        except SceneError as error:
            raise SceneError(str(error).replace(str(file), file.name)) from None
        await self._open(scene)
