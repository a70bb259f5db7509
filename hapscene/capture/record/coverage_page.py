"""The coverage of a recording that is being made, and the page that shows it, in a process of their own.

A recorder that shares its interpreter with the page loses samples: a third of 10 kHz on a busy computer, where one
alone loses some per cent. The page receives the state every `BEAT_S`; it can send one word, "stop".
"""

import math
import multiprocessing
import queue
import signal
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from importlib import resources
from itertools import pairwise
from threading import Event
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

from hapscene.capture.io.formats import AXES
from hapscene.capture.io.streams import Array
from hapscene.capture.record.coverage import Coverage, Wanted
from hapscene.errors import CaptureError, HapsceneError
from hapscene.web.server import PageConnection, WebServer
from hapscene.wire.protocol import Count, Header, Run
from hapscene.wire.unit import UNITS

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from multiprocessing.queues import Queue

__all__ = ["BEAT_S", "CoveragePage", "CoverageProcess", "LiveCoverage", "blocks_of", "table"]

BEAT_S: Final = 0.045
"""Time between two states of the page [s]: about 20 a second."""

WAITING_MAX: Final = 4096
"""Most blocks that wait for the page's process [count]: some 20 s. Further ones are left out of the page."""

PATIENCE_S: Final = 60.0
"""How long the page's process may take to start, and to end [s]."""

LATELY_S: Final = 1.5
"""How long the page warns of clipped or lost samples [s]."""

MESSAGE_MAX: Final = 64
"""Longest message of a page [bytes]."""


class LiveCoverage:
    """Coverage of a probe's recording, and the state that pages show.

    Attributes:
        coverage: None until the recording began.
        ended: why it ended; empty while it goes on.
        skipped: blocks that were left out [count].
    """

    def __init__(self, wanted: Wanted) -> None:
        self.wanted = wanted
        self.coverage: Coverage | None = None
        self.ended, self.skipped = "", 0
        self._advice = "waiting for the probe …"
        self._lost = {"torn": 0, "garbage": 0}
        self._scales: dict[str, list[tuple[int, float]]] = {}

    def begin(self, header: Header) -> None:
        """Columns of axes, as acceleration_x, are one quantity; columns that a fit does not use are ignored."""
        for i, column in enumerate(header.columns):
            quantity, _, axis = column.name.rpartition("_")
            name = quantity if axis in AXES else column.name
            if column.unit in UNITS.get(name, {}):
                self._scales.setdefault(name, []).append((i, column.scale * UNITS[name][column.unit]))
        try:
            self.coverage = Coverage(header.rate_Hz, tuple(self._scales), self.wanted)
        except CaptureError as error:  # the recording goes on
            self._advice = str(error)

    def take(self, run: Run) -> None:
        """Samples of the probe."""
        if self.coverage is not None:
            rows = {name: np.array([run.counts[:, i] * by for i, by in of]) for name, of in self._scales.items()}
            self.coverage.feed(run.first, rows)

    def tell(self, count: Count) -> None:
        """Counts of the probe's lines."""
        self._lost = {"torn": count.torn, "garbage": count.garbage}

    def end(self, why: str) -> None:
        """The recording has ended."""
        self.ended = why or "an error ended it"

    def state(self) -> dict[str, Any]:
        """The message to pages."""
        coverage = self.coverage
        if coverage is None:
            return {"advice": self._advice}
        now = coverage.now
        warnings = []
        if coverage.seconds - coverage.clipped_s < LATELY_S:
            warnings.append("clipped: press more lightly, go slower, or set the sensor to a larger range")
        if coverage.seconds - coverage.dropped_s < LATELY_S:
            warnings.append("samples are being lost")
        if self.skipped:
            warnings.append("this computer is too slow for the page; the recording is complete")
        return {
            "force_N": coverage.force_N.round(4).tolist() if coverage.has_force else None,
            "speed_m_s": coverage.speed_m_s.round(5).tolist() if coverage.has_speed else None,
            "limits": coverage.limits,
            "share": coverage.share.round(3).tolist(),
            "target": coverage.target,
            "advice": coverage.advice(),
            "at": [round(now.force_N, 4), round(now.speed_m_s, 5), now.state],
            "level": [round(now.rms_m_s2, 4), round(now.peak_m_s2, 4)],
            "seconds": round(coverage.seconds, 2),
            "lacks": coverage.lacks,
            "lost": {"dropped": coverage.dropped, **self._lost, "clipped": coverage.clipped},
            "warnings": warnings,
            "enough": coverage.enough,
            "ended": self.ended,
        }


class CoveragePage:
    """The page's web server, open while used with `with`.

    Args:
        port: where to listen; 0 for any that is free.

    Attributes:
        url: of the page, with its token.
        stopped: set once a page sent "stop".

    Raises:
        HapsceneError: websockets is missing; the port is taken.
    """

    def __init__(self, port: int = 0) -> None:
        self._state: Mapping[str, Any] = {"advice": "waiting for the probe …"}
        self.stopped = Event()
        self._server = WebServer(
            resources.files("hapscene.capture.record"),
            "coverage",
            take=self._take,
            joined=lambda page: page.send(self._state),
            port=port,
            message_max=MESSAGE_MAX,
            option="--page-port",
        )
        self.url = self._server.url

    def __enter__(self) -> Self:
        self._server.open()
        return self

    def __exit__(self, *error: object) -> None:
        self._server.close()

    def send(self, state: Mapping[str, Any]) -> None:
        """Send a state to every page."""
        self._state = state
        self._server.send(state)

    def _take(self, page: PageConnection, message: object) -> None:
        if message == "stop":
            self.stopped.set()


