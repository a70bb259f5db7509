"""A servo behind a socket: what a game engine or simulator says by UDP, and what it is told. One client at a time."""

import math
import secrets
import select
import socket
from collections import deque
from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import Future
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np

from hapscene.bridge.conventions import Convention
from hapscene.bridge.orders import Orders
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
from hapscene.errors import HapsceneError
from hapscene.render.contact_info import Impulse
from hapscene.wall_clock import CLOCK, Clock

__all__ = ["FLOOD", "SILENT_S", "Answer", "BridgeServer"]

SILENT_S: Final = 2.0
"""How long a client may be silent before another one may come [s]."""

EVENT_COUNT: Final = 4096
"""Events that wait for a client to get them [count]; of more the oldest are lost, which their numbers tell."""

ANSWER_COUNT: Final = 64
"""Answers that are kept for orders that come again, and orders that wait [count]."""

NAP_S: Final = 0.2
"""How often it is looked whether to end [s]."""

FLOOD: Final = 1000
"""Packets that are answered before it is looked again whether to end [count]."""

KINDS: Final = {"began": 1, "crossed": 2, "ended": 3}

Answer = bytes | Future[bytes] | None
"""What goes back: at once, when an order is done, or nothing."""


class _Session(NamedTuple):
    """What belongs to one client."""

    key: int
    nonce: Any
    address: Hashable
    frame: Convention
    welcome: bytes
    events: deque[Event]
    answers: dict[int, bytes | None]  # None: it is not done yet
    known: list[int]  # how many bodies and swatches it has been told of


