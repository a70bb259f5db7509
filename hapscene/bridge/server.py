"""A servo behind a socket: what a game engine or simulator says by UDP, and what it is told. One client at a time."""

import secrets
import select
import socket
import time
from collections import Counter, deque
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.bridge.conventions import Convention
from hapscene.bridge.packets import (
    ANSWER,
    BYE,
    EVENTS_MAX,
    FRAME,
    HELLO,
    ORDER,
    REFUSED,
    SIZE_MAX,
    STATE,
    VERSION,
    WELCOME,
    Event,
    Frame,
    Packet,
    PacketError,
    State,
    pack,
    pack_json,
    pack_state,
    unpack,
    unpack_frame,
    unpack_json,
)
from hapscene.constants import DEFAULT_GRIP
from hapscene.contact_info import Impulse
from hapscene.errors import HapsceneError
from hapscene.geometry import numbers
from hapscene.servo.servo import Servo

SILENT_S: Final = 2.0
"""How long a client may be silent before another one may come [s]."""

EVENT_COUNT: Final = 4096
"""Events that wait for a client to get them [count]; of more the oldest are lost, which their numbers tell."""

ANSWER_COUNT: Final = 64
"""Answers that are kept for orders that come again [count]."""

NAP_S: Final = 0.2
"""How often it is looked whether to end [s]."""

FLOOD: Final = 1000
"""Packets that are answered before it is looked again whether to end [count]."""

KINDS: Final = {"began": 1, "crossed": 2, "ended": 3}

Address = tuple[str, int]


class _Session(NamedTuple):
    """What belongs to one client."""

    key: int
    nonce: Any
    address: Address
    frame: Convention
    welcome: bytes
    events: deque[Event]
    answers: dict[int, bytes]


