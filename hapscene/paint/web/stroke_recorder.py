"""What the hand felt, kept while it is recorded, and played again."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import SceneError
from hapscene.paint.shelf import Sound, wav_bytes
from hapscene.recording import Recording
from hapscene.renderer import EFFECTS
from hapscene.scene.scene import Scene
from hapscene.servo.servo import TickLog

LONGEST_S: Final = 120.0
"""Longest that is kept [s], some 60 MB: what is felt later is left out."""


class StrokeRecorder:
    """One recording: a new one takes its place.

    Attributes:
        recording: whether what is felt is kept.
        seconds: how much is.
    """

    def __init__(self) -> None:
        self._logs: list[TickLog] = []
        self._tick_s = 0.0
        self._rows: Any = None
        self._a_m_s2: NDArray[Any] = np.zeros((0, 0))
        self._began_s: float | None = None
        self._played = 0
        self.recording = False
        self.seconds = 0.0

    def start(self, tick_s: float) -> None:
        """Keep what is felt from now on."""
        self._logs, self._rows, self._began_s = [], None, None
        self._tick_s, self.seconds, self.recording = tick_s, 0.0, True

    def note(self, felt: TickLog) -> None:
        """Ticks were felt."""
        if self.recording and len(felt.rows):
            self._logs.append(felt)
            self.seconds += len(felt.rows) * self._tick_s
            if self.seconds >= LONGEST_S:
                self.stop()

    def stop(self) -> None:
        """It is complete."""
        self.recording = False
        if self._logs:
            self._rows = np.concatenate([log.rows for log in self._logs]).view(np.recarray)
            self._a_m_s2 = np.concatenate([log.a_handle_m_s2 for log in self._logs])
        self._logs = []

    def play(self, now_s: float) -> None:
        """Play it again from its beginning.

        Raises:
            SceneError: nothing was felt.
        """
        self._check()
        self._began_s, self._played = now_s, 0

    @property
    def playing(self) -> bool:
        return self._began_s is not None

    def read(self, now_s: float) -> tuple[Any, NDArray[Any], NDArray[Any]] | None:
        """As `TouchHand.read`, of what is played: the newest row, force and acceleration since the last look."""
        if self._began_s is None:
            return None
        due = min(int((now_s - self._began_s) / self._tick_s), len(self._rows))
        part, self._played = slice(self._played, due), due
        if due >= len(self._rows):
            self._began_s = None
        return self._rows[max(due - 1, 0)], np.linalg.norm(self._rows["f_W_N"][part], axis=1), self._a_m_s2[part]

    def wav(self) -> bytes:
        """The acceleration of the handle, to be heard.

        Raises:
            SceneError: nothing was felt.
        """
        self._check()
        return wav_bytes(Sound(self._a_m_s2.ravel().astype(np.float64), self._a_m_s2.shape[1] / self._tick_s))

    def csv(self, scene: Scene) -> bytes:
        """All columns of a `Recording`.

        Raises:
            SceneError: nothing was felt.
        """
        with TemporaryDirectory() as folder:
            file = Path(folder) / "touch.csv"
            self.result(scene).save_csv(file)
            return file.read_bytes()

    def result(self, scene: Scene) -> Recording:
        """It as a recording; its times have no pauses.

        Args:
            scene: that was touched, for the names.

        Raises:
            SceneError: nothing was felt.
        """
        self._check()
        names = [[thing.name for thing in things] for things in (scene.bodies, scene.swatches)]
        for kind, known in zip(("body", "swatch"), names, strict=True):  # undone since, they have no name any more
            known += [f"{kind} {i}" for i in range(len(known), int(self._rows[kind].max()) + 1)]
        return Recording.of_rows(
            self._rows,
            self._a_m_s2.astype(np.float64),
            np.arange(len(self._rows)) * np.float64(self._tick_s),
            a_rate_Hz=self._a_m_s2.shape[1] / self._tick_s,
            body_names=tuple(names[0]),
            swatch_names=tuple(names[1]),
            seed=0,
            effects=EFFECTS,
        )

    def _check(self) -> None:
        if self.recording:
            self.stop()
        if self._rows is None:
            raise SceneError("nothing was recorded: press Record, touch the surface (7, Shift and drag), then Stop")
