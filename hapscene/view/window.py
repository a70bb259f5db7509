"""A touch played in a desktop window, at its own speed, by a process of its own: `python -m hapscene.view.window DIR`.

Its own, since a window's loop belongs to the process's main thread, and a driver that crashes takes only it along.
"""

import json
import os
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import ViewError
from hapscene.interrupt import heard
from hapscene.render.recording import Recording
from hapscene.view.camera import looks, pose_of
from hapscene.view.figure_parts import FigureParts, make_figure_parts
from hapscene.view.legend import entries_of
from hapscene.view.offscreen import go_with_the_other, job_folder, start_drawer
from hapscene.view.palette import FORCE, LIGHT, Theme
from hapscene.view.triangles import Shown

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

PIECE_S: Final = 0.2
"""Length of the pieces in which the path grows [s]. Each is drawn by a call, which is what software GL is slow at."""

PAUSE_S: Final = 1.5
"""How long the end stays before the touch is played again [s]."""

VIEW_RAD: Final = np.radians(30.0)
"""Height of the camera's view [rad]: little distortion, and still depth."""

SIZE: Final = (1000, 750)
"""Of the window [pixels]."""

_FILM: Final = "`hapscene view SCENE --touch touch.npz --out film.gif` needs none"


def check_display() -> None:
    """See that there is a screen to open a window on.

    Raises:
        ViewError: there is none; the line says what to do.
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
        ViewError: no window can be opened here; one line says why and what to do.
    """
    check_display()
    end = len(recording) - 1
    count = max(round((recording.t_s[-1] - recording.t_s[0]) / PIECE_S), 1)
    stage = make_figure_parts(scene, recording, theme, np.linspace(0, end, count + 1).round().astype(np.int64)[1:])
    legend = [*((e.text, e.colour) for e in entries_of(scene, theme, path=True, tool=True)), ("force", FORCE)]
    words = {"title": title, "legend": legend, "background": theme.background, "ink": theme.ink}
    with job_folder() as folder:
        stage.save(folder / "stage.npz")
        recording.save(folder / "touch.npz")
        (folder / "words.json").write_text(json.dumps(words), encoding="utf-8")
        reason = _run(folder)
    if reason:
        raise ViewError(
            f"no window can be opened here ({reason}); it needs an X display (DISPLAY) and the system packages libgl1 "
            f"and libx11-6; {_FILM}"
        )


def felt(recording: Recording, hand: Path) -> Recording:
    """A touch in closed loop as it truly went: the tool's place and the motors' force from its hand.npz."""
    with np.load(hand, allow_pickle=False) as archive:
        return replace(recording, p_WT_m=archive["p_W_m"], f_W_N=archive["f_motor_W_N"])


def _run(folder: Path) -> str:
    """Run the window's process to its end; return why it failed, or nothing."""
    environment = {name: value for name, value in os.environ.items() if name != "PYOPENGL_PLATFORM"}
    with start_drawer("hapscene.view.window", folder, environment) as window:
        try:
            return window.reason() if window.process.wait() else ""
        except KeyboardInterrupt:
            heard()
            return ""


class Player:
    """Which tick is shown now: in real time from the first frame on, over and over."""

    def __init__(self, stage: FigureParts, recording: Recording) -> None:
        self._stage, self._recording = stage, recording
        self._force_N = np.linalg.norm(stage.f_N, axis=1)
        self._t_s = recording.t_s - recording.t_s[0]
        self._start_s: float | None = None

    def now(self) -> tuple[Shown, str]:
        """What is seen now, and the line that says it in numbers."""
        now_s = time.monotonic()
        if self._start_s is None:
            self._start_s = now_s  # opening the window took its time
        return self.at((now_s - self._start_s) % (float(self._t_s[-1]) + PAUSE_S))

    def at(self, t_s: float) -> tuple[Shown, str]:
        """The same at a time from the start [s]."""
        tick = max(int(np.searchsorted(self._t_s, t_s, side="right")) - 1, 0)
        swatch = int(self._recording.swatch[tick])
        where = self._recording.swatch_names[swatch] if swatch >= 0 else "in the air"
        return self._stage.shown(tick), f"{self._t_s[tick]:6.2f} s   {self._force_N[tick]:5.2f} N   {where}"


def _view_of(stage: FigureParts) -> tuple[NDArray[np.float64], float, float]:
    """A camera that sees all of the stage: its pose, height of view [rad] and range [m]."""
    points_m = stage.points_m(tool=True)
    radius_m = float(np.linalg.norm(points_m, axis=1).max())
    distance_m = 0.85 * radius_m / np.sin(VIEW_RAD / 2)
    (R_SC,) = looks([0.0])
    return pose_of(R_SC, R_SC[:, 2] * distance_m), VIEW_RAD, 10.0 * distance_m


def _main(folder: Path) -> None:
    """What the process does."""
    from hapscene.view.gl import watch

    stage, recording = FigureParts.load(folder / "stage.npz"), Recording.load(folder / "touch.npz")
    words = json.loads((folder / "words.json").read_text(encoding="utf-8"))
    watch(stage.parts, _view_of(stage), **words, size=SIZE, now=Player(stage, recording).now)


if __name__ == "__main__":
    directory = Path(sys.argv[1])
    go_with_the_other(directory)
    try:
        _main(directory)
    except KeyboardInterrupt:  # at a terminal it comes here as well
        sys.exit(0)
