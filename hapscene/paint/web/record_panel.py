"""What the hand felt, in the tab Feel: recorded, played again, and taken away as WAV or CSV."""

import asyncio
import time
from collections.abc import Callable
from functools import partial
from typing import Any, Final

from hapscene.errors import SceneError
from hapscene.paint.web.page_context import PageContext, card_html, set_html
from hapscene.paint.web.stroke_recorder import LONGEST_S, StrokeRecorder

LABELS: Final = ("Record", "Stop recording")


class RecordPanel:
    """Its buttons.

    Args:
        context: the page.
        container: the tab they are in.
        recorder: of what is felt.
    """

    def __init__(self, context: PageContext, container: Any, recorder: StrokeRecorder) -> None:
        self._context, self._recorder = context, recorder
        gui = context.server.gui
        with container, gui.add_folder("Recording", expand_by_default=False):
            self._record = gui.add_button(LABELS[0], hint="Keeps what the hand feels, up to two minutes of it")
            play = gui.add_button("Play again", hint="The marker moves as the hand did, and it sounds as it did")
            wav = gui.add_button("Download WAV", hint="The acceleration of the handle, to be heard")
            csv = gui.add_button("Download CSV", hint="Place, force, depth, slip, acceleration …: a row for each tick")
            self._told = gui.add_html("")
        self._record.on_click(context.callback(self._toggle))
        play.on_click(context.callback(lambda target: recorder.play(time.monotonic())))
        wav.on_click(context.downloading(partial(self._made, "wav", lambda scene: recorder.wav())))
        csv.on_click(context.downloading(partial(self._made, "csv", recorder.csv)))
        self.show()

    def show(self) -> None:
        """Tell how much there is."""
        recorder = self._recorder
        label = LABELS[recorder.recording]
        if self._record.label != label:
            self._record.label = label
        told = f"{recorder.seconds:.1f} s of touch" if recorder.seconds else "nothing yet"
        if recorder.seconds >= LONGEST_S:
            told += ", which is the most"
        set_html(self._told, card_html(f"{'Recording: ' if recorder.recording else 'Recorded: '}{told}.", dim=True))

    def _toggle(self, target: Any) -> None:
        recorder = self._recorder
        if recorder.recording:
            recorder.stop()
        elif self._context.touch.status != "ready":
            raise SceneError("there is no hand that could feel anything yet")
        else:
            recorder.start(self._context.touch.tick_s)
            self._context.socket.say("Recording: touch the surface (7, then Shift and drag).")

    async def _made(self, suffix: str, make: Callable[[Any], bytes]) -> tuple[str, bytes]:
        scene = self._context.session.painting.snapshot()
        content = await asyncio.get_running_loop().run_in_executor(None, make, scene)
        return f"{self._context.stem}_touch.{suffix}", content