class BridgeServer:
    """Answers the datagrams of one client; moves bodies of a servo that runs, and tells what the tool does to them.

    Whatever is no packet, is of another session, or came before, changes nothing and is counted.

    Args:
        servo: entered.
        body_names, swatch_names: of its scene.
        host, port: where to listen; port 0 for any that is free.

    Attributes:
        address: where it listens.
        counts: packets by what became of them.

    Raises:
        HapsceneError: the port is taken, the host not ours; more names than a packet takes.
    """

    def __init__(
        self, servo: Servo, body_names: tuple[str, ...], swatch_names: tuple[str, ...], host: str, port: int
    ) -> None:
        self.servo, self.body_names, self.swatch_names = servo, body_names, swatch_names
        self.counts: Counter[str] = Counter()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            another = f"cannot listen at {host}:{port}: {error.strerror}; say another --udp port or --host"
            raise HapsceneError(another) from None
        self._socket.setblocking(False)
        self._welcome = pack_json(
            {"version": VERSION, "bodies": body_names, "swatches": swatch_names, "tick_s": servo.tick_s}
        )
        try:
            pack(Packet(WELCOME, 0, 0, self._welcome))
        except PacketError:
            self._socket.close()
            raise HapsceneError(
                f"the names of {len(body_names):,} bodies and {len(swatch_names):,} swatches take "
                f"{len(self._welcome):,} bytes, and a packet holds {SIZE_MAX:,}; give them shorter names"
            ) from None
        self.address: Address = self._socket.getsockname()
        self._session: _Session | None = None
        self._freed: set[str] = set()
        self._forget()

    def _forget(self) -> None:
        """Nothing is known of a client yet."""
        self._heard_s = 0.0
        self._last = self._last_order = self._first_event = 0
        self._events_from = 0
        self._grip = DEFAULT_GRIP
        self._before = np.zeros((len(self.body_names), 6))

    def __enter__(self) -> "BridgeServer":
        return self

    def __exit__(self, *error: object) -> None:
        self._socket.close()

    def serve(self, over: Callable[[], bool]) -> None:
        """Answer until it is over."""
        while not over():
            if select.select([self._socket], [], [], NAP_S)[0]:
                self.answer_all()

    def answer_all(self) -> None:
        """Answer all that has come; of a flood, some at a time."""
        for _ in range(FLOOD):
            try:
                data, address = self._socket.recvfrom(SIZE_MAX + 1)
            except BlockingIOError:
                return
            except OSError:  # an answer that could not be delivered is told here, on some systems
                continue
            try:
                answer = self._answer(unpack(data), address)
            except PacketError:
                self.counts["bad"] += 1
                continue
            if answer is not None:
                try:
                    self._socket.sendto(answer, address)
                except OSError:
                    self.counts["unsent"] += 1

    def _answer(self, packet: Packet, address: Address) -> bytes | None:
        """What is sent back.

        Raises:
            PacketError: a payload that is none.
        """
        if packet.kind == HELLO:
            return self._greet(packet, address)
        session = self._session
        if session is None or (packet.key, address) != (session.key, session.address):
            self.counts["forged"] += 1
            return None
        self._heard_s = time.monotonic()
        if packet.kind == FRAME:
            return self._take_frame(session, packet)
        if packet.kind == ORDER:
            return self._take_order(session, packet)
        if packet.kind == BYE:
            self._session = None
            self.counts["bye"] += 1
            return None
        raise PacketError("a kind that servers send")

    def _greet(self, packet: Packet, address: Address) -> bytes:
        hello = unpack_json(packet.payload)
        session = self._session
        if session is not None and (session.nonce, session.address) == (hello.get("nonce"), address):
            return session.welcome  # the first was lost on its way
        if session is not None and time.monotonic() - self._heard_s < SILENT_S:
            self.counts["busy"] += 1
            return self._refuse(packet, "another client is here")
        if hello.get("version") != VERSION:
            return self._refuse(packet, f"version {VERSION} is spoken here")
        try:
            frame = Convention.of(hello)
        except PacketError as error:
            return self._refuse(packet, str(error))
        key = secrets.randbits(64) or 1
        welcome = pack(Packet(WELCOME, key, packet.sequence, self._welcome))
        self._forget()
        self._events_from = self.servo.state().tick + 1
        self._before = -self._given()  # totals are of the session
        for name in self._freed:
            self.servo.free(name, np.inf, inertia_B_kg_m2=(1.0, 1.0, 1.0))
        self._freed.clear()
        self._session = _Session(key, hello.get("nonce"), address, frame, welcome, deque(maxlen=EVENT_COUNT), {})
        self._heard_s = time.monotonic()
        self.counts["hello"] += 1
        return welcome

    def _given(self) -> NDArray[np.float64]:
        """What the tool has given the bodies since the servo started (b, 6)."""
        return np.array([np.concatenate(self.servo.impulse(name)) for name in self.body_names])

    @staticmethod
    def _refuse(packet: Packet, why: str) -> bytes:
        return pack(Packet(REFUSED, 0, packet.sequence, pack_json({"error": why})))

    # --- frames

    def _take_frame(self, session: _Session, packet: Packet) -> bytes | None:
        """Move what moves; tell the newest tick."""
        frame = unpack_frame(packet.payload)
        if any(body.body >= len(self.body_names) for body in frame.bodies):
            raise PacketError("no such body")
        if packet.sequence <= self._last:
            self.counts["replayed"] += 1
            return None
        self._last = packet.sequence
        self.counts["frames"] += 1
        for body in frame.bodies:
            self._move(session.frame, body)
        if frame.aim is not None:
            try:
                self.servo.aim(session.frame.place(frame.aim), self._grip)
            except HapsceneError:
                self.counts["bad"] += 1
        return pack(Packet(STATE, session.key, packet.sequence, pack_state(self._state(session, frame))))

    def _move(self, frame: Convention, body: Any) -> None:
        seen, before = np.array(body.seen), self._before[body.body]
        moving = {}
        if body.v is not None:
            moving = {"v_W_m_s": frame.place(body.v), "w_W_rad_s": frame.turning(body.w)}
        try:
            self.servo.move(
                self.body_names[body.body],
                frame.pose(body.p, body.q),
                seen=Impulse(frame.force(seen[:3]) - before[:3], frame.turning(seen[3:]) - before[3:]),
                teleport=body.teleport,
                **moving,
            )
        except HapsceneError:
            if not self.servo.alive:
                raise
            self.counts["bad"] += 1

    def _state(self, session: _Session, frame: Frame) -> State:
        to, state = session.frame, self.servo.state()
        found, self._events_from = self.servo.events(self._events_from)
        for event in found:
            if len(session.events) == EVENT_COUNT:
                self._first_event += 1
            index, swatch = self.body_names.index(event.body), self.swatch_names.index(event.swatch)
            speed = event.approach_m_s / to.metre
            session.events.append(Event(event.tick, KINDS[event.kind], index, swatch, speed))
        while session.events and self._first_event < frame.event_count:
            session.events.popleft()
            self._first_event += 1
        impulses = []
        for body in frame.bodies:
            total = np.concatenate(self.servo.impulse(self.body_names[body.body])) + self._before[body.body]
            linear, angular = total[:3], total[3:]
            impulses.append((body.body, (*to.told_force(linear), *to.told_turning(angular))))
        return State(
            max(state.tick, 0),
            state.age_s if state.tick >= 0 else 0.0,
            to.told_place(state.p_WT_m),
            to.told_place(state.p_WP_m),
            to.told_force(state.nhat_W),
            to.told_force(state.f_W_N),
            state.depth_m / to.metre,
            state.slip_m_s / to.metre,
            state.body,
            state.face,
            state.swatch,
            int(state.flags),
            self._first_event,
            tuple(impulses),
            tuple(session.events)[:EVENTS_MAX],
        )

    # --- orders

    def _take_order(self, session: _Session, packet: Packet) -> bytes | None:
        """Do what is asked once, however often it comes."""
        if packet.sequence in session.answers:
            return session.answers[packet.sequence]
        if packet.sequence <= self._last_order:
            self.counts["replayed"] += 1
            return None
        order = unpack_json(packet.payload)
        try:
            told = self._do(session.frame, order)
        except HapsceneError as error:
            if not self.servo.alive:
                raise
            told = {"error": f"{error!s:.1000}"}
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            told = {"error": f"order {order.get('order')!r:.40} lacks something, or has it wrong: {error!s:.100}"}
        self._last_order = packet.sequence
        self.counts["orders"] += 1
        answer = pack(Packet(ANSWER, session.key, packet.sequence, pack_json(told)))
        session.answers[packet.sequence] = answer
        if len(session.answers) > ANSWER_COUNT:
            del session.answers[min(session.answers)]
        return answer

    def _do(self, frame: Convention, order: dict[str, Any]) -> dict[str, Any]:
        name = order["order"]
        if name == "start":
            grip, given = str(order.get("grip", DEFAULT_GRIP)), self._given()
            self.servo.start(frame.place(order["p"]), grip)
            self._grip = grip
            self._before += given  # the servo begins at 0 again, the session's totals go on
        elif name in ("pause", "resume"):
            getattr(self.servo, name)()
        elif name == "tune":
            self.servo.tune(str(order["swatch"]), **{str(k): float(v) for k, v in order["numbers"].items()})
        elif name == "free":
            mass_kg, com = float(order["mass"]), frame.place(order.get("com", (0.0, 0.0, 0.0)))
            inertia = frame.inertia(numbers(order["inertia"]))
            self.servo.free(str(order["body"]), mass_kg, inertia_B_kg_m2=inertia, com_B_m=com)
            self._freed.add(str(order["body"]))
        elif name == "counts":
            return {"done": name, "counts": dict(self.counts)}
        else:
            raise HapsceneError(f"no order {name!r:.40}; there are: start, pause, resume, tune, free, counts")
        return {"done": name}
