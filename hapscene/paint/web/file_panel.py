"""The tab File: save, recover, export and share the scene."""

import asyncio
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from hapscene.errors import SaveConflict, SceneError
from hapscene.paint.model.document import Recovery
from hapscene.paint.web.context import PageContext, card_html, escape_html, set_html
from hapscene.scene.scene_bundle import ZIP_SUFFIX, save_bundle
from hapscene.scene.scene_file import SUFFIX

__all__ = ["FilePanel"]

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

AUTOSAVED: Final = "A copy is kept beside the file every second, and offered after a crash."


class FilePanel:
    """Saving, recovery, export, and the looks of the page.

    Args:
        context: the page.
        container: the tab.
        path: where the scene is saved unless the user gives another file.
        addresses: addresses that open the page from other computers; none where it is open to this one alone.
    """

    def __init__(self, context: PageContext, container: Any, path: Path, addresses: Sequence[str]) -> None:
        self._context = context
        self._path = path
        self._look_chosen = False
        self._lost_of: object = None
        gui, callback = context.server.gui, context.callback
        with container:
            self._file = gui.add_text("Scene file", str(path), hint=f"Ends in {SUFFIX}")
            save = gui.add_button("Save", hint="Into the scene file that is named above; key Ctrl S")
            save.on_click(callback(lambda target: self.save()))
            self._status = gui.add_html("")
            self._exports = _exports()
            if self._exports:
                with gui.add_folder("Export"):
                    self._format = gui.add_dropdown("Format", tuple(self._exports))
                    self._losses = gui.add_html("")
                    self._target = gui.add_text("File", "")
                    gui.add_button("Export", hint="Into the file that is named above").on_click(callback(self._export))
                    self._format.on_update(callback(lambda target: self._show_format()))
                    self._show_format()
            with gui.add_folder("Looks"):
                self._dark = gui.add_checkbox("Dark", False)
                self._dark.on_update(callback(lambda target: self.prefer_look(self.dark, chosen=True)))
            with gui.add_folder("Share", expand_by_default=False):
                hint = f"All in one file, NAME{ZIP_SUFFIX}: hapscene paint opens it anywhere"
                down = gui.add_button("Download scene", hint=hint)
                down.on_click(context.downloading(self._bundle))
                links = "".join(ADDRESS.format(escape_html(url)) for url in addresses)
                gui.add_html(card_html(f"{OPEN}{links}" if addresses else ALONE))
        self._apply_theme()

    @property
    def dark(self) -> bool:
        """Whether the page is dark."""
        return bool(self._dark.value)

    def prefer_look(self, dark: bool, chosen: bool = False) -> None:
        """Set light or dark: the preference of the first browser holds until the user chooses."""
        if chosen or not self._look_chosen:
            self._look_chosen, self._dark.value = True, dark
            self._apply_theme()

    def _apply_theme(self) -> None:
        self._context.server.gui.configure_theme(
            dark_mode=self.dark, show_share_button=False, show_logo=False, control_width="medium"
        )

    def show(self) -> None:
        """Show whether everything is saved, and whether the autosave works."""
        document = self._context.session.document
        text = "● Not saved yet. " if document.dirty else "✓ Everything is saved. "
        if document.changed:
            text += escape_html(document.problem or (AUTOSAVED if document.autosave else "No copy of it is kept."))
        set_html(self._status, card_html(text))
        if self._exports and self._lost_of != (self._format.value, self._context.session.history.state):
            self._show_losses()

    async def save(self) -> None:
        """Save to the file in the field; ask first if that is not the one that was loaded."""
        session, path = self._context.session, Path(str(self._file.value).strip())
        await self._write(lambda force: f"Saved: {session.save(path, force)}")

    async def _export(self, target: Any) -> None:
        from hapscene.exchange import export_scene, losses

        if self._format.value not in self._exports:
            raise SceneError("no such format")
        name, file = self._format.value, Path(str(self._target.value).strip())
        session = self._context.session

        def write(force: bool) -> str:
            scene = session.painting.snapshot()
            made = export_scene(scene, file, name, replace=force)
            lost = ", ".join(losses(scene, name)) or "nothing"
            return f"Exported: {', '.join(str(path) for path in made)}. Not in it: {lost}"

        await self._write(write)

    async def _write(self, write: Callable[[bool], str], force: bool = False) -> None:
        """Call `write` and show its message; ask, then call it with force, where that would overwrite a file."""
        try:
            said = await asyncio.to_thread(write, force)
        except SaveConflict as conflict:
            self._context.ask(
                "Save over it?",
                f"{conflict}.",
                ("Do not save; I will give another name", None, lambda: None),
                ("Save over it", "red", lambda: self._write(write, True)),
            )
            return
        self._context.socket.say(said)
        self._show_path()

    async def _bundle(self) -> tuple[str, bytes]:
        scene, name = self._context.session.painting.snapshot(), f"{self._path.name.removesuffix(SUFFIX)}{ZIP_SUFFIX}"

        def make() -> bytes:
            with tempfile.TemporaryDirectory() as folder:
                save_bundle(scene, Path(folder) / name)
                return (Path(folder) / name).read_bytes()

        return name, await asyncio.to_thread(make)

    def offer_recovery(self) -> None:
        """Ask about the work of each session that ended without saving, one after the other."""
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
            "Recover your work?",
            f"A session of {name} ended without saving. Its work up to {recovery.when} is still there.",
            ("Recover it", None, then_next(document.recover)),
            ("Ask me the next time", "gray", lambda: None),
            ("Discard it", "red", then_next(document.discard_recovery)),
        )

    def _show_path(self) -> None:
        """Update the panel's title and the export file after the scene file was renamed."""
        path = self._context.session.path
        if path is not None and path != self._path:
            self._path, self._file.value = path, str(path)
            self._context.server.gui.set_panel_label(path.name)
            if self._exports:
                self._show_format()

    def _show_format(self) -> None:
        from hapscene.exchange import is_mesh_of

        export = self._exports.get(self._format.value)
        if export is None:
            return
        self._show_losses()
        stem, scene = self._path.name.removesuffix(SUFFIX), self._context.session.scene
        files = (self._path.with_name(f"{stem}{more}{export.suffix}") for more in ("", "_painted"))
        self._target.value = str(next((file for file in files if not is_mesh_of(scene, file)), ""))

    def _show_losses(self) -> None:
        """Show what of the scene the chosen format will not hold."""
        from hapscene.exchange import losses

        session, export = self._context.session, self._exports.get(self._format.value)
        if export is None:
            return
        with session.lock:
            self._lost_of = self._format.value, session.history.state
            lost = ", ".join(losses(session.scene, self._format.value)) or "nothing"
        set_html(self._losses, card_html(f"{escape_html(export.summary)}.<br>Will not be in it: {escape_html(lost)}."))


def _exports() -> Mapping[str, Any]:
    """Export formats by name; none where the package of the formats is missing."""
    try:
        from hapscene.exchange import EXPORTS
    except ImportError:
        return {}
    return EXPORTS
