"""Replay of a recorded touch in a window in real time, in a child process: `python -m hapscene.view.window`.

The event loop of a window needs the main thread of a process, and a crash of a driver does not end the main process.
"""

import os
import pickle
import subprocess
import sys
import threading
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from hapscene.errors import ViewError
from hapscene.interrupt import clear_interrupt
from hapscene.io.confined import import_path
from hapscene.render.recording import Recording
from hapscene.view.figure_parts import FigureParts, make_figure_parts
from hapscene.view.offscreen import last_line
from hapscene.view.palette import LIGHT, Theme
from hapscene.view.triangles import Shown

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

__all__ = ["Player", "check_display", "play_in_window", "with_hand"]

PIECE_S: Final = 0.2
"""Length of the path segments [s]. Each is a draw call, which is slow in software GL."""

PAUSE_S: Final = 1.5
"""Pause before the replay starts again [s]."""

_FILM: Final = "`hapscene view SCENE --touch touch.npz --out film.gif` needs no window"


def check_display() -> None:
    """Check that a display is available.

    Raises:
        ViewError: there is no display.
    """
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        raise ViewError(
            "cannot open a window: DISPLAY is not set; run this from a desktop, connect with `ssh -X`, or omit --view; "
            f"{_FILM}"
        )


def play_in_window(scene: "Scene", recording: Recording, title: str = "", *, theme: Theme = LIGHT) -> None:
    """Replay a touch in a window; return when it is closed, or on Ctrl-C.

    Args:
        scene: the scene.
        recording: the touch.
        title: title of the window.
        theme: colours of background and text.

    Raises:
        ViewError: the window cannot be opened; the message has the reason and the required packages.
    """
    check_display()
    end = len(recording) - 1
    count = max(round((recording.t_s[-1] - recording.t_s[0]) / PIECE_S), 1)
    figure = make_figure_parts(scene, recording, theme, np.linspace(0, end, count + 1).round().astype(np.int64)[1:])
    reason = _run(pickle.dumps((Player(figure, recording), title, theme)))
    if reason:
        raise ViewError(
            f"cannot open a window: {reason}; it needs an X display (DISPLAY) and the system packages libgl1 and "
            f"libx11-6; {_FILM}"
        )


def with_hand(recording: Recording, hand: Path) -> Recording:
    """Return a closed-loop recording with the device position and motor force from its hand.npz."""
    with np.load(hand, allow_pickle=False) as archive:
        return replace(recording, p_WT_m=archive["p_W_m"], f_W_N=archive["f_motor_W_N"])


def _run(job: bytes) -> str:
    """Run the child process; return its error, or an empty string."""
    environment = {name: value for name, value in os.environ.items() if name != "PYOPENGL_PLATFORM"} | import_path()
    command = [sys.executable, "-P", "-m", "hapscene.view.window"]
    with subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdin is not None and process.stderr is not None
        try:
            with suppress(BrokenPipeError):  # the process has ended
                process.stdin.write(job)
                process.stdin.flush()  # stays open: the child closes the window when the pipe closes
            complaint = process.stderr.read()
            return last_line(complaint, process.returncode) if process.wait() else ""
        except KeyboardInterrupt:
            clear_interrupt()
            return ""
        finally:
            process.kill()
            with suppress(BrokenPipeError):
                process.stdin.close()


class Player:
    """Selects the tick to show: replay in real time from the first frame on, repeated."""

    def __init__(self, figure: FigureParts, recording: Recording) -> None:
        self.figure, self._recording = figure, recording
        self._force_N = np.linalg.norm(figure.f_N, axis=1)
        self._t_s = recording.t_s - recording.t_s[0]
        self._start_s: float | None = None

    def now(self) -> tuple[Shown, str]:
        """Return the visible parts, and a caption with time, force and swatch."""
        now_s = time.monotonic()
        if self._start_s is None:
            self._start_s = now_s  # starts with the first frame, since opening the window takes time
        return self.at((now_s - self._start_s) % (float(self._t_s[-1]) + PAUSE_S))

    def at(self, t_s: float) -> tuple[Shown, str]:
        """Return the same at a time after the start [s]."""
        tick = max(int(np.searchsorted(self._t_s, t_s, side="right")) - 1, 0)
        swatch = int(self._recording.swatch[tick])
        where = self._recording.swatch_names[swatch] if swatch >= 0 else "in the air"
        return self.figure.shown(tick), f"{self._t_s[tick]:6.2f} s   {self._force_N[tick]:5.2f} N   {where}"


def _main() -> None:
    """Main function of the child process: read the job and open the window."""
    from hapscene.view.gl import watch

    player, title, theme = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    figure = player.figure
    watch(figure.parts, figure.points_m(tool=True), title, theme, player.now)


def _end_with_parent() -> None:
    os.read(0, 1)  # returns when the parent closes the pipe or ends
    os._exit(1)


if __name__ == "__main__":
    try:
        _main()
    except (EOFError, KeyboardInterrupt):  # Ctrl-C in a terminal reaches this process too
        sys.exit(0)
