"""Leader and follower as two processes that run the 1 kHz bilateral loop over UDP.

The filter of `datagram` checks received datagrams before they reach the endpoint. When the peer is silent for the
`timeout_s` of the coupling, the motor force becomes zero. The session ends after `SILENCE_MAX_S` of silence, with the
peer, or on Ctrl-C; then the peer receives a last message.
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
from hapscene.handle.handle_record import new_handle
from hapscene.handle.plant import Plant
from hapscene.interrupt import interrupt_noted
from hapscene.loop.reference_trajectory import ReferenceTrajectory
from hapscene.records import Record, records
from hapscene.teleoperation.datagram import DATAGRAM, MESSAGE, DatagramFilter, pack
from hapscene.teleoperation.endpoint import ROLES, SCHEMES, Coupling, new_endpoint, receive_message
from hapscene.teleoperation.leader_follower import (
    Follower,
    Leader,
    new_follower,
    new_leader,
    step_follower,
    step_leader,
)
from hapscene.teleoperation.operation import UP, follower_renderer
from hapscene.teleoperation.plate import START_M, explore, plate
from hapscene.touch import speak

__all__ = ["TickTimer", "UdpSession", "run_follower", "run_leader"]

BEHIND_MAX: Final = 50
"""Most delayed ticks that the loop catches up with [count]. After a longer interruption it skips the rest."""

KEPT_COUNT: Final = 60_000
"""Ticks whose latencies are kept for the summary [count]: the last minute."""

SILENCE_MAX_S: Final = 2.0
"""Time without messages after which a session ends [s]."""

CONNECT_S: Final = 10.0
"""Time for which a leader waits for the first answer of the follower [s]."""

RECEIVED_MAX: Final = 64
"""Most datagrams that are read in a tick [count]. The operating system drops the excess of a flood."""

END_MESSAGES: Final = 3
"""Number of last messages to the peer [count]; more than one, since each may be lost."""

_TICK_NS: Final = round(TICK_S * 1e9)


class TickTimer:
    """Timer of a 1 kHz loop.

    Attributes:
        skipped: ticks that were skipped after interruptions of the process [count].
        latency_ns: wake-up latencies of the last ticks.
    """

    def __init__(self) -> None:
        self.skipped = 0
        self.latency_ns: deque[int] = deque(maxlen=KEPT_COUNT)
        self._due_ns = time.perf_counter_ns()

    def await_tick(self) -> None:
        """Sleep until the next tick is due."""
        self._due_ns += _TICK_NS
        left_ns = self._due_ns - time.perf_counter_ns()
        if left_ns < -BEHIND_MAX * _TICK_NS:
            self.skipped += -left_ns // _TICK_NS
            self._due_ns += -left_ns // _TICK_NS * _TICK_NS
        elif left_ns > 0:
            time.sleep(left_ns * 1e-9)
        self.latency_ns.append(time.perf_counter_ns() - self._due_ns)


def _quantiles(values: Collection[int], scale: float) -> dict[str, float]:
    """Quantiles of values, multiplied by `scale`; empty if there are no values."""
    shares = {"median": 50.0, "p99": 99.0, "max": 100.0}
    return {n: round(float(np.percentile(list(values), q)) * scale, 3) for n, q in shares.items()} if values else {}


class UdpSession:
    """A leader or a follower that communicates with its peer over a socket.

    Args:
        side: the device of this process.
        sock: of a leader, connected to its follower; of a follower, bound. A follower accepts the first leader.
        intent: reference trajectory of the leader's hand, which repeats; None for a follower.
        allowed: the only host from which a follower accepts datagrams, as in "127.0.0.1"; None for any.
    """

    def __init__(
        self,
        side: Leader | Follower,
        sock: socket.socket,
        intent: ReferenceTrajectory | None = None,
        allowed: str | None = None,
    ) -> None:
        self._side, self._socket, self._allowed = side, sock, allowed
        self._hand = None if intent is None else (intent.target_W_m, intent.grip, intent.push_W_N)
        self._role = 0 if intent is not None else 1
        self._peer: tuple[str, int] | None = sock.getpeername() if self._role == 0 else None
        self._session = int.from_bytes(os.urandom(4), "little")
        self._message = records(1, MESSAGE)
        self._scheme = int(side.end.state[0].wave)
        self.filter = DatagramFilter(1 - self._role, self._scheme)
        self._ticks = self._sent = self._unknown_senders = 0
        self._round_trips: deque[int] = deque(maxlen=KEPT_COUNT)
        self._force_max_N = self._force_in_silence_N = 0.0
        sock.setblocking(False)

    def run(self, duration_s: float, stopped: Callable[[], bool] = lambda: False) -> dict[str, Any]:
        """Run for `duration_s` after the first message of the peer, or until the peer or `stopped` ends the session.

        Returns:
            a summary: reason of the end, datagrams by result, latencies, forces.

        Raises:
            HapsceneError: a leader received nothing within `CONNECT_S`, or the peer uses another scheme.
        """
        if self._ticks == 0:
            self.compile_first_tick()
        collecting = gc.isenabled()
        gc.disable()  # a garbage collection takes several ticks
        timer = TickTimer()
        try:
            reason = self._loop(timer, duration_s / TICK_S, stopped)
        finally:
            if collecting:
                gc.enable()
            self._send_end()
        state = self._side.end.state[0]
        return {
            "ended": reason,
            "role": ROLES[self._role],
            "ticks": self._ticks,
            "sent": self._sent,
            "received": {
                **self.filter.counts,
                "unknown sender": self._unknown_senders,
                "overtaken": int(state.overtaken),
            },
            "round_trip_ms": _quantiles(self._round_trips, TICK_S * 1e3),
            "force_max_N": self._force_max_N,
            "force_in_silence_N": self._force_in_silence_N,
            "work_of_motors_mJ": float(state.work_J) * 1e3,
            "latency_us": _quantiles(timer.latency_ns, 1e-3),
            "skipped_ticks": timer.skipped,
        }

    def compile_first_tick(self) -> None:
        """Run the first tick without sending, so that compilation does not delay the loop."""
        peer, self._peer = self._peer, None
        self._advance()
        self._peer = peer
        end = new_endpoint(Coupling(SCHEMES[self._scheme]), ROLES[self._role], TICK_S)
        receive_message(end, 0, self._side.outgoing[0])

    def _loop(self, timer: TickTimer, tick_count: float, stopped: Callable[[], bool]) -> str:
        """Run ticks until the session ends; return the reason."""
        silent, connected_ticks = 0, 0
        while True:
            timer.await_tick()
            silent = 0 if self._receive() else silent + 1
            if self._role == 0 or self.filter.session is not None:  # a follower without a leader does not run
                self._advance()
            connected_ticks += 1 if self.filter.session is not None else 0
            if self.filter.mismatched:
                raise HapsceneError(
                    f"the peer does not use the scheme {SCHEMES[self._scheme]!r}; start both with the same --scheme"
                )
            if self.filter.ended:
                return "ended by the peer"
            if stopped():
                return "stopped"
            if connected_ticks >= tick_count:
                return "duration reached"
            if self.filter.session is not None and silent * TICK_S > SILENCE_MAX_S:
                return f"no message from the peer for {SILENCE_MAX_S:g} s"
            if self.filter.session is None and self._role == 0 and silent * TICK_S > CONNECT_S:
                raise HapsceneError(
                    f"no follower answers at {_name(self._socket.getpeername())}; start one there: "
                    "hapscene lab teleoperate follower"
                )

    def _receive(self) -> bool:
        """Pass received datagrams to the endpoint; return whether one was valid."""
        received = False
        for _ in range(RECEIVED_MAX):
            try:
                data, address = self._socket.recvfrom(DATAGRAM.itemsize + 1)
            except BlockingIOError:
                break
            except OSError:  # the port of the peer is closed, or the network is down
                continue
            known = address == self._peer if self._peer is not None else self._allowed in (None, address[0])
            message = self._message[0]
            if not known:
                self._unknown_senders += 1
            elif self.filter.accept(data, message):
                self._peer, received = address, True
                receive_message(self._side.end, self._ticks, message)
                if message.echo >= 0:
                    self._round_trips.append(self._ticks - int(message.echo))
        return received

    def _advance(self) -> None:
        """Run one tick, and send its message."""
        now, self._ticks = self._ticks, self._ticks + 1
        if isinstance(self._side, Leader) and self._hand is not None:
            step_leader(self._side, self._hand, now % len(self._hand[0]), now)
        elif isinstance(self._side, Follower):
            step_follower(self._side, now)
        self._send(self._side.outgoing[0])
        state = self._side.end.state[0]
        force_N = float(np.linalg.norm(state.f_N))
        self._force_max_N = max(force_N, self._force_max_N)
        if state.silent_ticks > state.timeout_ticks:
            self._force_in_silence_N = max(force_N, self._force_in_silence_N)

    def _send(self, message: Record, ends: bool = False) -> None:
        if self._peer is None:
            return
        data = pack(message, self._role, self._session, self._scheme, ends)
        try:
            self._socket.sendto(data, self._peer) if self._role == 1 else self._socket.send(data)
            self._sent += 1
        except OSError:  # a full buffer, a closed port or no network: the message counts as lost
            pass

    def _send_end(self) -> None:
        """Tell the peer that the session is over."""
        message = self._side.outgoing[0].copy()
        for _ in range(END_MESSAGES):
            message["tick"] = self._ticks
            self._ticks += 1
            self._send(message, ends=True)


def run_follower(
    address: tuple[str, int],
    allowed: str,
    swatch: str,
    coupling: Coupling,
    duration_s: float = math.inf,
    seed: int = 0,
) -> dict[str, Any]:
    """Run a follower on a plate for the first leader from the host `allowed`; return a summary.

    Raises:
        HapsceneError: an address that cannot be bound, an unknown host or swatch.
    """
    renderer = follower_renderer(plate(swatch), seed=seed)  # must outlive the follower, which refers to its memory
    side = new_follower(renderer, Omni(), coupling, START_M, UP)
    with _opened(address, socket.socket.bind) as sock:
        try:
            host = socket.gethostbyname(allowed)
        except OSError as reason:
            raise HapsceneError(f"{allowed}: host not found: {reason.strerror}") from None
        session = UdpSession(side, sock, allowed=host)
        return _run(session, f"follower listening at {_name(sock.getsockname())}", duration_s)


def run_leader(
    address: tuple[str, int],
    grip: str,
    compensator: str,
    coupling: Coupling,
    duration_s: float = math.inf,
    seed: int = 0,
) -> dict[str, Any]:
    """Run a leader in a simulated hand that explores the plate repeatedly; return a summary.

    Raises:
        HapsceneError: no follower answers at the address; an unknown grip or compensator.
    """
    gesture = explore(grip, coupling.stiffness_N_m)
    handle = new_handle(Plant(), Plant(), compensator, ACCELERATION_RATE_HZ, seed)
    side = new_leader(Omni(), handle, coupling, START_M, UP)
    with _opened(address, socket.socket.connect) as sock:
        return _run(UdpSession(side, sock, gesture.intent), f"leader connecting to {_name(address)}", duration_s)


@contextmanager
def _opened(
    address: tuple[str, int], attach: Callable[[socket.socket, tuple[str, int]], None]
) -> Iterator[socket.socket]:
    """A UDP socket that is bound or connected."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        try:
            attach(sock, address)
        except OSError as reason:
            raise HapsceneError(f"{_name(address)}: address cannot be used: {reason.strerror}") from None
        yield sock


def _run(session: UdpSession, title: str, duration_s: float) -> dict[str, Any]:
    session.compile_first_tick()
    with interrupt_noted() as noted:
        speak(f"{title}\n")
        return session.run(duration_s, noted)


def _name(address: tuple[str, int]) -> str:
    return f"{address[0]}:{address[1]}"
