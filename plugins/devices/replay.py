"""A recording as a device: it replays recorded positions, one a tick, and ignores forces.

At the end of the recording it stays, or replays the recording backwards.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import TICK_S
from hapscene.device.driver import Connection, Driver, Found, Option
from hapscene.errors import DeviceError, FormatError
from hapscene.motion.path_file import TICK_FREE, TICKS_PER_ROW_MAX, load_path
from hapscene.render.recording import Recording


def load(file: str) -> NDArray[np.float64]:
    """Load the positions (n, 3) [m], one row a tick, from a recording (npz) or a path (CSV).

    Raises:
        DeviceError: no file was given, or it is not a recording or path.
    """
    if not file:
        raise DeviceError("replay: option file is missing: name a recording or a path, such as --option file=touch.npz")
    try:
        if Path(file).suffix.lower() != ".npz":
            return load_path(file, TICK_S)[1]
        recording = Recording.load(file)
    except FormatError as error:
        raise DeviceError(f"replay: {error}") from None
    t_s, p_WT = recording.t_s, recording.p_WT_m
    if len(t_s) < 2 or not np.isfinite(p_WT).all() or not (np.diff(t_s) > 0.0).all():
        raise DeviceError(
            f"replay: {file}: {len(t_s)} ticks; expected two or more, with finite positions and increasing time"
        )
    last_s = float(t_s[-1] - t_s[0])
    if last_s > (TICK_FREE + TICKS_PER_ROW_MAX * len(t_s)) * TICK_S:
        raise DeviceError(f"replay: {file}: {len(t_s):,} ticks in {last_s:,.0f} s; expected ten ticks a second or more")
    grid_s = t_s[0] + TICK_S * np.arange(round(last_s / TICK_S) + 1)
    return np.column_stack([np.interp(grid_s, t_s, p_WT[:, axis]) for axis in range(3)])


class ReplayConnection(Connection):
    """A recording, replayed one row for each `read`."""

    def __init__(self, file: str = "", origin: str = "start", again: bool = False) -> None:
        super().__init__()
        self._p = load(file)
        if origin == "start":
            self._p -= self._p[0].copy()
        self._tick, self._again = 0, again
        self.state.ready = 1

    def read(self) -> None:
        last = len(self._p) - 1
        at = self._tick % (2 * last) if self._again else min(self._tick, last)
        self.state.p_DT_m = self._p[min(at, 2 * last - at)]
        self._tick += 1
        self.state.count += 1

    def write(self) -> None:
        pass

    def close(self) -> None:
        pass


DRIVER = Driver(
    name="replay",
    summary="Recorded positions, replayed; no hardware.",
    open=ReplayConnection,
    find=lambda **options: [Found("built in")],
    force=False,
    needs="a recording (touch.npz) or a path (CSV with t, x, y, z)",
    options=(
        Option("file", "", "recording (npz) or path (CSV)"),
        Option(
            "origin",
            "start",
            "origin of the device frame: start of the recording, or origin of the world",
            ("start", "world"),
        ),
        Option("again", False, "whether to repeat the recording forwards and backwards; otherwise it stays at the end"),
    ),
    simulated=True,
)
