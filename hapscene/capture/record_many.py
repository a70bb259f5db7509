"""Several probes recorded side by side: each by a process of its own, so that none waits for another.

Stands alone: `record` knows one port and no process. What a process shows goes through memory that both see, without a
lock: a terminal that stands still, or a process that is killed, stops nobody else.
"""

import multiprocessing
import os
import signal
import sys
import time
import uuid
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from hapscene.capture.record import LOG_S, TERMINAL_S, Made, record
from hapscene.capture.record_file import SUFFIX, taken
from hapscene.errors import CaptureError, HapsceneError
from hapscene.interrupt import ENDS
from hapscene.parallel import begin_process
from hapscene.wire.port import BAUD
from hapscene.wire.protocol import Column, Count, Header, Run

LINE_B: Final = 160
"""Longest state of a source [bytes]."""

POLL_S: Final = 0.05
"""How often it is looked what the sources do [s]."""


def record_many(
    ports: Sequence[str],
    path: str | os.PathLike[str],
    baud: int = BAUD,
    duration_s: float | None = None,
    *,
    stopped: Callable[[], bool] = lambda: False,
    say: Callable[[str], None] = lambda line: None,
    show: Callable[[str], None] = lambda line: None,
) -> list[Made | str]:
    """Records from several probes, each as `record` does; of each what was made, or why nothing was.

    How a source ended is said at once, and the others go on.

    Args:
        ports: names of the serial ports.
        path: as for `record`; "tap.hsrec" becomes "tap-1.hsrec", "tap-2.hsrec", …, in the order of the ports.
        baud: speed of the ports [bit/s].
        duration_s: how much to record; None: until `stopped`.
        stopped: asked about 20 times a second.
        say: called with each line for the user.
        show: called with the state of all in a line, ten times a second on a terminal, else each second.

    Raises:
        CaptureError: a port that stands twice; a file that is there already.
    """
    target = Path(path)
    if len(set(ports)) < len(ports):
        raise CaptureError("a port stands twice: each source has one of its own")
    paths = [target.with_stem(f"{target.stem}-{number}") for number in range(1, len(ports) + 1)]
    for file in {name for each in paths for name in (each, each.with_suffix(SUFFIX))}:
        if file.exists():
            raise taken(file)
    spawn, clock = multiprocessing.get_context("spawn"), uuid.uuid4().hex
    stop = spawn.RawValue("b", 0)
    sources: list[_Source] = []
    shown_s, period_s = time.monotonic(), TERMINAL_S if sys.stdout.isatty() else LOG_S
    try:
        begun = (_Source(spawn, *each, baud, duration_s, clock, stop) for each in zip(ports, paths, strict=True))
        sources.extend(begun)  # one by one: where one cannot begin, those before it are ended
        while any([source.look(say) is None for source in sources]):
            time.sleep(POLL_S)
            stop.value = stop.value or stopped()
            if time.monotonic() - shown_s >= period_s:
                shown_s = time.monotonic()
                show("  |  ".join(f"{number}: {source.state}" for number, source in enumerate(sources, 1)))
    finally:
        stop.value = 1
        for source in sources:
            source.close()
    return [source.result for source in sources if source.result is not None]


class _Source:
    """A process that records one port, seen from the one that began it."""

    def __init__(
        self, spawn: Any, port: str, path: Path, baud: int, duration_s: float | None, clock: str, stop: Any
    ) -> None:
        self.port, self.path = port, path
        self.result: Made | str | None = None
        self._said, theirs = spawn.Pipe(duplex=False)
        self._state = spawn.RawArray("c", LINE_B)
        arguments = (port, path, baud, duration_s, clock, stop, self._state, theirs)
        self._process = spawn.Process(target=_work, args=arguments, name=f"hapscene {port}")
        self._process.start()
        theirs.close()

    @property
    def state(self) -> str:
        """How it stands, in words."""
        if self.result is not None:
            return "ended"
        return bytes(self._state.value).decode(errors="replace") or "waits for its probe"

    def look(self, say: Callable[[str], None]) -> Made | str | None:
        """What it has made, or why nothing; None while it records. What it says goes to `say`."""
        try:
            while self.result is None and self._said.poll():
                kind, said = self._said.recv()
                if kind == "line":
                    say(said)
                else:
                    self.result = said
                    say(f"{self.port}: {said}" if isinstance(said, Made) else said)
        except (EOFError, OSError):
            self._process.join()
            left = f"; what was recorded until then is in {self.path.with_suffix(SUFFIX)}"
            self.result = f"{self.port}: its process ended (exit code {self._process.exitcode}){left}"
            say(self.result)
        return self.result

    def close(self) -> None:
        """Waits until the process has ended."""
        self._process.join()
        self._said.close()


@dataclass
class _State:
    """Who watches a recording, and puts its state where another process reads it: never blocks."""

    place: Any
    columns: tuple[Column, ...] = ()
    rate_Hz: float = 1.0
    rms: float = 0.0

    def begin(self, header: Header) -> None:
        self.columns, self.rate_Hz = header.columns, header.rate_Hz

    def take(self, run: Run) -> None:
        self.rms = float(run.counts[:, 0].std()) * abs(self.columns[0].scale)

    def tell(self, count: Count, position: int) -> None:
        lost = f"{count.dropped} lost" + (f", {count.torn + count.garbage} spoilt" * bool(count.torn + count.garbage))
        text = f"{position / self.rate_Hz:.1f} s, {lost}, {self.rms:.3g} {self.columns[0].unit}"
        self.place.value = text.encode()[: LINE_B - 1]

    def end(self, why: str) -> None:
        pass


def _work(
    port: str, path: Path, baud: int, duration_s: float | None, clock: str, stop: Any, state: Any, told: Any
) -> None:
    """What a process of `record_many` does."""
    begin_process()  # Ctrl-C is left to the parent, whose end is this one's
    for kind in ENDS:
        signal.signal(kind, signal.SIG_IGN)
    sys.stdout = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115  # its level is shown by the parent
    try:
        made: Made | str = record(
            port,
            path,
            baud,
            duration_s,
            lambda: bool(stop.value),
            lambda line: told.send(("line", line)),
            watch=(_State(state),),
            clock=clock,
        )
    except KeyboardInterrupt:
        made = f"{port}: stopped before a probe announced itself: nothing was recorded"
    except HapsceneError as error:
        made = str(error)
    told.send(("result", made))
