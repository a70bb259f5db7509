"""In the tab File: another scene on the same page, a new one, one painted lately; and what is there already."""

import asyncio
import time
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Any, Final

from hapscene.errors import SceneError
from hapscene.paint.composing import numbered
from hapscene.paint.document import autosave_folder, find_recovery
from hapscene.paint.recent import recent_scenes
from hapscene.paint.session import Session
from hapscene.paint.web.body_panel import shape_scene
from hapscene.paint.web.page_context import PageContext
from hapscene.scene.scene_file import SUFFIX

NONE: Final = "…"
"""What is chosen before a recent scene is."""

EARLIER_MAX: Final = 3
"""Most scenes that are offered to go on with [count]: the last ones."""

OpenSession = Callable[[Session, bool], Awaitable[None]]
"""Has a page show another session, and recover first what a killed painter of it left."""


class ScenePanel:
    """Opens another scene in the place of this one.

    Args:
        context: the page.
        container: the tab.
        show: has the page show another session.
        order: where in the tab, see viser's `order`.
    """

    def __init__(self, context: PageContext, container: Any, show: OpenSession, order: float) -> None:
        self._context, self._show = context, show
        gui, callback = context.server.gui, context.callback
        with container, gui.add_folder("Open another scene", expand_by_default=False, order=order):
            self._recent = gui.add_dropdown("Recent", (NONE,), hint="Scenes that you painted before")
            self._file = gui.add_text("Other file", "", hint=f"A scene file, ends in {SUFFIX}")
            gui.add_button("Open", hint="What is not saved here is kept, and offered again").on_click(
                callback(lambda target: self.open(self._wanted()))
            )
            gui.add_button("New scene", hint="With a plate; then add your own meshes").on_click(
                callback(lambda target: self.new())
            )
        self.offer_recent()

    def offer_recent(self) -> None:
        """Have the list as it is by now."""
        here = self._context.session.path
        paths = [str(path) for path in recent_scenes() if here is None or path != here.resolve()]
        self._recent.options = (NONE, *paths)

    def _wanted(self) -> Path:
        typed, chosen = str(self._file.value).strip(), str(self._recent.value)
        if not typed and chosen == NONE:
            raise SceneError("which scene? choose a recent one, or name its file")
        path = Path(typed or chosen)
        return path if path.suffix else path.with_name(path.name + SUFFIX)

    async def open(self, path: Path, *, recover: bool = False) -> None:
        """Open a scene file here; with `recover`, with what a killed painter of it left.

        Raises:
            HapsceneError: it cannot be loaded, or another painter has it open.
        """
        session = await asyncio.get_running_loop().run_in_executor(None, Session.open, path)
        await self._show(session, recover)

    async def new(self) -> None:
        """A new scene with a plate, in the folder of this one."""
        folder = (self._context.session.path or Path()).parent
        taken = [file.name.removesuffix(SUFFIX) for file in folder.glob(f"*{SUFFIX}")]
        taken += [file.name[1:].removesuffix(".autosave") for file in folder.glob(".*.autosave")]
        await self._show(Session(shape_scene("plate"), folder / f"{numbered('untitled', taken)}{SUFFIX}"), False)

    def offer_earlier(self, paths: Sequence[Path]) -> None:
        """Ask whether to go on with what was painted of the same mesh before, or to begin anew."""
        told, choices = [], []
        for path in sorted(paths, key=lambda path: -path.stat().st_mtime)[:EARLIER_MAX]:
            told.append(earlier_words(path))
            if find_recovery(path) is not None:
                choices.append((f"Recover the copy of {path.name}", None, self._opener(path, True)))
            choices.append((f"Go on with {path.name}", None, self._opener(path, False)))
        if choices:
            here = self._context.session.path
            anew = (f"Begin anew, as {here.name if here else 'another scene'}", "gray", lambda: None)
            self._context.ask("It was painted before", " ".join(told), *choices, anew)

    def _opener(self, path: Path, recover: bool) -> Callable[[], Awaitable[None]]:
        return lambda: self.open(path, recover=recover)


def earlier_words(path: Path) -> str:
    """What is there of a scene that was painted before, in a sentence."""
    told = f"{path} was saved at {_when(path.stat().st_mtime)}"
    left = find_recovery(path)
    if left is not None:
        told += f"; a session of it ended without saving, and its work up to {_when(left.saved_s)} is still there"
    elif autosave_folder(path).exists():
        told += ", and is open in another painter"
    return f"{told}."


def _when(time_s: float) -> str:
    return time.strftime("%Y-%m-%d %H:%M", time.localtime(time_s))
