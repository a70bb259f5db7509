"""Coverage beside a recording that is made, and its page: in a process of its own, so that the reader never waits.

A reader that shares its interpreter with the page loses samples: on a crowded computer a third of 10 kHz, where one
alone loses some per cent. The page is told every `BEAT_S` where the hand is, what is still lacking, and what goes
wrong. It may say one word: stop. Who is let in, `hapscene.web_listener.PageListener` says.
"""

import json
import math
import signal
import time
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from importlib import resources
from itertools import pairwise
from threading import Event, Thread
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapscene.capture.coverage import Coverage, Wanted
from hapscene.capture.recording_source import AXES
from hapscene.capture.streams import Array
from hapscene.errors import CaptureError, HapsceneError
from hapscene.web_listener import PageListener
from hapscene.wire.protocol import Count, Header, Run
from hapscene.wire.unit import UNITS

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

    from websockets.sync.server import ServerConnection

BEAT_S: Final = 0.045
"""How long the page is told nothing [s]: with what waiting takes longer, 20 times a second."""

WAITING_MAX: Final = 4096
"""Most blocks that wait to be looked at [count]: some 20 s. What is more is left out of the picture, and told."""

PATIENCE_S: Final = 60.0
"""How long the page's process may take to start, and to end [s]."""

LATELY_S: Final = 1.5
"""How long the page tells that something was cut off, or did not come [s]."""

MESSAGE_MAX: Final = 64
"""Longest message of a page [bytes]."""

FILES: Final = {
    "": ("coverage.html", "text/html; charset=utf-8"),
    "coverage.css": ("coverage.css", "text/css; charset=utf-8"),
    "coverage.js": ("coverage.js", "text/javascript; charset=utf-8"),
}


class LiveCoverage:
    """The coverage of a recording that goes on, as pages are told it: a `Watcher` of `hapscene.capture.record`.

    Attributes:
        coverage: None until the recording began.
        stopped: set once a page said so.
        ended: why it ended; empty while it goes on.
        said: what pages are told, and the number of that state.
        skipped: blocks that were left out [count].
    """

    def __init__(self, wanted: Wanted) -> None:
        self.wanted = wanted
        self.coverage: Coverage | None = None
        self.stopped = Event()
        self.ended, self.skipped = "", 0
        self.said = json.dumps({"advice": "waiting for the probe …"}), 0
        self._lost = {"torn": 0, "garbage": 0}
        self._scales: dict[str, list[tuple[int, float]]] = {}

    def begin(self, header: Header) -> None:
        """Columns of axes, as acceleration_x, are one quantity; what a fit does not take is passed over."""
        for i, column in enumerate(header.columns):
            quantity, _, axis = column.name.rpartition("_")
            name = quantity if axis in AXES else column.name
            if column.unit in UNITS.get(name, {}):
                self._scales.setdefault(name, []).append((i, column.scale * UNITS[name][column.unit]))
        self.start(header.rate_Hz, tuple(self._scales))

    def start(self, rate_Hz: float, quantities: tuple[str, ...]) -> None:
        """It begins."""
        try:
            self.coverage = Coverage(rate_Hz, quantities, self.wanted)
        except CaptureError as error:  # it is recorded all the same
            self.said = json.dumps({"advice": str(error)}), self.said[1] + 1

    def take(self, run: Run) -> None:
        """Samples of a probe."""
        self.feed(run.first, {q: np.array([run.counts[:, i] * by for i, by in of]) for q, of in self._scales.items()})

    def feed(self, first: int, streams: Mapping[str, Array]) -> None:
        """Samples in SI, as `Coverage.feed` takes them."""
        if self.coverage is not None:
            self.coverage.feed(first, streams)

    def tell(self, count: Count, position: int) -> None:
        """What became of the lines."""
        self._lost = {"torn": count.torn, "garbage": count.garbage}

    def end(self, why: str) -> None:
        """It has ended."""
        self.ended = why or "an error ended it"

    @property
    def done(self) -> bool:
        """Whether more would not help, or a page said stop."""
        return self.stopped.is_set() or (self.coverage is not None and self.coverage.enough)

    def publish(self) -> None:
        """Have pages told how it stands."""
        if self.coverage is not None:
            self.said = json.dumps(self.state()), self.said[1] + 1

    def state(self) -> dict[str, Any]:
        """What a page is told."""
        coverage = self.coverage
        assert coverage is not None
        now = coverage.now
        wrong = []
        if coverage.seconds - coverage.clipped_s < LATELY_S:
            wrong.append(
                "cut off: the sensor is at its end. Press more lightly, go slower, or set it to a larger range"
            )
        if coverage.seconds - coverage.dropped_s < LATELY_S:
            wrong.append("samples are lost on the way")
        if self.skipped:
            wrong.append("this computer is too slow for the picture; the recording is whole")
        return {
            "force_N": coverage.force_N.round(4).tolist() if coverage.has_force else None,
            "speed_m_s": coverage.speed_m_s.round(5).tolist() if coverage.has_speed else None,
            "cannot": coverage.cannot,
            "share": coverage.share.round(3).tolist(),
            "target": coverage.target,
            "advice": coverage.advice(),
            "at": [round(now.force_N, 4), round(now.speed_m_s, 5), now.state],
            "level": [round(now.rms_m_s2, 4), round(now.peak_m_s2, 4)],
            "seconds": round(coverage.seconds, 2),
            "error_dB": round(coverage.error_dB, 2),
            "lacks": coverage.lacks,
            "lost": {"dropped": coverage.dropped, **self._lost, "cut off": coverage.clipped, "knocks": coverage.knocks},
            "wrong": wrong,
            "enough": coverage.enough,
            "ended": self.ended,
        }


