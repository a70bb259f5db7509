"""What `hapscene teleoperate follower` and `leader` run, for a command is thin: a 1 kHz loop over UDP.

What has arrived is checked (`datagram`) and handed, with the tick, to one call of compiled code (`bilateral_loop`).
When the peer has been silent for the coupling's `timeout_s` the motors let go (`endpoint`). After `PATIENCE_S` of
silence, when the peer says that it ends, or at Ctrl-C, the session ends: the device is no longer driven, and the peer
is told.
"""

import gc
import math
import os
import socket
import time
from collections import deque
from collections.abc import Callable, Collection
from typing import Any, Final

import numpy as np

from hapscene.constants import ACCELERATION_RATE_HZ, TICK_S
from hapscene.device.omni import Omni
from hapscene.errors import HapsceneError
from hapscene.handle.handle_loop import new_handle
from hapscene.handle.plant import Plant
from hapscene.interrupt import interrupt_noted
from hapscene.records import records
from hapscene.teleoperation.bilateral_loop import step_follower, step_leader
from hapscene.teleoperation.datagram import MESSAGE, SIZE, Gate, pack
from hapscene.teleoperation.endpoint import SCHEMES, Coupling
from hapscene.teleoperation.leader_follower import Follower, Leader, new_follower, new_leader
from hapscene.teleoperation.link import Impairment, new_link
from hapscene.teleoperation.operation import UP, world_of
from hapscene.teleoperation.test_plate import START_M, explore, plate
from hapscene.touch import speak
from hapscene.twin.hand_intent import Intent

# A thousand ticks a second from a process that sleeps in between, and how late they were.


BEHIND_MAX: Final = 50
"""Most ticks that are made up for at once [count]. A process that was held up for longer has lost the time for good:
its clock moves back."""

QUANTILES: Final = {"median": 50.0, "p99": 99.0, "p99_9": 99.9, "max": 100.0}
"""What is told of times, in per cent."""

BASE_COUNT: Final = 250
"""Ticks of an empty loop by which the machine's own lateness is measured [count]."""

KEPT_COUNT: Final = 60_000
"""Ticks whose times are kept for the summary [count]: the last minute."""

_TICK_NS: Final = round(TICK_S * 1e9)


class Pace:
    """Due times of a 1 kHz loop; measures first how late an empty one is.

    Attributes:
        slipped: ticks that were lost because the process was held up [count].
    """

    def __init__(self) -> None:
        self.slipped = 0
        self._late_ns: deque[int] = deque(maxlen=KEPT_COUNT)
        self._work_ns: deque[int] = deque(maxlen=KEPT_COUNT)
        self._base_ns = self._sleep_idly()
        self._due_ns = self._woke_ns = 0

    def start(self) -> None:
        """The first tick is due a tick from now."""
        self._due_ns = self._woke_ns = time.perf_counter_ns()

    def await_tick(self) -> None:
        """Sleep until the next tick is due."""
        now_ns = time.perf_counter_ns()
        if self._late_ns:
            self._work_ns.append(now_ns - self._woke_ns)
        self._due_ns += _TICK_NS
        behind = (now_ns - self._due_ns) // _TICK_NS
        if behind > BEHIND_MAX:
            self.slipped += behind
            self._due_ns += behind * _TICK_NS
        self._woke_ns = _sleep_until(self._due_ns)
        self._late_ns.append(self._woke_ns - self._due_ns)

    def summary(self) -> dict[str, object]:
        """Lateness of the last minute and of an empty loop before it, and the time of a tick's work, in µs."""
        return {
            "late_us": _spread(self._late_ns, 1e-3, 1),
            "late_of_empty_loop_us": _spread(self._base_ns, 1e-3, 1),
            "work_us": _spread(self._work_ns, 1e-3, 1),
            "slipped_ticks": self.slipped,
        }

    @staticmethod
    def _sleep_idly() -> list[int]:
        late_ns = []
        due_ns = time.perf_counter_ns()
        for _ in range(BASE_COUNT):
            due_ns += _TICK_NS
            late_ns.append(_sleep_until(due_ns) - due_ns)
        return late_ns


def _sleep_until(due_ns: int) -> int:
    """Sleep until a time of `perf_counter_ns`; return when it woke."""
    left_ns = due_ns - time.perf_counter_ns()
    if left_ns > 0:
        time.sleep(left_ns * 1e-9)
    return time.perf_counter_ns()


def _spread(times: Collection[int], scale: float, digits: int, *names: str) -> dict[str, float]:
    """The `QUANTILES` of times, or those named, each times `scale`, to so many digits; nothing of none."""
    if not times:
        return {}
    told = names or tuple(QUANTILES)
    points = np.percentile(list(times), [QUANTILES[name] for name in told]) * scale
    return {name: round(float(time), digits) for name, time in zip(told, points, strict=True)}


