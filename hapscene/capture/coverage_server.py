"""Coverage beside a recording that is made, and its page: fed by a thread of its own, so that the reader never waits.

The page is told `BEATS_S` times a second where the hand is, what is still lacking, and what goes wrong. It may say one
word: stop. Who is let in, `hapscene.web_listener.PageListener` says.
"""

import json
import math
import time
from collections import deque
from collections.abc import Iterator, Mapping
from importlib import resources
from threading import Event, Lock, Thread
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hapscene.capture.coverage import Coverage, Wanted
from hapscene.capture.recording_source import AXES
from hapscene.capture.streams import Array
from hapscene.errors import CaptureError
from hapscene.web_listener import PageListener
from hapscene.wire.protocol import Count, Header, Run
from hapscene.wire.unit import UNITS

if TYPE_CHECKING:
    from websockets.sync.server import ServerConnection

BEAT_S: Final = 0.05
"""How often the page is told [s]."""

WAITING_MAX: Final = 4096
"""Most blocks that wait to be looked at [count]: some 20 s. What is more is left out of the picture, and told."""

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
    """The coverage of a recording while it is made: a `Watcher` of `hapscene.capture.record`, or fed by `put`.

    Attributes:
        coverage: None until the recording began.
        stopped: set once the page said so.
        ended: why it ended; empty while it goes on.
    """

    def __init__(self, wanted: Wanted) -> None:
        self.wanted = wanted
        self.coverage: Coverage | None = None
        self.stopped = Event()
        self.ended = ""
        self.said = json.dumps({"advice": "waiting for the probe …"}), 0
        """what pages are told, and which state it is"""
        self._blocks: deque[tuple[int, Mapping[str, Array] | Array]] = deque(maxlen=WAITING_MAX)
        self._scales: dict[str, list[tuple[int, float]]] = {}
        self._lost = {"torn": 0, "garbage": 0}
        self._skipped = 0
        self._over = Event()
        self._thread = Thread(target=self._work, name="hapscene coverage", daemon=True)
        self._lock = Lock()

    # --- what a recording tells

    def begin(self, header: Header) -> None:
        """The columns that a fit takes, by quantity; those of axes, as acceleration_x, together."""
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
            self.said = json.dumps({"advice": str(error)}), 1
            return
        self._thread.start()

    def take(self, run: Run) -> None:
        """Samples of the recording."""
        self._put(run.first, run.counts)

    def put(self, first: int, streams: Mapping[str, Array]) -> None:
        """Samples in SI, as `Coverage.feed` takes them."""
        self._put(first, streams)

    def _put(self, first: int, block: Mapping[str, Array] | Array) -> None:
        self._skipped += len(self._blocks) == WAITING_MAX
        self._blocks.append((first, block))

    def tell(self, count: Count, position: int) -> None:
        """What became of the lines."""
        self._lost = {"torn": count.torn, "garbage": count.garbage}

    def end(self, why: str) -> None:
        """It has ended; what came is looked at still."""
        self.ended = why or "an error ended it"
        self._over.set()
        if self._thread.ident is not None:
            self._thread.join()

    @property
    def enough(self) -> bool:
        """Whether more would not help."""
        return self.coverage is not None and self.coverage.enough

    # --- the thread

    def _work(self) -> None:
        """Look at what came, `BEAT_S` by `BEAT_S`, and say what there is to say."""
        over = False
        while not over:
            over = self._over.wait(BEAT_S)
            with self._lock:
                while self._blocks:
                    self._look(*self._blocks.popleft())
                self.said = json.dumps(self.state()), self.said[1] + 1

    def _look(self, first: int, block: Mapping[str, Array] | Array) -> None:
        assert self.coverage is not None
        if not isinstance(block, Mapping):
            block = {q: np.array([block[:, i] * scale for i, scale in of]) for q, of in self._scales.items()}
        self.coverage.feed(first, block)

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
        if self._skipped:
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
        self.url = self._listener.url

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

        Thread(target=self._listen, args=(connection,), daemon=True).start()
        self._told += 1
        shown = -1
        try:
            while True:
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

    def _listen(self, connection: "ServerConnection") -> None:
        from websockets.exceptions import ConnectionClosed

        try:
            while connection.recv() != "stop":
                pass
            self._live.stopped.set()
        except ConnectionClosed:
            pass


def table(coverage: Coverage) -> list[str]:
    """The cells, in lines for a terminal: seconds of sliding in each, with a star where it is enough."""
    pieces, share = coverage.pieces, coverage.share
    lines = [f"seconds of sliding ({coverage.seconds:.1f} s in all); * is enough"]
    speeds = [f"{1e3 * v:.0f}" for v in coverage.speed_m_s]
    names = [f"{low}–{high}" for low, high in zip(speeds, speeds[1:], strict=False)] if coverage.has_speed else ["any"]
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
