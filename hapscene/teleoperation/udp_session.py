"""Leader and follower as processes: the bilateral loop at 1 kHz, over UDP.

Datagrams that arrive are checked (`datagram`) and handed to the endpoint; the tick is that of the simulation
(`bilateral_loop`); messages that leave the link are sent. When the peer has been silent for the coupling's `timeout_s`
the motors let go (`endpoint`). The session ends after `PATIENCE_S` of silence, with the peer, or at Ctrl-C; the peer is
sent a last message.
"""

import gc
import math
import os
import socket
import time
from collections import deque
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import Any, Final

import numpy as np

from hapscene.constants import ACCELERATION_RATE_HZ, TICK_S
from hapscene.device.sim.omni import Omni
from hapscene.errors import HapsceneError
from hapscene.handle.handle_loop import new_handle
from hapscene.handle.plant import Plant
from hapscene.interrupt import interrupt_noted
from hapscene.loop.reference_trajectory import ReferenceTrajectory
from hapscene.records import records
from hapscene.teleoperation.bilateral_loop import step_follower, step_leader
from hapscene.teleoperation.datagram import DATAGRAM, MESSAGE, Gate, pack
from hapscene.teleoperation.endpoint import ROLES, SCHEMES, Coupling, hear, new_endpoint
from hapscene.teleoperation.leader_follower import Follower, Leader, new_follower, new_leader
from hapscene.teleoperation.link import Impairment, collect, new_link
from hapscene.teleoperation.operation import UP, world_of
from hapscene.teleoperation.test_plate import START_M, explore, plate
from hapscene.touch import speak

__all__ = ["Pace", "UdpSession", "run_follower", "run_leader"]

BEHIND_MAX: Final = 50
"""Most ticks that are made up for [count]. A process that was held up for longer skips them."""

KEPT_COUNT: Final = 60_000
"""Ticks whose latency is kept for the summary [count]: the last minute."""

PATIENCE_S: Final = 2.0
"""Silence after which a session ends [s]."""

WAIT_S: Final = 10.0
"""How long a leader calls for a follower that has not answered yet [s]."""

ARRIVAL_MAX: Final = 64
"""Most datagrams that are taken in a tick [count]. A flood beyond it is dropped by the system."""

GOODBYES: Final = 3
"""How often the peer is told that the session is over [count]: each of them may be lost."""

_TICK_NS: Final = round(TICK_S * 1e9)


class Pace:
    """Due times of a 1 kHz loop.

    Attributes:
        slipped: ticks that were skipped because the process was held up [count].
        late_ns: latencies of the last ticks.
    """

    def __init__(self) -> None:
        self.slipped = 0
        self.late_ns: deque[int] = deque(maxlen=KEPT_COUNT)
        self._due_ns = time.perf_counter_ns()

    def await_tick(self) -> None:
        """Sleep until the next tick is due."""
        self._due_ns += _TICK_NS
        left_ns = self._due_ns - time.perf_counter_ns()
        if left_ns < -BEHIND_MAX * _TICK_NS:
            self.slipped += -left_ns // _TICK_NS
            self._due_ns += -left_ns // _TICK_NS * _TICK_NS
        elif left_ns > 0:
            time.sleep(left_ns * 1e-9)
        self.late_ns.append(time.perf_counter_ns() - self._due_ns)


def _quantiles(values: Collection[int], scale: float) -> dict[str, float]:
    """Quantiles of values, each times `scale`; empty without any."""
    shares = {"median": 50.0, "p99": 99.0, "max": 100.0}
    return {n: round(float(np.percentile(list(values), q)) * scale, 3) for n, q in shares.items()} if values else {}