PATIENCE_S: Final = 2.0
"""Silence after which a session ends [s]."""

WAIT_S: Final = 10.0
"""How long a leader calls for a follower that has not answered yet [s]."""

ARRIVAL_MAX: Final = 64
"""Most datagrams that are taken in a tick [count]. A flood beyond it is dropped by the system."""

REST_TICKS: Final = 500
"""Ticks at the end over which the speed is measured [count]."""

GOODBYES: Final = 3
"""How often the peer is told that it is over [count]: each of them may be lost."""


class UdpSession:
    """A leader or a follower, and its socket.

    Args:
        side: what the process moves.
        sock: a leader's is connected to its follower; a follower's is bound, and obeys the first leader it hears.
        intent: of the leader's hand, which it means over and over.
        impairment: how bad the line from here shall be made.
        seed: of what that draws.
        allowed: the one host that a follower listens to, as in "127.0.0.1"; None for any.
    """

    def __init__(
        self,
        side: Leader | Follower,
        sock: socket.socket,
        intent: Intent | None = None,
        impairment: Impairment | None = None,
        seed: int = 0,
        allowed: str | None = None,
    ) -> None:
        self._side, self._socket, self._allowed = side, sock, allowed
        self._hand = None if intent is None else (intent.target_W_m, intent.grip, intent.push_W_N)
        self._role = 0 if isinstance(side, Leader) else 1
        self._session = int.from_bytes(os.urandom(4), "little")
        self._peer: Any = sock.getpeername() if self._role == 0 else None
        self._link = new_link(impairment or Impairment(), TICK_S, seed, ("forth", "back")[self._role])
        self._arrived, self._leaving = records(ARRIVAL_MAX, MESSAGE), records(ARRIVAL_MAX, MESSAGE)
        self._scheme = int(side.end.port[0].wave)
        self.gate = Gate(1 - self._role, self._scheme)
        self._ticks = self._sent = self._strangers = 0
        self._trips: deque[int] = deque(maxlen=KEPT_COUNT)
        self._p_m: deque[Any] = deque(maxlen=REST_TICKS)
        self._force_max_N = self._force_in_silence_N = 0.0
        sock.setblocking(False)

    def rehearse(self) -> None:
        """The first tick, which nobody hears: compiles, so that the next is in time. `run` does it where need be."""
        if self._ticks == 0:
            self._advance(0)
            self._pace = Pace()

    def run(self, duration_s: float, stopped: Callable[[], bool] = lambda: False) -> dict[str, Any]:
        """Run until `duration_s` have passed since the peer was first heard, it is gone, or `stopped`.

        Returns:
            how it went: why it ended, the datagrams by what became of them, times, forces.

        Raises:
            HapsceneError: a leader heard nobody within `WAIT_S`; the peer is tied by another scheme.
        """
        self.rehearse()
        self._pace.start()
        collecting = gc.isenabled()
        gc.disable()  # a collection takes several ticks
        try:
            reason = self._loop(duration_s / TICK_S, stopped)
        finally:
            if collecting:
                gc.enable()
            self._say_goodbye()
        return {"ended": reason, **self._summary(), **self._pace.summary()}

    def _loop(self, tick_count: float, stopped: Callable[[], bool]) -> str:
        """Tick until something ends it; returns what."""
        silent, heard_since = 0, 0
        while True:
            self._pace.await_tick()
            count = self._receive()
            self._step(count)
            silent = 0 if count else silent + 1
            heard_since += 1 if self.gate.session is not None else 0
            if self.gate.mismatched:
                raise HapsceneError(
                    f"the peer is not tied by {SCHEMES[self._scheme]!r}: start both ends with the same --scheme"
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
                    f"no follower answers at {_name(self._peer)}; start one there: hapscene teleoperate follower"
                )

    def _receive(self) -> int:
        """Take in what has arrived; returns how many messages were let in."""
        count = 0
        for _ in range(ARRIVAL_MAX):
            try:
                data, address = self._socket.recvfrom(SIZE + 1)
            except BlockingIOError:
                break
            except OSError:  # the peer's port is not open yet, or no longer; the network is down
                continue
            if not self._is_peer(address):
                self._strangers += 1
            elif self.gate.admit(data, self._arrived[count]):
                self._peer = address
                count += 1
        return count

    def _is_peer(self, address: Any) -> bool:
        if self._peer is not None:
            return bool(address == self._peer)
        return self._allowed is None or address[0] == self._allowed

    def _step(self, count: int) -> None:
        """One tick, and what the line lets out of it. A follower that nobody leads yet does not tick."""
        if self._role == 1 and self.gate.session is None:
            return
        self._trips += [self._ticks - int(m.echo) for m in self._arrived[:count] if m.echo >= 0]
        for i in range(self._advance(count)):
            self._send(pack(self._leaving[i], self._role, self._session, self._scheme))
        port = self._side.end.port[0]
        force_N = float(np.linalg.norm(port.f_N))
        self._force_max_N = max(force_N, self._force_max_N)
        self._p_m.append(port.x_m.copy())
        if port.silent_ticks > port.timeout_ticks:
            self._force_in_silence_N = max(force_N, self._force_in_silence_N)

    def _advance(self, count: int) -> int:
        """One tick in compiled code; returns how many messages the line has let out."""
        now, self._ticks = self._ticks, self._ticks + 1
        if self._hand is not None:
            row = now % len(self._hand[0])
            return int(step_leader(self._side, self._hand, row, self._link, now, self._arrived, count, self._leaving))
        return int(step_follower(self._side, self._link, now, self._arrived, count, self._leaving))

    def _send(self, data: bytes) -> None:
        try:
            self._socket.sendto(data, self._peer) if self._role == 1 else self._socket.send(data)
            self._sent += 1
        except OSError:  # a full buffer, a closed port, no network: lost, as anywhere on the way
            pass

    def _say_goodbye(self) -> None:
        """Tell the peer that it is over."""
        if self._peer is None:
            return
        for _ in range(GOODBYES):
            self._side.told[0].tick = self._ticks
            self._ticks += 1
            self._send(pack(self._side.told[0], self._role, self._session, self._scheme, ends=True))

    def _summary(self) -> dict[str, Any]:
        port, queue = self._side.end.port[0], self._side.end.queue[0]
        last = np.array(self._p_m)
        speed_m_s = np.linalg.norm(np.diff(last, axis=0), axis=1) / TICK_S if len(last) > 1 else np.zeros(1)
        return {
            "role": ("leader", "follower")[self._role],
            "ticks": self._ticks,
            "sent": self._sent,
            "heard": {**self.gate.counts, "from strangers": self._strangers, "overtaken": int(port.overtaken)},
            "lost_by_impairment": int(self._link.line[0].lost),
            "round_trip_ms": _spread(self._trips, TICK_S * 1e3, 3, "median", "p99", "max"),
            "queue_ms": round(int(queue.waited_ticks) / max(int(queue.stored), 1) * TICK_S * 1e3, 3),
            "force_max_N": self._force_max_N,
            "force_in_silence_N": self._force_in_silence_N,
            "speed_at_the_end_mm_s": float(np.sqrt((speed_m_s**2).mean()) * 1e3),
            "work_of_motors_mJ": float(port.work_J) * 1e3,
        }


