"""A handle over a pseudo-terminal: a simulated one at the wire, and wires and handles that go wrong."""

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import closing

import numpy as np
import pytest

from hapscene.errors import HandleError
from hapscene.handle import board as port_module
from hapscene.handle.board import SerialSource
from hapscene.handle.force_source import SimulatedSource, simulated_grips
from hapscene.handle.plant import Plant
from hapscene.io.probe_protocol import Column, Header, sample_line, sealed
from tests.handle.serial_board import COLUMNS, Peer, serve
from tests.header_line import header_line

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals on this system")

RATE_HZ = 2000.0
FORCE = 0.3 * np.sin(2 * np.pi * 40.0 * np.arange(6000) / RATE_HZ) * np.hanning(6000)


class Wire:
    """A pseudo-terminal whose other end a thread plays."""

    def __init__(self) -> None:
        import tty

        self.ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        os.set_blocking(self.ours, False)
        self.port = os.ttyname(self._theirs)
        self._thread: threading.Thread | None = None
        self.over = threading.Event()
        self.failed: list[BaseException] = []

    def play(self, peer: Peer) -> None:
        """Plays that handle, as fast as force comes."""

        def run() -> None:
            try:
                serve(peer, self.ours, self.over.is_set, hurried=True)
            except BaseException as error:
                self.failed.append(error)

        self._thread = threading.Thread(target=run, daemon=True)
        self._thread.start()

    def say(self, text: bytes) -> None:
        """Prints that again and again."""

        def run() -> None:
            while not self.over.wait(0.02):
                try:
                    os.write(self.ours, text)
                except OSError:
                    return

        self._thread = threading.Thread(target=run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self.over.set()
        if self._thread is not None:
            self._thread.join(120.0)
        os.close(self.ours)
        os.close(self._theirs)
        assert not self.failed, self.failed


@pytest.fixture
def wire() -> Iterator[Wire]:
    wire = Wire()
    yield wire
    wire.close()


def peer() -> Peer:
    peer = Peer(SimulatedSource(Plant(), RATE_HZ, noise_m_s2_rtHz=0.0, tremor_N=0.0), grip_count=2)
    peer.give(1)  # compiled before anybody waits
    return peer


def counts(force: np.ndarray) -> np.ndarray:
    """Force in the wire's counts without its zeros: where the computer is late, the handle puts some between."""
    whole = np.rint(force / COLUMNS[0].scale)
    return whole[whole != 0.0]


def felt(force: np.ndarray) -> np.ndarray:
    """What that force makes the simulated handle do in its first grip."""
    _, k_u, b_u = simulated_grips(2)[0]
    plant = Plant(k_u_N_m=k_u, b_u_Ns_m=b_u)
    return SimulatedSource(plant, RATE_HZ, noise_m_s2_rtHz=0.0, tremor_N=0.0).advance(force)[0]


def test_played_samples_are_output_and_measured(wire: Wire) -> None:
    wire.play(peer())
    with closing(SerialSource(wire.port)) as source:
        assert source.rate_Hz == RATE_HZ
        force, acceleration = source.play(FORCE)
    np.testing.assert_array_equal(counts(force), counts(FORCE))
    np.testing.assert_allclose(acceleration, felt(force), atol=1e-3)


def dropping(every: int) -> Callable[[bytes], bytes]:
    """Leaves out each sample line whose number is a multiple."""

    def drop(data: bytes) -> bytes:
        lines = data.split(b"\n")
        kept = [x for x in lines if x.startswith(b"#") or not x or int(x.split(b",")[0]) % every]
        return b"\n".join(kept)

    return drop


@pytest.mark.parametrize(("every", "works"), [(300, True), (20, False)])
def test_samples_lost_on_the_way_back_are_bridged_up_to_1_percent(wire: Wire, every: int, works: bool) -> None:
    handle = peer()
    give, drop = handle.give, dropping(every)
    handle.give = lambda count: drop(give(count))  # type: ignore[method-assign]
    wire.play(handle)
    with closing(SerialSource(wire.port)) as source:
        if works:
            force, acceleration = source.play(FORCE)
            assert np.abs(acceleration - felt(force)).mean() < 0.01 * np.abs(acceleration).mean()
        else:
            with pytest.raises(HandleError, match=r"5\.0 %"):
                source.play(FORCE)


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(port_module, "SILENCE_S", 0.25)


def header(*columns: Column) -> bytes:
    return header_line(Header(RATE_HZ, columns))


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"hello\n", "no line `#hapscene-probe 1"),
        (header(*COLUMNS[:2]), "'played'"),
        (header(COLUMNS[0], Column("acceleration", "furlong", 1.0), COLUMNS[2]), "'furlong'.*'acceleration'"),
        (header(*COLUMNS).replace(b" 1 ", b" 9 ").split(b"*")[0], "no line"),
        (sealed(b"#hapscene-probe 9 rate=1"), "version 9"),
        (header(*COLUMNS) + sample_line(0, (0, 0, 5)), "no restart"),
        (header(*COLUMNS) + sample_line(0, (0, 0, 0)), "no sample played"),
    ],
)
def test_devices_that_are_not_handles_are_refused(wire: Wire, text: bytes, words: str) -> None:
    if text:
        wire.say(text)
    with pytest.raises(HandleError, match=words), closing(SerialSource(wire.port)) as source:
        source.play(FORCE)