class CoveragePage:
    """Serves the page of a `LiveCoverage` while it is open.

    Args:
        live: what is shown.
        host, port: where to listen; port 0 for any that is free.
        option: by which the port is said.

    Attributes:
        url: of the page, with its token.
        seen: set once somebody looked.

    Raises:
        HapsceneError: websockets is missing; the port is taken, the host not ours.
    """

    def __init__(
        self, live: LiveCoverage, *, host: str = "127.0.0.1", port: int = 0, option: str = "--page-port"
    ) -> None:
        folder = resources.files("hapscene.capture")
        files = {name: ((folder / file).read_bytes(), kind) for name, (file, kind) in FILES.items()}
        self._live, self._closing, self._told = live, Event(), 0
        self._listener = PageListener(self._talk, host, port, files=files, message_max=MESSAGE_MAX, option=option)
        self.url, self.seen = self._listener.url, Event()

    @property
    def is_open(self) -> bool:
        """Whether somebody looks."""
        return self._told > 0

    def __enter__(self) -> "CoveragePage":
        self._listener.open()
        return self

    def __exit__(self, *error: object) -> None:
        self._closing.set()
        end_s = time.monotonic() + 1.0
        while self._told and time.monotonic() < end_s:  # pages are told how it ended
            time.sleep(0.01)
        self._listener.close()

    def _talk(self, connection: "ServerConnection") -> None:
        """Tell a page what is new until it goes, and listen for its one word."""
        from websockets.exceptions import ConnectionClosed

        gone = Event()
        Thread(target=self._listen, args=(connection, gone), daemon=True).start()
        self._told += 1
        self.seen.set()
        shown = -1
        try:
            while not gone.is_set():
                closing = self._closing.wait(BEAT_S)
                text, state = self._live.said
                if state != shown:
                    connection.send(text)
                    shown = state
                if closing:
                    break
        except ConnectionClosed:
            pass
        finally:
            self._told -= 1
            connection.close()

    def _listen(self, connection: "ServerConnection", gone: Event) -> None:
        from websockets.exceptions import ConnectionClosed

        try:
            for word in connection:
                if word == "stop":
                    self._live.stopped.set()
        except ConnectionClosed:
            pass
        gone.set()


