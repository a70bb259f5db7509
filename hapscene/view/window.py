"""A touch played in a desktop window at its own speed, in a child process: `python -m hapscene.view.window`.

A window's loop belongs to the main thread of a process, and a driver that crashes ends only the child.
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
from hapscene.view.legend import entries_of
from hapscene.view.offscreen import last_line
from hapscene.view.palette import FORCE, LIGHT, Theme
from hapscene.view.triangles import Shown

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

__all__ = ["Player", "check_display", "felt", "play_in_window"]

PIECE_S: Final = 0.2
"""Length of the pieces in which the path grows [s]. Each is a draw call, and software GL is slow at draw calls."""

PAUSE_S: Final = 1.5
"""Pause at the end before the touch is played again [s]."""

_FILM: Final = "`hapscene view SCENE --touch touch.npz --out film.gif` needs no window"


def check_display() -> None:
    """Check that there is a screen to open a window on.

    Raises:
        ViewError: there is no screen.
    """
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        raise ViewError(
            "no display to open a window on (DISPLAY is not set): run it from a desktop, or by `ssh -X`, or leave "
            f"--view out; {_FILM}"
        )


def play_in_window(scene: "Scene", recording: Recording, title: str = "", *, theme: Theme = LIGHT) -> None:
    """Open a window that plays a touch; return when it is closed, or by Ctrl-C.

    Args:
        scene: what was touched.
        recording: the touch.
        title: of the window.
        theme: colours around the scene.

    Raises:
        ViewError: no window can be opened here; the message names the reason and what to do.
    """
    check_display()
    end = len(recording) - 1
    count = max(round((recording.t_s[-1] - recording.t_s[0]) / PIECE_S), 1)
    figure = make_figure_parts(scene, recording, theme, np.linspace(0, end, count + 1).round().astype(np.int64)[1:])
    entries = entries_of(scene, theme, path=True, tool=True)
    legend = [*((entry.text, entry.colour) for entry in entries), ("force", FORCE)]
    reason = _run(pickle.dumps((Player(figure, recording), legend, title, theme)))
    if reason:
        raise ViewError(
            f"no window can be opened here ({reason}); it needs an X display (DISPLAY) and the system packages libgl1 "
            f"and libx11-6; {_FILM}"
        )


def felt(recording: Recording, hand: Path) -> Recording:
    """A closed-loop touch as it went: the tool's position and the motors' force from its hand.npz."""
    with np.load(hand, allow_pickle=False) as archive:
        return replace(recording, p_WT_m=archive["p_W_m"], f_W_N=archive["f_motor_W_N"])


def _run(job: bytes) -> str:
    """Run the window's process to its end; return why it failed, or an empty text."""
    environment = {name: value for name, value in os.environ.items() if name != "PYOPENGL_PLATFORM"} | import_path()
    command = [sys.executable, "-P", "-m", "hapscene.view.window"]
    with subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdin is not None and process.stderr is not None
        try:
            with suppress(BrokenPipeError):  # it has ended already
                process.stdin.write(job)
                process.stdin.flush()  # and stays open: the window closes when this process ends
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
    """Which tick is shown now: in real time from the first frame on, again and again."""

    def __init__(self, figure: FigureParts, recording: Recording) -> None:
        self.figure, self._recording = figure, recording
        self._force_N = np.linalg.norm(figure.f_N, axis=1)
        self._t_s = recording.t_s - recording.t_s[0]
        self._start_s: float | None = None

    def now(self) -> tuple[Shown, str]:
        """The parts that are shown now, and a caption with time, force and swatch."""
        now_s = time.monotonic()
        if self._start_s is None:
            self._start_s = now_s  # the first frame, since opening the window takes time
        return self.at((now_s - self._start_s) % (float(self._t_s[-1]) + PAUSE_S))

    def at(self, t_s: float) -> tuple[Shown, str]:
        """The same at a time from the start [s]."""
        tick = max(int(np.searchsorted(self._t_s, t_s, side="right")) - 1, 0)
        swatch = int(self._recording.swatch[tick])
        where = self._recording.swatch_names[swatch] if swatch >= 0 else "in the air"
        return self.figure.shown(tick), f"{self._t_s[tick]:6.2f} s   {self._force_N[tick]:5.2f} N   {where}"


def _main() -> None:
    """Read the job, open the window: what the child process does."""
    from hapscene.view.gl import watch

    player, legend, title, theme = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    figure = player.figure
    watch(figure.parts, figure.points_m(tool=True), legend, title, theme, player.now)


def _end_with_parent() -> None:
    os.read(0, 1)  # returns when the parent process closes the pipe or ends
    os._exit(1)


if __name__ == "__main__":
    try:
        _main()
    except (EOFError, KeyboardInterrupt):  # Ctrl-C in a terminal reaches this process too
        sys.exit(0)