def _name(address: Any) -> str:
    return f"{address[0]}:{address[1]}"


# Follower and leader as processes of their own: a socket, a side, a session.


def run_follower(
    address: tuple[str, int],
    allowed: str,
    swatch: str,
    coupling: Coupling,
    impairment: Impairment,
    duration_s: float = math.inf,
    seed: int = 0,
) -> dict[str, Any]:
    """Touch a plate for the first leader that speaks from the host `allowed`, until it ends; returns how it went.

    Says where it listens in one line on standard output, once it is ready.

    Raises:
        HapsceneError: an address that cannot be listened at, an unknown swatch.
    """
    world = world_of(plate(swatch), seed=seed)  # owns what the follower's compiled tick looks into
    side = new_follower(world, Omni(), coupling, START_M, UP)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        try:
            sock.bind(address)
        except OSError as reason:
            raise HapsceneError(f"{_name(address)}: cannot be listened at: {reason.strerror}") from None
        session = UdpSession(side, sock, impairment=impairment, seed=seed, allowed=_resolved(allowed))
        session.rehearse()
        with interrupt_noted() as noted:
            speak(f"a follower listens at {_name(sock.getsockname())}\n")
            return session.run(duration_s, noted)


def run_leader(
    address: tuple[str, int],
    grip: str,
    compensator: str,
    coupling: Coupling,
    impairment: Impairment,
    duration_s: float = math.inf,
    seed: int = 0,
) -> dict[str, Any]:
    """Feel what a follower touches, with a simulated hand that explores over and over; returns how it went.

    Raises:
        HapsceneError: nobody follows at that address; an unknown grip or compensator.
    """
    gesture = explore(grip, coupling.stiffness_N_m)
    handle = new_handle(Plant(), Plant(), compensator, ACCELERATION_RATE_HZ, seed)
    side = new_leader(Omni(), handle, coupling, START_M, UP)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        try:
            sock.connect(address)
        except OSError as reason:
            raise HapsceneError(f"{_name(address)}: cannot be reached: {reason.strerror}") from None
        session = UdpSession(side, sock, gesture.intent, impairment, seed)
        session.rehearse()
        with interrupt_noted() as noted:
            speak(f"a leader calls {_name(address)}\n")
            return session.run(duration_s, noted)


def _resolved(host: str) -> str:
    """The address of a host."""
    try:
        return socket.gethostbyname(host)
    except OSError as reason:
        raise HapsceneError(f"{host}: no such host: {reason.strerror}") from None
