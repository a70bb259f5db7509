"""Saving, export and looks, in the panel; and the questions that are asked before something is lost."""

import asyncio
import inspect
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from hapscene.errors import SaveConflict, SceneError
from hapscene.paint.web.page_context import PageContext, escape_html, set_html

SUFFIX = ".scene.json"

KEYS = (
    ("1 … 7", "brush, fill, box, sphere, eraser, pick, touch"),
    ("Shift + drag", "use the tool (L: the other way round)"),
    ("[  ]", "smaller, larger brush"),
    ("Ctrl Z, Ctrl Y", "undo, redo"),
    ("Ctrl S", "save"),
    ("Enter, Esc", "a typed number counts, or not"),
    ("drag, wheel", "turn the view, zoom"),
    ("right drag", "move the view"),
    ("W A S D Q E", "walk through the scene"),
    ("H", "show the hint"),
)


class FilePanel:
    """The tab of the file.

    Args:
        parts: the page.
        container: the tab.
        path: where the scene is saved to, unless told otherwise.
    """

    def __init__(self, parts: PageContext, container: Any, path: Path) -> None:
        self._parts = parts
        self._path = path
        self._looked = False
        gui, on = parts.server.gui, parts.on
        with container:
            self._file = gui.add_text("Scene file", str(path), hint=f"Ends in {SUFFIX}")
            gui.add_button("Save", hint="Ctrl S").on_click(on(lambda target: self.save()))
            self._status = gui.add_html("")
            self._exports = _exports()
            if self._exports:
                with gui.add_folder("Export"):
                    self._format = gui.add_dropdown("Format", tuple(self._exports))
                    self._told = gui.add_html("")
                    self._target = gui.add_text("File", "")
                    gui.add_button("Export").on_click(on(self._export))
                    self._format.on_update(on(lambda target: self._tell_format()))
                    self._tell_format()
            with gui.add_folder("Looks"):
                self._dark = gui.add_checkbox("Dark", False)
                self._dark.on_update(on(lambda target: self.choose_look()))
            rows = "".join(f"<tr><td><kbd>{escape_html(k)}</kbd></td><td>{escape_html(v)}</td></tr>" for k, v in KEYS)
            with gui.add_folder("Keys"):
                gui.add_html(f'<table class="hs-table">{rows}</table>')
        self.theme()

    def prefer(self, dark: bool) -> None:
        """Light or dark as the first who comes has it, until it is chosen."""
        if not self._looked:
            self._looked, self._dark.value = True, dark
            self.theme()

    def choose_look(self) -> None:
        self._looked = True
        self.theme()

    def theme(self) -> None:
        """Light or dark, as chosen."""
        self._parts.server.gui.configure_theme(
            dark_mode=bool(self._dark.value), show_share_button=False, show_logo=False, control_width="medium"
        )

    def show(self, autosaved: str) -> None:
        """Tell whether everything is saved, and what is safe anyway."""
        session = self._parts.session
        word = "● Not saved yet." if session.dirty else "✓ Everything is saved."
        set_html(self._status, f'<div class="hs-card">{word} {escape_html(autosaved) if session.changed else ""}</div>')

    async def save(self) -> None:
        """Save to the file that is named; ask first if that is not the one that was loaded."""
        session, path = self._parts.session, Path(str(self._file.value).strip())
        await self._write(lambda force: f"Saved: {session.save(path, force)}")

    async def _export(self, target: Any) -> None:
        from hapscene.exchange import export_scene

        if self._format.value not in self._exports:
            raise SceneError("no such format")
        name, file = self._format.value, Path(str(self._target.value).strip())
        session = self._parts.session

        def write(force: bool) -> str:
            made = export_scene(session.snapshot(), file, name, replace=force)
            return "Exported: " + ", ".join(str(path) for path in made)

        await self._write(write)

    async def _write(self, write: Callable[[bool], str], force: bool = False) -> None:
        """Do what `write` does, and tell what it says; ask first, then with force, where that loses somebody's file."""
        try:
            said = await asyncio.get_running_loop().run_in_executor(None, write, force)
        except SaveConflict as conflict:
            self._ask(
                "Save over it?",
                f"{conflict}.",
                ("Do not save; I will give another name", None, lambda: None),
                ("Save over it", "red", lambda: self._write(write, True)),
            )
            return
        self._parts.live.say(said)
        self._tell_path()

    def offer(self, told: str, take: Callable[[], None], discard: Callable[[], None]) -> None:
        """Ask whether what was found of an interrupted session shall be taken up again."""
        self._ask(
            "Recover your work?",
            told,
            ("Recover it", None, take),
            ("Ask me the next time", "gray", lambda: None),
            ("Discard it", "red", discard),
        )

    def _ask(self, title: str, told: str, *choices: tuple[str, str | None, Callable[[], Any]]) -> None:
        """Ask a question; each answer with its colour and what it does. It stands until one of them succeeded.

        Enter gives the first: one that loses nothing.
        """
        gui, on = self._parts.server.gui, self._parts.on
        modal = gui.add_modal(title)

        def answer(act: Callable[[], Any]) -> Callable[[Any], Any]:
            async def done(target: Any) -> None:
                result = act()
                if inspect.isawaitable(result):
                    await result
                if not modal.closed:
                    modal.close()

            return on(done)

        with modal:
            gui.add_html(f'<div class="hs-card">{escape_html(told)}</div>')
            for label, colour, act in choices:
                gui.add_button(label, color=colour).on_click(answer(act))

    def _tell_path(self) -> None:
        """Have the panel's title, and where to export to, as the scene file is called."""
        path = self._parts.session.path
        if path is not None and path != self._path:
            self._path = path
            self._parts.server.gui.set_panel_label(path.name)
            if self._exports:
                self._tell_format()

    def _tell_format(self) -> None:
        from hapscene.exchange import is_mesh_of

        export = self._exports.get(self._format.value)
        if export is None:
            return
        losses = ", ".join(export.loses) or "nothing"
        self._told.content = (
            f'<div class="hs-card">{escape_html(export.summary)}.<br>Loses: {escape_html(losses)}.</div>'
        )
        stem, scene = self._path.name.removesuffix(SUFFIX), self._parts.session.scene
        files = (self._path.with_name(f"{stem}{more}{export.suffix}") for more in ("", "_painted"))
        self._target.value = str(next((file for file in files if not is_mesh_of(scene, file)), ""))


def _exports() -> Mapping[str, Any]:
    """What can be exported to; nothing where the room of the formats is not there."""
    try:
        from hapscene.exchange import EXPORTS
    except ImportError:
        return {}
    return EXPORTS
