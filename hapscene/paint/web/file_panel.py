"""The tab File: saving, recovery, export."""

import asyncio
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from hapscene.errors import SaveConflict, SceneError
from hapscene.paint.document import Recovery
from hapscene.paint.web.page_context import PageContext, card_html, escape_html, set_html
from hapscene.scene.scene_file import SUFFIX

AUTOSAVED: Final = "A copy is kept beside the file every second, and offered after a crash."


class FilePanel:
    """The tab of the file.

    Args:
        context: the page.
        container: the tab.
        path: where the scene is saved to, unless told otherwise.
    """

    def __init__(self, context: PageContext, container: Any, path: Path) -> None:
        self._context = context
        self._path = path
        self._look_chosen = False
        self._tuned: tuple[object, str] = None, ""
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
                self._dark.on_update(callback(lambda target: self._choose_look()))
        self._apply_theme()

    @property
    def order(self) -> float:
        """Where in the tab what has to do with files goes on: see viser's `order`."""
        return float(self._status.order)

    @property
    def dark(self) -> bool:
        """Whether the page is dark."""
        return bool(self._dark.value)

    def prefer_look(self, dark: bool) -> None:
        """Light or dark as the first who comes has it, until it is chosen."""
        if not self._look_chosen:
            self._look_chosen, self._dark.value = True, dark
            self._apply_theme()

    def _choose_look(self) -> None:
        self._look_chosen = True
        self._apply_theme()

    def _apply_theme(self) -> None:
        """Light or dark, as chosen."""
        self._context.server.gui.configure_theme(
            dark_mode=bool(self._dark.value), show_share_button=False, show_logo=False, control_width="medium"
        )

    def show(self) -> None:
        """Tell whether everything is saved, and what is safe anyway."""
        document = self._context.session.document
        text = "● Not saved yet. " if document.dirty else "✓ Everything is saved. "
        if document.changed:
            text += escape_html(document.problem or (AUTOSAVED if document.autosave else "No copy of it is kept."))
        elif tuned := self._tuned_words():
            text += f"<br>{escape_html(tuned)}"
        set_html(self._status, card_html(text))
        if self._exports and self._lost_of != (self._format.value, self._context.session.history.state):
            self._show_losses()

    def _tuned_words(self) -> str:
        """What the fidelity file beside the scene saves; looked at anew when one of the two is another."""
        from hapscene.fidelity.fidelity_file import fidelity_beside, saving_words

        session = self._context.session
        if session.path is None:
            return ""
        beside = fidelity_beside(session.path)
        stamps = [(file, file.stat().st_mtime_ns if file.is_file() else 0) for file in (session.path, beside)]
        if stamps != self._tuned[0]:
            self._tuned = stamps, saving_words(beside, session.scene)
        return self._tuned[1]

    async def save(self) -> None:
        """Save to the file that is named; ask first if that is not the one that was loaded."""
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
        """Do what `write` does, and tell what it says; ask first, then with force, where that loses somebody's file."""
        try:
            said = await asyncio.get_running_loop().run_in_executor(None, write, force)
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

    def offer_recovery(self) -> None:
        """Ask what becomes of what painters that were killed left, one after the other."""
        document = self._context.session.document
        recovery = document.recovery()
        if recovery is None:
            return

        def then_next(act: Callable[[Recovery], object]) -> Callable[[], None]:
            def done() -> None:
                act(recovery)
                self.offer_recovery()

            return done

        when = time.strftime("%Y-%m-%d %H:%M", time.localtime(recovery.saved_s))
        name = recovery.path.name.removesuffix(SUFFIX)
        self._context.ask(
            "Recover your work?",
            f"A session of {name} ended without saving. Its work up to {when} is still there.",
            ("Recover it", None, then_next(document.recover)),
            ("Ask me the next time", "gray", lambda: None),
            ("Discard it", "red", then_next(document.discard_recovery)),
        )

    def _show_path(self) -> None:
        """Have the panel's title, and where to export to, as the scene file is called."""
        path = self._context.session.path
        if path is not None and path != self._path:
            self._path = path
            self._file.value = str(path)  # where the suffix was left out
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
        """Tell what of the scene as it is now will not be in the file."""
        from hapscene.exchange import losses

        session, export = self._context.session, self._exports.get(self._format.value)
        if export is None:
            return
        with session.lock:
            self._lost_of = self._format.value, session.history.state
            lost = ", ".join(losses(session.scene, self._format.value)) or "nothing"
        set_html(self._losses, card_html(f"{escape_html(export.summary)}.<br>Will not be in it: {escape_html(lost)}."))


def _exports() -> Mapping[str, Any]:
    """What can be exported to; nothing where the room of the formats is not there."""
    try:
        from hapscene.exchange import EXPORTS
    except ImportError:
        return {}
    return EXPORTS