class CoverageProcess:
    """A `LiveCoverage` and its page in a process of their own: a `Watcher` that never waits for them.

    Args:
        wanted: what the recording is to hold.
        port: of the page; 0 for any that is free.

    Attributes:
        url: of the page, with its token.
        done: whether more would not help, or a page was stopped.
        lines: the table, once the recording has ended.

    Raises:
        HapsceneError: websockets is missing; the port is taken.
    """

    def __init__(self, wanted: Wanted, port: int = 0) -> None:
        context = multiprocessing.get_context("spawn")
        self._answers, theirs = context.Pipe(duplex=False)
        self._calls: Queue[tuple[str, Any]] = context.Queue(WAITING_MAX)
        self._skipped = 0
        self._process = context.Process(target=_serve, args=(self._calls, theirs, wanted, port), daemon=True)
        self._process.start()
        theirs.close()
        self.url, self.done = "", False
        self.lines: list[str] | None = None
        self._receive(PATIENCE_S)
        if not self.url:
            self.__exit__()
            raise HapsceneError(" ".join(self.lines or ("the page did not start",)))

    def __enter__(self) -> "CoverageProcess":
        return self

    def __exit__(self, *error: object) -> None:
        self._call("close", None)
        self._calls.close()
        self._process.join(PATIENCE_S)
        self._process.kill()
        self._calls.cancel_join_thread()

    def begin(self, header: Header) -> None:
        self._call("begin", header)

    def take(self, run: Run) -> None:
        self._call("take", run)

    def tell(self, count: Count, position: int) -> None:
        self._call("tell", (Count(**vars(count)), self._skipped))
        self._receive(0.0)

    def end(self, why: str) -> None:
        self._call("end", why)
        end_s = time.monotonic() + PATIENCE_S
        while self.lines is None and self._process.is_alive() and time.monotonic() < end_s:
            self._receive(BEAT_S)

    def _call(self, name: str, value: object) -> None:
        try:
            self._calls.put_nowait((name, value))
        except (queue.Full, ValueError):
            self._skipped += 1

    def _receive(self, patience_s: float) -> None:
        """Take up what the page's process sends."""
        with suppress(EOFError, OSError):  # the process has ended: the recording goes on
            while self._answers.poll(patience_s):
                name, value = self._answers.recv()
                setattr(self, name, value)
                patience_s = 0.0


def _serve(calls: "Queue[tuple[str, Any]]", answers: "Connection", wanted: Wanted, port: int) -> None:
    """The page's process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the recording, and that ends this process
    import scipy.signal  # noqa: F401  # takes long at first: not while samples come

    live = LiveCoverage(wanted)
    try:
        page = CoveragePage(port)
    except HapsceneError as error:
        answers.send(("lines", [str(error)]))
        return
    with page:
        answers.send(("url", page.url))
        name, done = "", False
        while name != "close":
            sent_s = time.monotonic()
            while name != "close" and (left_s := sent_s + BEAT_S - time.monotonic()) > 0.0:
                with suppress(queue.Empty):
                    name, value = calls.get(timeout=left_s)
                    if name == "tell":
                        count, live.skipped = value
                        live.tell(count)
                    elif name != "close":
                        getattr(live, name)(value)
                    if name == "end":
                        answers.send(("lines", table(live.coverage) if live.coverage else []))
            page.send(live.state())
            if not done and (page.stopped.is_set() or (live.coverage is not None and live.coverage.enough)):
                done = True
                answers.send(("done", done))


def table(coverage: Coverage) -> list[str]:
    """The cells, in lines for a terminal: seconds of sliding in each, with a star where it is filled."""
    pieces, share = coverage.pieces, coverage.share
    lines = [f"seconds of sliding ({coverage.seconds:.1f} s in all); * is enough"]
    speeds = [f"{1e3 * v:.0f}" for v in coverage.speed_m_s]
    names = [f"{low}–{high}" for low, high in pairwise(speeds)] if coverage.has_speed else ["any"]
    lines.append(" " * 15 + "".join(f"{name:>10}" for name in names) + "  mm/s")
    for i in reversed(range(len(pieces))):
        low, high = coverage.force_N[i : i + 2]
        name = f"{low:.2g}–{high:.2g} N" if coverage.has_force else "any force"
        cells = (f"{0.1 * n:.1f}{'*' if s >= 1.0 else ' '}" for n, s in zip(pieces[i], share[i], strict=True))
        lines.append(f"{name:>15}" + "".join(f"{cell:>10}" for cell in cells))
    counts = {"taps": coverage.taps, "clipped samples": coverage.clipped, "dropped samples": coverage.dropped}
    lines.append(", ".join(f"{count} {name}" for name, count in counts.items()))
    lines += [*coverage.limits, *(f"lacks: {text}" for text in coverage.lacks)]
    left = np.count_nonzero(share < 1.0)
    return [*lines, f"record on: {left} of {share.size} cells are not filled" if left else "every cell is filled"]


def blocks_of(streams: Mapping[str, Array], rate_Hz: float) -> Iterator[tuple[int, Mapping[str, Array]]]:
    """A recording's streams (n,) in blocks of `BEAT_S`, each with the number of its first sample."""
    count, size = len(streams["acceleration"]), math.ceil(BEAT_S * rate_Hz)
    for first in range(0, count, size):
        yield first, {name: stream[first : first + size] for name, stream in streams.items()}