class UdpSession:
    """A leader or a follower, and its socket.

    Args:
        side: the end that this process moves; it may tick once before the first message, to be compiled.
        sock: a leader's is connected to its follower; a follower's is bound, and obeys the first leader it hears.
        intent: of the leader's hand, which it repeats.
        impairment: of the line from here.
        seed: of the impairment.
        allowed: the one host that a follower listens to, as in "127.0.0.1"; None for any.
    """

    def __init__(
        self,
        side: Leader | Follower,
        sock: socket.socket,
        intent: ReferenceTrajectory | None = None,
        impairment: Impairment | None = None,
        seed: int = 0,
        allowed: str | None = None,
    ) -> None:
        self._side, self._socket, self._allowed = side, sock, allowed
        self._hand = None if intent is None else (intent.target_W_m, intent.grip, intent.push_W_N)
        self._role = 0 if intent is not None else 1
        self._peer: Any = sock.getpeername() if self._role == 0 else None
        self._session = int.from_bytes(os.urandom(4), "little")
        self._link = new_link(impairment or Impairment(), TICK_S, seed, ("forth", "back")[self._role])
        self._message = records(1, MESSAGE)
        self._scheme = int(side.end.port[0].wave)
        self.gate = Gate(1 - self._role, self._scheme)
        self._ticks = self._sent = self._strangers = 0
        self._trips: deque[int] = deque(maxlen=KEPT_COUNT)
        self._force_max_N = self._force_in_silence_N = 0.0
        sock.setblocking(False)

    def run(self, duration_s: float, stopped: Callable[[], bool] = lambda: False) -> dict[str, Any]:
        """Run until `duration_s` have passed since the peer's first message, it is gone, or `stopped`.

        Returns:
            a summary: why it ended, datagrams by result, times, forces.

        Raises:
            HapsceneError: a leader received nothing within `WAIT_S`; the peer has another scheme.
        """
        if self._ticks == 0:
            self.rehearse()
        collecting = gc.isenabled()
        gc.disable()  # a collection takes several ticks
        pace = Pace()
        try:
            reason = self._loop(pace, duration_s / TICK_S, stopped)
        finally:
            if collecting:
                gc.enable()
            self._say_goodbye()
        port, queue = self._side.end.port[0], self._side.end.queue[0]
        return {
            "ended": reason,
            "role": ROLES[self._role],
            "ticks": self._ticks,
            "sent": self._sent,
            "received": {**self.gate.counts, "from strangers": self._strangers, "overtaken": int(port.overtaken)},
            "lost_by_impairment": int(self._link.line[0].lost),
            "round_trip_ms": _quantiles(self._trips, TICK_S * 1e3),
            "queue_ms": round(int(queue.waited_ticks) / max(int(queue.stored), 1) * TICK_S * 1e3, 3),
            "force_max_N": self._force_max_N,
            "force_in_silence_N": self._force_in_silence_N,
            "work_of_motors_mJ": float(port.work_J) * 1e3,
            "latency_us": _quantiles(pace.late_ns, 1e-3),
            "slipped_ticks": pace.slipped,
        }

    def rehearse(self) -> None:
        """The first tick, which compiles, so that the next is in time; `run` does it where it was not done."""
        peer, self._peer = self._peer, None
        self._advance()
        self._peer = peer
        while collect(self._link, 0, self._message, 0):  # nobody hears it
            pass
        hear(new_endpoint(Coupling(SCHEMES[self._scheme]), ROLES[self._role], TICK_S), 0, self._message[0])

    def _loop(self, pace: Pace, tick_count: float, stopped: Callable[[], bool]) -> str:
        """Tick until something ends it; returns what."""
        silent, heard_since = 0, 0
        while True:
            pace.await_tick()
            silent = 0 if self._receive() else silent + 1
            if self._role == 0 or self.gate.session is not None:  # a follower without a leader does not tick
                self._advance()
            heard_since += 1 if self.gate.session is not None else 0
            if self.gate.mismatched:
                raise HapsceneError(
                    f"the peer has another scheme than {SCHEMES[self._scheme]!r}: start both with the same --scheme"
                )
            if self.gate.ended:
                return "the peer has ended"
            if stopped():
                return "it was stopped"
            if heard_since >= tick_count:
                return "its time is over"
            if self.gate.session is not None and silent * TICK_S > PATIENCE_S:
                return f"the peer has been silent for {PATIENCE_S:g} s"
            if self.gate.session is None and self._role == 0 and silent * TICK_S > WAIT_S:
                raise HapsceneError(
                    f"no follower answers at {_name(self._peer)}; start one there: hapscene lab teleoperate follower"
                )

    def _receive(self) -> bool:
        """Hand what has arrived to the end; whether a message was let in."""
        heard = False
        for _ in range(ARRIVAL_MAX):
            try:
                data, address = self._socket.recvfrom(DATAGRAM.itemsize + 1)
            except BlockingIOError:
                break
            except OSError:  # the peer's port is not open yet, or no longer; the network is down
                continue
            known = address == self._peer if self._peer is not None else self._allowed in (None, address[0])
            message = self._message[0]
            if not known:
                self._strangers += 1
            elif self.gate.admit(data, message):
                self._peer, heard = address, True
                hear(self._side.end, self._ticks, message)
                if message.echo >= 0:
                    self._trips.append(self._ticks - int(message.echo))
        return heard

    def _advance(self) -> None:
        """One tick, and what the line from here lets out."""
        now, self._ticks = self._ticks, self._ticks + 1
        if self._hand is not None:
            step_leader(self._side, self._hand, now % len(self._hand[0]), self._link, now)
        else:
            step_follower(self._side, self._link, now)
        while self._peer is not None and collect(self._link, now, self._message, 0):
            self._send()
        port = self._side.end.port[0]
        force_N = float(np.linalg.norm(port.f_N))
        self._force_max_N = max(force_N, self._force_max_N)
        if port.silent_ticks > port.timeout_ticks:
            self._force_in_silence_N = max(force_N, self._force_in_silence_N)

    def _send(self, ends: bool = False) -> None:
        data = pack(self._message[0], self._role, self._session, self._scheme, ends)
        try:
            self._socket.sendto(data, self._peer) if self._role == 1 else self._socket.send(data)
            self._sent += 1
        except OSError:  # a full buffer, a closed port, no network: lost, as anywhere on the way
            pass

    def _say_goodbye(self) -> None:
        """Tell the peer that it is over."""
        for _ in range(GOODBYES if self._peer is not None else 0):
            self._message[0] = self._side.told[0]
            self._message[0].tick = self._ticks
            self._ticks += 1
            self._send(ends=True)


