"""What was done, step by step: a click goes there."""

from functools import partial
from typing import Any, Final

from hapscene.paint.web.page_context import PageContext

ROWS: Final = 8
"""How many steps are seen [count]."""

NAME_MAX: Final = 40


class HistoryPanel:
    """The last steps, the newest first; those that were undone above them.

    Args:
        context: the page.
    """

    def __init__(self, context: PageContext) -> None:
        self._context = context
        gui = context.server.gui
        with gui.add_folder("History", expand_by_default=False):
            self._rows = [
                gui.add_button("…", color="gray", hint="Go there: undo or redo all between") for _ in range(ROWS)
            ]
        for row, button in enumerate(self._rows):
            button.on_click(context.callback(partial(self._go, row)))
        self.show()

    def show(self) -> None:
        """As it is."""
        steps = self._steps()
        for button, step in zip(self._rows, [*steps, *[None] * (ROWS - len(steps))], strict=True):
            visible, label = step is not None, "" if step is None else step[0]
            if button.visible != visible:
                button.visible = visible
            if visible and button.label != label:
                button.label = label

    def _steps(self) -> list[tuple[str, int]]:
        """What each row says, and how many steps to go there: to redo, or below 0, to undo."""
        history = self._context.session.history
        undone = [(f"↷ {step.what}", i + 1) for i, step in enumerate(reversed(history.undone))]
        done = [(step.what, -i) for i, step in enumerate(reversed(history.done))]
        if len(done) < ROWS:
            done.append(("As it was at first", -len(history.done)))
        rows = [*reversed(undone[: ROWS // 2]), *(("● " + what if i == 0 else what, i) for what, i in done)][:ROWS]
        return [(what if len(what) <= NAME_MAX else what[: NAME_MAX - 1] + "…", i) for what, i in rows]

    def _go(self, row: int, target: Any) -> None:
        steps = self._steps()
        if row >= len(steps):
            return
        self._context.tools.finish()
        count = steps[row][1]
        for _ in range(abs(count)):
            (self._context.session.redo if count > 0 else self._context.session.undo)()
