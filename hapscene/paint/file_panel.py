"""Saving, export and looks, in the panel; and the questions that are asked before something is lost."""

import asyncio
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from hapscene.errors import SceneError
from hapscene.paint.parts import Parts, safe
from hapscene.paint.save import SaveConflict

SUFFIX = ".scene.json"

KEYS = (
    ("1 … 7", "brush, fill, box, sphere, eraser, pick, touch"),
    ("Shift + drag", "use the tool (L: without Shift)"),
    ("[  ]", "smaller, larger brush"),
    ("Ctrl Z, Ctrl Y", "undo, redo"),
    ("Ctrl S", "save"),
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

    def __init__(self, parts: Parts, container: Any, path: Path) -> None:
        self._parts = parts
        self._path = path
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
                self._dark.on_update(on(lambda target: self.theme()))
            rows = "".join(f"<tr><td><kbd>{safe(k)}</kbd></td><td>{safe(v)}</td></tr>" for k, v in KEYS)
            with gui.add_folder("Keys"):
                gui.add_html(f'<table class="hs-table">{rows}</table>')
        self.theme()

    def theme(self) -> None:
        """Light or dark, as chosen."""
        self._parts.server.gui.configure_theme(
            dark_mode=bool(self._dark.value), show_share_button=False, show_logo=False, control_width="medium"
        )

    def show(self, autosaved: str) -> None:
        """Tell whether everything is saved, and what is safe anyway."""
        dirty = self._parts.session.dirty
        word = "● Not saved yet." if dirty else "✓ Everything is saved."
        content = f'<div class="hs-card">{word} {safe(autosaved) if dirty else ""}</div>'
        if self._status.content != content:
            self._status.content = content

    async def save(self, force: bool = False) -> None:
        """Save to the file that is named; ask first if that is not the one that was loaded."""
        session = self._parts.session
        path = Path(str(self._file.value).strip())
        if not path.name.endswith(SUFFIX):
            raise SceneError(f"a scene's file name ends in {SUFFIX}")
        same = session.path is not None and path.resolve() == session.path.resolve()
        try:
            saved = await _apart(lambda: session.save(None if same else path, force=force))
        except SaveConflict as conflict:
            self._ask(str(conflict))
            return
        self._parts.live.say(f"Saved: {saved}")

    def _ask(self, problem: str) -> None:
        gui, on = self._parts.server.gui, self._parts.on
        modal = gui.add_modal("Save over it?")

        async def over(target: Any) -> None:
            modal.close()
            await self.save(force=True)

        with modal:
            gui.add_html(f'<div class="hs-card">{safe(problem)}.</div>')
            gui.add_button("Save over it", color="red").on_click(on(over))
            gui.add_button("Do not save; I will give another name").on_click(on(lambda target: modal.close()))

    def offer(self, told: str, take: Callable[[], None], leave: Callable[[], None]) -> None:
        """Ask whether what was found of an interrupted session shall be taken up again."""
        gui, on = self._parts.server.gui, self._parts.on
        modal = gui.add_modal("Recover your work?")

        def answer(act: Callable[[], None]) -> Callable[[Any], Any]:
            def done(target: Any) -> None:
                modal.close()
                act()

            return on(done)

        with modal:
            gui.add_html(f'<div class="hs-card">{safe(told)}</div>')
            gui.add_button("Recover it").on_click(answer(take))
            gui.add_button("Leave it", color="gray").on_click(answer(leave))

    def _tell_format(self) -> None:
        export = self._exports.get(self._format.value)
        if export is None:
            return
        losses = ", ".join(export.loses) or "nothing"
        self._told.content = f'<div class="hs-card">{safe(export.summary)}.<br>Loses: {safe(losses)}.</div>'
        stem = self._path.name.removesuffix(SUFFIX)
        self._target.value = str(self._path.parent / (stem + export.suffix))

    async def _export(self, target: Any) -> None:
        from hapscene.exchange import export_scene

        if self._format.value not in self._exports:
            raise SceneError("no such format")
        name, file = self._format.value, Path(str(self._target.value).strip())
        still = self._parts.session.snapshot()
        made = await _apart(lambda: export_scene(still, file, name))
        self._parts.live.say("Exported: " + ", ".join(str(path) for path in made))


def _exports() -> Mapping[str, Any]:
    """What can be exported to; nothing where the room of the formats is not there."""
    try:
        from hapscene.exchange import EXPORTS
    except ImportError:
        return {}
    return EXPORTS


async def _apart(work: Callable[[], Any]) -> Any:
    """Do something slow beside the event loop."""
    return await asyncio.get_running_loop().run_in_executor(None, work)