def run_follower(
    address: tuple[str, int],
    allowed: str,
    swatch: str,
    coupling: Coupling,
    impairment: Impairment,
    duration_s: float = math.inf,
    seed: int = 0,
) -> dict[str, Any]:
    """Touch a plate for the first leader from the host `allowed`, until it ends; returns a summary.

    Raises:
        HapsceneError: an address that cannot be bound, an unknown host or swatch.
    """
    world = world_of(plate(swatch), seed=seed)  # must live as long as the follower, which refers to its memory
    side = new_follower(world, Omni(), coupling, START_M, UP)
    with _opened(address, socket.socket.bind) as sock:
        try:
            host = socket.gethostbyname(allowed)
        except OSError as reason:
            raise HapsceneError(f"{allowed}: no such host: {reason.strerror}") from None
        session = UdpSession(side, sock, impairment=impairment, seed=seed, allowed=host)
        return _run(session, f"a follower listens at {_name(sock.getsockname())}", duration_s)


def run_leader(
    address: tuple[str, int],
    grip: str,
    compensator: str,
    coupling: Coupling,
    impairment: Impairment,
    duration_s: float = math.inf,
    seed: int = 0,
) -> dict[str, Any]:
    """Feel what a follower touches, with a simulated hand that explores over and over; returns a summary.

    Raises:
        HapsceneError: nobody follows at that address; an unknown grip or compensator.
    """
    gesture = explore(grip, coupling.stiffness_N_m)
    handle = new_handle(Plant(), Plant(), compensator, ACCELERATION_RATE_HZ, seed)
    side = new_leader(Omni(), handle, coupling, START_M, UP)
    with _opened(address, socket.socket.connect) as sock:
        session = UdpSession(side, sock, gesture.intent, impairment, seed)
        return _run(session, f"a leader calls {_name(address)}", duration_s)


@contextmanager
def _opened(address: tuple[str, int], attach: Callable[[socket.socket, Any], None]) -> Iterator[socket.socket]:
    """A UDP socket that is bound or connected."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        try:
            attach(sock, address)
        except OSError as reason:
            raise HapsceneError(f"{_name(address)}: cannot be used: {reason.strerror}") from None
        yield sock


def _run(session: UdpSession, title: str, duration_s: float) -> dict[str, Any]:
    session.rehearse()
    with interrupt_noted() as noted:
        speak(f"{title}\n")
        return session.run(duration_s, noted)


def _name(address: Any) -> str:
    return f"{address[0]}:{address[1]}"