class BridgeServer:
    """Answers the datagrams of one client; moves bodies of a servo that runs, and tells what the tool does to them.

    Whatever is no packet, is of another session, or came before, changes nothing and is counted.

    Args:
        orders: of a servo, which is entered before the first packet is answered.
        host, port: where to listen; port 0 for any that is free.
        clock: measures how long a client is silent.

    Attributes:
        address: where it listens.

    Raises:
        HapsceneError: the port is taken, the host not ours; more names than a packet takes.
    """

    def __init__(self, orders: Orders, host: str, port: int, clock: Clock = CLOCK) -> None:
        self._clock = clock
        self.orders, self.servo, self.counts = orders, orders.servo, orders.counts
        self._welcome(0, 0)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            another = f"cannot listen at {host}:{port}: {error.strerror}; say another --udp port or --host"
            raise HapsceneError(another) from None
        self._socket.setblocking(False)
        self.address: tuple[str, int] = self._socket.getsockname()
        self._session: _Session | None = None
        self._forget()

    def _welcome(self, key: int, sequence: int) -> bytes:
        payload = pack_json(self.orders.welcome())
        try:
            return pack(Packet(WELCOME, key, sequence, payload))
        except PacketError:
            scene = self.servo.scene
            raise HapsceneError(
                f"the names of {len(scene.bodies):,} bodies and {len(scene.swatches):,} swatches take "
                f"{len(payload):,} bytes, and a packet holds {SIZE_MAX:,}; give them shorter names"
            ) from None

    def _forget(self) -> None:
        """Nothing is known of a client yet."""
        self._heard_s = -math.inf
        self._last = self._last_order = self._first_event = 0
        self._events_from = 0

    def __enter__(self) -> "BridgeServer":
        return self

    def __exit__(self, *error: object) -> None:
        self._socket.close()

    def serve(self, over: Callable[[], bool]) -> None:
        """Answer until it is over.

        Raises:
            HapsceneError: the servo has ended.
        """
        while not over():
            if select.select([self._socket], [], [], NAP_S)[0]:
                self.answer_all()
            else:
                self.servo.state()  # raises where it has ended

    def answer_all(self) -> None:
        """Answer all that has come; of a flood, some at a time."""
        for _ in range(FLOOD):
            try:
                data, address = self._socket.recvfrom(SIZE_MAX + 1)
            except BlockingIOError:
                return
            except OSError:  # an answer that could not be delivered is told here, on some systems
                continue
            answer = self.answer(data, address)
            if isinstance(answer, Future):
                answer.add_done_callback(partial(self._send_done, address))
            elif answer is not None:
                self._send(address, answer)

    def _send_done(self, address: tuple[str, int], done: Future[bytes]) -> None:
        if not done.cancelled():
            self._send(address, done.result())

    def _send(self, address: tuple[str, int], answer: bytes) -> None:
        try:
            self._socket.sendto(answer, address)
        except OSError:
            self.counts["unsent"] += 1

    def answer(self, data: bytes, address: Hashable) -> Answer:
        """What goes back for a packet from anywhere, also from another thread."""
        with self.orders.moment:
            try:
                return self._answer(unpack(data), address)
            except PacketError:
                self.counts["bad"] += 1
                return None

    def _answer(self, packet: Packet, address: Hashable) -> Answer:
        """What is sent back.

        Raises:
            PacketError: an invalid payload.
        """
        if packet.kind == HELLO:
            return self._greet(packet, address)
        session = self._session
        if session is None or (packet.key, address) != (session.key, session.address):
            self.counts["forged"] += 1
            return self._refuse(packet, "no such session") if packet.kind in (FRAME, ORDER) else None
        self._heard_s = self._clock.now_s()
        if packet.kind == FRAME:
            return self._take_frame(session, packet)
        if packet.kind == ORDER:
            return self._take_order(session, packet)
        if packet.kind == BYE:
            self._session = None
            self.counts["bye"] += 1
            return None
        raise PacketError("a kind that servers send")

    def _greet(self, packet: Packet, address: Hashable) -> bytes:
        hello = unpack_json(packet.payload)
        session = self._session
        if session is not None and (session.nonce, session.address) == (hello.get("nonce"), address):
            return session.welcome  # the first was lost on its way
        if session is not None and self._clock.now_s() - self._heard_s < SILENT_S:
            self.counts["busy"] += 1
            return self._refuse(packet, "another client is here")
        if hello.get("version") != VERSION:
            return self._refuse(packet, f"version {VERSION} is spoken here")
        key = secrets.randbits(64) or 1
        try:
            frame, welcome = Convention.of(hello), self._welcome(key, packet.sequence)
        except HapsceneError as error:
            return self._refuse(packet, str(error))
        self._forget()
        self._events_from = self.servo.state().tick + 1
        self.orders.before[:] = -self.orders.given()  # totals are of the session
        self.orders.fix_all()
        known = [len(self.servo.scene.bodies), len(self.servo.scene.swatches)]
        self._session = _Session(key, hello.get("nonce"), address, frame, welcome, deque(maxlen=EVENT_COUNT), {}, known)
        self._heard_s = self._clock.now_s()
        self.counts["hello"] += 1
        return welcome

    @staticmethod
    def _refuse(packet: Packet, why: str) -> bytes:
        return pack(Packet(REFUSED, 0, packet.sequence, pack_json({"error": why})))

    # --- frames

    def _take_frame(self, session: _Session, packet: Packet) -> bytes | None:
        """Move what moves; tell the newest tick."""
        frame = unpack_frame(packet.payload)
        if any(body.body >= len(self.servo.scene.bodies) for body in frame.bodies):
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
                self.servo.aim(session.frame.place(frame.aim), self.orders.grip)
            except HapsceneError:
                self.counts["bad"] += 1
        return pack(Packet(STATE, session.key, packet.sequence, pack_state(self._state(session, frame))))

    def _move(self, frame: Convention, body: Any) -> None:
        name = self.orders.names.get(body.body)
        if name is None:
            self.counts["removed"] += 1
            return
        seen, before = np.array(body.seen), self.orders.before[body.body]
        moving = {}
        if body.v is not None:
            moving = {"v_W_m_s": frame.place(body.v), "w_W_rad_s": frame.turning(body.w)}
        try:
            self.servo.move(
                name,
                frame.pose(body.p, body.q),
                applied=Impulse(frame.force(seen[:3]) - before[:3], frame.turning(seen[3:]) - before[3:]),
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
            index = _last(self.servo.body_names, event.body)
            swatch = _last([swatch.name for swatch in self.servo.scene.swatches], event.swatch)
            if index >= session.known[0] or swatch >= session.known[1]:
                continue  # clients look their numbers up
            if len(session.events) == EVENT_COUNT:
                self._first_event += 1
            speed = event.approach_m_s / to.metre
            session.events.append(Event(event.tick, KINDS[event.kind], index, swatch, speed))
        while session.events and self._first_event < frame.event_count:
            session.events.popleft()
            self._first_event += 1
        impulses = []
        for body in frame.bodies:
            total = self.orders.total(body.body)
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

    def _take_order(self, session: _Session, packet: Packet) -> Answer:
        """Have what is asked be done once, however often it comes."""
        if packet.sequence in session.answers:
            return session.answers[packet.sequence]
        if packet.sequence <= self._last_order:
            self.counts["replayed"] += 1
            return None
        if list(session.answers.values()).count(None) == ANSWER_COUNT:
            return None  # it comes again
        self._last_order = packet.sequence
        session.answers[packet.sequence] = None

        def tell(told: dict[str, Any]) -> bytes:
            if told.get("done") == "bodies":
                session.known[:] = len(told["bodies"]), len(told["swatches"])
            answer = session.answers[packet.sequence] = _pack_answer(session.key, packet.sequence, told)
            if len(session.answers) > ANSWER_COUNT:
                del session.answers[min(session.answers)]
            return answer

        return self.orders.submit(session.frame, lambda: unpack_json(packet.payload), tell)


def _pack_answer(key: int, sequence: int, told: dict[str, Any]) -> bytes:
    try:
        return pack(Packet(ANSWER, key, sequence, pack_json(told)))
    except PacketError:
        why = f"the answer is longer than a packet of {SIZE_MAX:,} bytes; ask over WebSocket"
        return pack(Packet(ANSWER, key, sequence, pack_json({"error": why})))


def _last(names: Sequence[str], name: str) -> int:
    """The number of the last that has a name: of two that had the same one in turn, the later."""
    return next((k for k in range(len(names) - 1, -1, -1) if names[k] == name), 0xFFFF)
