"""The UDP server of the bridge: connects a servo with clients, such as game engines; each tool has one client."""

import secrets
import select
import socket
from collections import deque
from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

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
    BodyFrame,
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
from hapscene.io.files import Json
from hapscene.render.contact_info import Impulse
from hapscene.wall_clock import CLOCK, Clock

__all__ = ["Answer", "BridgeServer"]

SILENT_S: Final = 2.0
"""Time without packets after which another client can connect [s]."""

EVENT_COUNT: Final = 4096
"""Most events that wait for the client [count]. The oldest are dropped, which the client detects by the numbering."""

ANSWER_COUNT: Final = 64
"""Most answers that are kept for repeated orders, and most waiting orders [count]."""

POLL_S: Final = 0.2
"""Polling interval for the end of the server [s]."""

BATCH_MAX: Final = 1000
"""Most packets that are answered before the server checks whether to end [count]."""

KINDS: Final = {"began": 1, "crossed": 2, "ended": 3}
PRESSED, RELEASED = 4, 5  # kinds of button events, for clients that request them

BUSY: Final = "another client is here"
NO_SESSION: Final = "no such session"
"""Errors that clients recognise by their text (docs/reference/bridge-protocol.md): part of the protocol."""

Answer = bytes | Future[bytes] | None
"""The answer to a packet: immediate, after an order is executed, or none."""


@dataclass
class _Session:
    """State of a connected client."""

    key: int
    nonce: Json
    address: Hashable
    tool: int
    frame: Convention
    welcome: bytes
    known: list[int]  # numbers of bodies and swatches that the client knows
    base: NDArray[np.float64]  # (room, 6) totals of impulse at its beginning
    events_from: int
    buttons_from: int  # −1: the client requests no button events
    received_s: float
    oriented: bool  # whether the client requests the orientation of its tool
    events: deque[Event] = field(default_factory=lambda: deque(maxlen=EVENT_COUNT))
    answers: dict[int, bytes | None] = field(default_factory=dict)  # None: it is not done yet
    last: int = 0
    last_order: int = 0
    first_event: int = 0