class CoverageProcess:
    """A `LiveCoverage` and its page in a process of their own: a `Watcher` that never waits for them.

    Args:
        wanted: what the recording is to hold.
        port: of the page; 0 for any that is free.

    Attributes:
        url: of the page, with its token.
        done: whether more would not help, or a page said stop.
        lines: the table, once the recording has ended.

    Raises:
        HapsceneError: websockets is missing; the port is taken.
    """

    def __init__(self, wanted: Wanted, port: int = 0) -> None:
        from multiprocessing import get_context

        context = get_context("spawn")
        self._line, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, wanted, port), daemon=True)
        self._process.start()
        theirs.close()
        self.url, self.done = "", False
        self.lines: list[str] | None = None
        self._waiting: deque[tuple[str, Any]] = deque()
        self._skipped = 0
        self._over = Event()
        self._sender = Thread(target=self._send, name="hapscene coverage", daemon=True)
        self._hear(PATIENCE_S)
        if not self.url:
            self._process.join(PATIENCE_S)
            raise HapsceneError(" ".join(self.lines or ("the page did not start",)))

    def __enter__(self) -> "CoverageProcess":
        return self

    def __exit__(self, *error: object) -> None:
        self._line.close()
        self._process.join(PATIENCE_S)
        self._process.kill()

    def begin(self, header: Header) -> None:
        """What will come."""
        self._waiting.append(("begin", header))
        self._sender.start()

    def take(self, run: Run) -> None:
        """Samples of the recording."""
        if len(self._waiting) < WAITING_MAX:
            self._waiting.append(("take", run))
        else:
            self._skipped += 1

    def tell(self, count: Count, position: int) -> None:
        """What became of the lines; and what the page has to say."""
        self._waiting.append(("tell", replace(count)))
        self._hear(0.0)

    def end(self, why: str) -> None:
        """It has ended."""
        self._waiting.append(("end", why))
        self._over.set()
        self._sender.join(PATIENCE_S)
        end_s = time.monotonic() + PATIENCE_S
        while self.lines is None and self._process.is_alive() and time.monotonic() < end_s:
            self._hear(BEAT_S)

    def _hear(self, patience_s: float) -> None:
        """Take up what the page's process says."""
        with suppress(EOFError, OSError):  # it is gone: the recording goes on
            while self._line.poll(patience_s):
                name, value = self._line.recv()
                setattr(self, name, value)
                patience_s = 0.0

    def _send(self) -> None:
        """Hand on what came, `BEAT_S` by `BEAT_S`: who waits for a slow page is this thread."""
        over = False
        with suppress(OSError):
            while not over:
                over = self._over.wait(BEAT_S)
                items = [self._waiting.popleft() for _ in range(len(self._waiting))]
                self._line.send((self._skipped, items))


def _serve(line: "Connection", wanted: Wanted, port: int) -> None:
    """The page's process: until the line ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the recording, and that ends this
    import scipy.signal  # noqa: F401  # takes long at first: not while samples come

    live = LiveCoverage(wanted)
    try:
        page = CoveragePage(live, port=port)
    except HapsceneError as error:
        line.send(("lines", [str(error)]))
        return
    with page, suppress(EOFError, OSError):
        line.send(("url", page.url))
        done = False
        while True:
            live.skipped, items = line.recv()
            for name, value in items:
                if name == "tell":
                    live.tell(value, 0)
                else:
                    getattr(live, name)(value)
            live.publish()
            if live.done > done:
                line.send(("done", done := True))
            if live.ended:
                line.send(("lines", table(live.coverage) if live.coverage else []))


def table(coverage: Coverage) -> list[str]:
    """The cells, in lines for a terminal: seconds of sliding in each, with a star where it is enough."""
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
    lines.append(f"level known to {coverage.error_dB:.1f} dB rms over all that is wanted, as far as can be told")
    told = {"taps": coverage.taps, "clipped samples": coverage.clipped, "dropped samples": coverage.dropped}
    told["pieces far too loud or soft"] = coverage.knocks
    lines.append(", ".join(f"{count} {name}" for name, count in told.items()))
    return [*lines, *coverage.cannot, *(f"lacks: {text}" for text in coverage.lacks), *_advised(coverage)]


def _advised(coverage: Coverage) -> list[str]:
    """What cells lack still, the worst first."""
    if coverage.enough:
        return ["enough: more would not help"]
    places = np.argwhere(coverage.share < 1.0)
    if not len(places):
        return []
    order = np.argsort([coverage.share[tuple(place)] for place in places], kind="stable")
    words = []
    for i, j in places[order[:3]]:
        force = "{:.2g} to {:.2g} N".format(*coverage.force_N[i : i + 2]) if coverage.has_force else ""
        speed = "{:.0f} to {:.0f} mm/s".format(*(1e3 * coverage.speed_m_s[j : j + 2])) if coverage.has_speed else ""
        words.append(" at ".join(filter(None, (force, speed))) or "a longer stroke")
    more = f", and {len(places) - 3} more" if len(places) > 3 else ""
    return [f"record on: {'; '.join(words)}{more}"]


def blocks_of(streams: Mapping[str, Array], rate_Hz: float) -> Iterator[tuple[int, Mapping[str, Array]]]:
    """A recording's streams (n,) in blocks of `BEAT_S`, each with the number of its first sample."""
    count, size = len(streams["acceleration"]), math.ceil(BEAT_S * rate_Hz)
    for first in range(0, count, size):
        yield first, {name: stream[first : first + size] for name, stream in streams.items()}
