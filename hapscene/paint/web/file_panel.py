"""The tab File: save, recover, export and download the scene."""

import asyncio
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Final

from hapscene.errors import SaveConflict
from hapscene.exchange.format_registry import EXPORTS, export_scene, format_of, is_mesh_of, losses
from hapscene.paint.model.document import Recovery
from hapscene.paint.web.context import Container, PageContext, card_html, escape_html, set_html
from hapscene.scene.scene_bundle import ZIP_SUFFIX, save_bundle
from hapscene.scene.scene_file import SUFFIX

__all__ = ["FilePanel"]

AUTOSAVED: Final = "Unsaved changes are backed up every second and can be recovered after a crash."


class FilePanel:
    """Controls for saving, recovery, export and download.

    Args:
        path: present scene file.
    """

    def __init__(self, context: PageContext, container: Container, path: Path) -> None:
        self._context = context
        self._path = path
        self._losses_of: object = None  # format and state of the scene for which the losses are shown
        gui, callback = context.gui, context.callback
        with container:
            self._file = gui.add_text("Scene file", str(path), hint=f"File name, which ends in {SUFFIX}")
            save = gui.add_button("Save", hint="Save to the scene file above (Ctrl S)")
            save.on_click(callback(lambda target: self.save()))
            self._status = gui.add_html("")
            with gui.add_folder("Export"):
                self._format = gui.add_dropdown("Format", tuple(EXPORTS))
                self._losses = gui.add_html("")
                self._target = gui.add_text("File", "")
                gui.add_button("Export", hint="Export to the file above").on_click(callback(self._export))
                self._format.on_update(callback(lambda target: self._show_format()))
                self._show_format()
                hint = f"Scene, meshes and swatches in one file, NAME{ZIP_SUFFIX}, for hapscene paint"
                down = gui.add_button("Download scene", hint=hint)
                down.on_click(context.downloading(self._bundle))

    def show(self) -> None:
        """Update the status of saving and autosave."""
        document = self._context.session.document
        text = "● Unsaved changes. " if document.dirty else "✓ All changes saved. "
        if document.changed:
            text += escape_html(document.problem or AUTOSAVED)
        set_html(self._status, card_html(text))
        if self._losses_of != (self._format.value, self._context.session.history.state):
            self._show_losses()

    async def save(self) -> None:
        """Save to the file in the field; ask before overwriting a file that was not loaded here."""
        session, path = self._context.session, Path(str(self._file.value).strip())
        await self._write(lambda force: f"Saved: {session.save(path, force)}")

    async def _export(self, target: object) -> None:
        file, session = Path(str(self._target.value).strip()), self._context.session

        def write(force: bool) -> str:
            scene = session.painting.snapshot()
            made = export_scene(scene, file, replace=force)
            lost = ", ".join(losses(scene, format_of(file))) or "nothing"
            return f"Exported: {', '.join(str(path) for path in made)}. Not included: {lost}"

        await self._write(write)

    async def _write(self, write: Callable[[bool], str], force: bool = False) -> None:
        """Call `write` and show its message; if it would overwrite a file, ask and call it with force."""
        self._context.say("Writing the file …")
        try:
            message = await asyncio.to_thread(write, force)
        except SaveConflict as conflict:
            self._context.ask(
                "Overwrite the file?",
                f"{conflict}.",
                ("Cancel", None, lambda: None),
                ("Overwrite", "red", lambda: self._write(write, True)),
            )
            return
        self._context.say(message)
        self._show_path()

    async def _bundle(self) -> tuple[str, bytes]:
        scene, name = self._context.session.painting.snapshot(), f"{self._path.name.removesuffix(SUFFIX)}{ZIP_SUFFIX}"

        def make() -> bytes:
            with tempfile.TemporaryDirectory() as folder:
                save_bundle(scene, Path(folder) / name)
                return (Path(folder) / name).read_bytes()

        return name, await asyncio.to_thread(make)

    def offer_recovery(self) -> None:
        """Offer to recover unsaved work of each session that ended without saving, one after the other."""
        document = self._context.session.document
        recovery = document.recovery()
        if recovery is None:
            return

        def then_next(act: Callable[[Recovery], object]) -> Callable[[], None]:
            def done() -> None:
                act(recovery)
                self.offer_recovery()

            return done

        name = recovery.path.name.removesuffix(SUFFIX)
        self._context.ask(
            "Recover unsaved work?",
            f"A session with {name} ended without saving. Changes up to {recovery.when} can be recovered.",
            ("Recover", None, then_next(document.recover)),
            ("Ask again next time", "gray", lambda: None),
            ("Discard", "red", then_next(document.discard_recovery)),
        )

    def _show_path(self) -> None:
        """Update the panel's title and the export file after the scene file was renamed."""
        path = self._context.session.path
        if path is not None and path != self._path:
            self._path, self._file.value = path, str(path)
            self._context.gui.set_panel_label(path.name)
            self._show_format()

    def _show_format(self) -> None:
        suffix = self._format.value
        if suffix not in EXPORTS:
            return
        self._show_losses()
        stem, scene = self._path.name.removesuffix(SUFFIX), self._context.session.scene
        files = (self._path.with_name(f"{stem}{more}.{suffix}") for more in ("", "_painted"))
        self._target.value = str(next((file for file in files if not is_mesh_of(scene, file)), ""))

    def _show_losses(self) -> None:
        """Show which parts of the scene the selected format cannot store."""
        session, export = self._context.session, EXPORTS.get(self._format.value)
        if export is None:
            return
        with session.lock:
            self._losses_of = self._format.value, session.history.state
            lost = ", ".join(losses(session.scene, self._format.value)) or "nothing"
        set_html(self._losses, card_html(f"{escape_html(export.summary)}.<br>Not included: {escape_html(lost)}."))