class BridgeServer:
    """Answers the packets of clients: moves bodies of a running servo, and reports contact and impulses.

    Each tool of the servo has one client at a time. All clients see the same bodies.

    Invalid, foreign and repeated packets have no effect and are counted.

    Args:
        orders: executes orders; its servo must be entered before the first packet is answered.
        host, port: address to listen at; port 0 selects a free one.
        clock: measures the silence of a client.

    Attributes:
        address: the address of the server.

    Raises:
        HapsceneError: the address cannot be used, or the names of the scene do not fit into a packet.
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
            text = f"{host}:{port}: cannot listen: {error.strerror}; choose another --udp port or --host"
            raise HapsceneError(text) from None
        self._socket.setblocking(False)
        self.address: tuple[str, int] = self._socket.getsockname()
        self._sessions: dict[int, _Session] = {}  # by tool

    def _welcome(self, key: int, sequence: int) -> bytes:
        payload = pack_json(self.orders.welcome())
        try:
            return pack(Packet(WELCOME, key, sequence, payload))
        except PacketError:
            scene = self.servo.scene
            raise HapsceneError(
                f"the names of {len(scene.bodies):,} bodies and {len(scene.swatches):,} swatches take "
                f"{len(payload):,} bytes; expected at most {SIZE_MAX:,}; use shorter names"
            ) from None

    def __enter__(self) -> "BridgeServer":
        return self

    def __exit__(self, *error: object) -> None:
        self._socket.close()

    def serve(self, over: Callable[[], bool]) -> None:
        """Answer packets until `over` returns true.

        Raises:
            HapsceneError: the servo has ended.
        """
        while not over():
            if select.select([self._socket], [], [], POLL_S)[0]:
                self.answer_all()
            else:
                self.servo.state()  # raises if the servo has ended

    def answer_all(self) -> None:
        """Answer the received packets, at most `BATCH_MAX`."""
        for _ in range(BATCH_MAX):
            try:
                data, address = self._socket.recvfrom(SIZE_MAX + 1)
            except BlockingIOError:
                return
            except OSError:  # some systems report here that an earlier answer could not be delivered
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
        """Return the answer to a packet from any source. Can be called from any thread."""
        with self.orders.lock:
            try:
                return self._answer(unpack(data), address)
            except PacketError:
                self.counts["bad"] += 1
                return None

    def _answer(self, packet: Packet, address: Hashable) -> Answer:
        """Return the answer to a packet.

        Raises:
            PacketError: an invalid payload.
        """
        if packet.kind == HELLO:
            return self._welcome_client(packet, address)
        sender = packet.key, address
        session = next((one for one in self._sessions.values() if (one.key, one.address) == sender), None)
        if session is None:
            self.counts["forged"] += 1
            return self._refuse(packet, NO_SESSION) if packet.kind in (FRAME, ORDER) else None
        session.received_s = self._clock.now_s()
        if packet.kind == FRAME:
            return self._process_frame(session, packet)
        if packet.kind == ORDER:
            return self._process_order(session, packet)
        if packet.kind == BYE:
            self._end(session)
            self.counts["bye"] += 1
            return None
        raise PacketError(f"packet kind {packet.kind} is only sent by servers")

    def _welcome_client(self, packet: Packet, address: Hashable) -> bytes:
        hello = unpack_json(packet.payload)
        try:
            tool = self.orders.tool(hello.get("tool", 0))
        except PacketError as error:
            return self._refuse(packet, str(error))
        session = self._sessions.get(tool)
        if session is not None and (session.nonce, session.address) == (hello.get("nonce"), address):
            return session.welcome  # the first answer was lost
        if session is not None and not self._silent(session):
            self.counts["busy"] += 1
            return self._refuse(packet, BUSY)
        if hello.get("version") != VERSION:
            return self._refuse(packet, f"unsupported protocol version; expected {VERSION}")
        key = secrets.randbits(64) or 1
        try:
            frame, welcome = Convention.of(hello), self._welcome(key, packet.sequence)
        except HapsceneError as error:
            return self._refuse(packet, str(error))
        self._end_silent()
        if not self._sessions:
            self.orders.fix_all()
        self._sessions[tool] = _Session(
            *(key, hello.get("nonce"), address, tool, frame, welcome),
            known=[len(self.servo.scene.bodies), len(self.servo.scene.swatches)],
            base=self.orders.impulse_offset + self.orders.given(),  # the totals of a new session begin at 0
            buttons_from=self.servo.button_events(tool=tool)[1] if hello.get("buttons") is True else -1,
            events_from=self.servo.state(tool=tool).tick + 1,
            received_s=self._clock.now_s(),
            oriented=hello.get("orientation") is True,
        )
        self.counts["hello"] += 1
        return welcome

    def _silent(self, session: _Session) -> bool:
        return self._clock.now_s() - session.received_s >= SILENT_S

    def _end(self, session: _Session) -> None:
        del self._sessions[session.tool]
        self.orders.withdraw(session.tool)

    def _end_silent(self) -> None:
        """End the sessions of clients that send nothing any more."""
        for session in [one for one in self._sessions.values() if self._silent(one)]:
            self._end(session)

    @staticmethod
    def _refuse(packet: Packet, why: str) -> bytes:
        return pack(Packet(REFUSED, 0, packet.sequence, pack_json({"error": why})))

    # --- frames

    def _process_frame(self, session: _Session, packet: Packet) -> bytes | None:
        """Move bodies and the hand, and return the newest state. The servo checks the numbers of the client."""
        frame = unpack_frame(packet.payload)
        if any(body.body >= len(self.servo.scene.bodies) for body in frame.bodies):
            raise PacketError("unknown body")
        if packet.sequence <= session.last:
            self.counts["replayed"] += 1
            return None
        session.last = packet.sequence
        self.counts["frames"] += 1
        self._end_silent()
        with np.errstate(all="ignore"):
            for body in frame.bodies:
                self._move(session, body)
            if frame.aim is not None:
                try:
                    place_m, grip = session.frame.position(frame.aim), self.orders.grips[session.tool]
                    self.servo.aim(place_m, grip, tool=session.tool)
                except HapsceneError:
                    self.counts["bad"] += 1
        return pack(Packet(STATE, session.key, packet.sequence, pack_state(self._state(session, frame))))

    def _move(self, session: _Session, body: BodyFrame) -> None:
        name = self.orders.names.get(body.body)
        if name is None:
            self.counts["removed"] += 1
            return
        frame, applied = session.frame, np.array(body.applied)
        before = (self.orders.impulse_offset - session.base)[body.body]
        moving = {}
        if body.v is not None and body.w is not None:
            moving = {"v_W_m_s": frame.position(body.v), "w_W_rad_s": frame.angular(body.w)}
        try:
            self.servo.move(
                name,
                frame.pose(body.p, body.q),
                applied=Impulse(frame.vector(applied[:3]) - before[:3], frame.angular(applied[3:]) - before[3:]),
                teleport=body.teleport,
                **moving,
            )
        except HapsceneError:
            if not self.servo.alive:
                raise
            self.counts["bad"] += 1

    def _state(self, session: _Session, frame: Frame) -> State:
        to, state = session.frame, self.servo.state(tool=session.tool)
        found, session.events_from = self.servo.events(session.events_from, tool=session.tool)
        for event in found:
            index = _last(self.servo.body_names, event.body)
            swatch = _last([swatch.name for swatch in self.servo.scene.swatches], event.swatch)
            if index >= session.known[0] or swatch >= session.known[1]:
                continue  # the client does not know this index yet
            speed = event.approach_m_s / to.metre
            _add_event(session, Event(event.tick, KINDS[event.kind], index, swatch, speed))
        if session.buttons_from >= 0:
            pressed, session.buttons_from = self.servo.button_events(session.buttons_from, tool=session.tool)
            for one in pressed:
                _add_event(session, Event(one.tick, PRESSED if one.pressed else RELEASED, one.button, 0xFFFF, 0.0))
        while session.events and session.first_event < frame.event_count:
            session.events.popleft()
            session.first_event += 1
        impulses = []
        for body in frame.bodies:
            total = self.orders.total(body.body) - session.base[body.body]
            linear, angular = total[:3], total[3:]
            impulses.append((body.body, (*to.client_vector(linear), *to.client_angular(angular))))
        return State(
            max(state.tick, 0),
            state.age_s if state.tick >= 0 else 0.0,
            to.client_position(state.p_WT_m),
            to.client_position(state.p_WP_m),
            to.client_vector(state.nhat_W),
            to.client_vector(state.f_W_N),
            state.depth_m / to.metre,
            state.slip_m_s / to.metre,
            state.body,
            state.face,
            state.swatch,
            int(state.flags),
            session.first_event,
            tuple(impulses),
            tuple(session.events)[:EVENTS_MAX],
            self._axes(session) if session.oriented else (),
        )

    def _axes(self, session: _Session) -> tuple[float, ...]:
        """The axes x and z of the tool in client coordinates."""
        R_WT, to = self.servo.tool_pose(tool=session.tool)[:3, :3], session.frame
        return (*to.client_vector(R_WT[:, 0]), *to.client_vector(R_WT[:, 2]))

    # --- orders

    def _process_order(self, session: _Session, packet: Packet) -> Answer:
        """Execute an order once, even if it is received repeatedly."""
        if packet.sequence in session.answers:
            return session.answers[packet.sequence]
        if packet.sequence <= session.last_order:
            self.counts["replayed"] += 1
            return None
        if list(session.answers.values()).count(None) == ANSWER_COUNT:
            return None  # too many waiting orders; the client repeats it
        session.last_order = packet.sequence
        session.answers[packet.sequence] = None

        def encode(result: dict[str, Json]) -> bytes:
            if result.get("done") == "bodies":
                session.known[:] = len(result["bodies"]), len(result["swatches"])
            answer = session.answers[packet.sequence] = _pack_answer(session.key, packet.sequence, result)
            if len(session.answers) > ANSWER_COUNT:
                del session.answers[min(session.answers)]
            return answer

        def read() -> dict[str, Json]:
            order = unpack_json(packet.payload)
            return {"tool": session.tool} | order if order.get("order") == "start" else order

        return self.orders.submit(session.frame, read, encode)


def _add_event(session: _Session, event: Event) -> None:
    """Append an event; the oldest is dropped if there is no room."""
    if len(session.events) == EVENT_COUNT:
        session.first_event += 1
    session.events.append(event)


def _pack_answer(key: int, sequence: int, result: dict[str, Json]) -> bytes:
    try:
        return pack(Packet(ANSWER, key, sequence, pack_json(result)))
    except PacketError:
        why = f"the answer exceeds the packet size of {SIZE_MAX:,} bytes; send the order over WebSocket"
        return pack(Packet(ANSWER, key, sequence, pack_json({"error": why})))


def _last(names: Sequence[str], name: str) -> int:
    """The index of the last body or swatch with a name; names can be reused after removal."""
    return next((k for k in range(len(names) - 1, -1, -1) if names[k] == name), 0xFFFF)
