"""A device on another computer, through the bridge's UDP protocol: it sends its position and receives the force.

Any client of the bridge (`docs/reference/bridge-protocol.md`, `examples/engines`) can be this device. The aim in its
FRAME is the device position relative to the middle of the workspace. The STATE that answers the newest FRAME contains
the force, in the axes and unit of its HELLO. The client provides no bodies: the scene is on this side.

A network adds latency: walls are soft, and a client that sends nothing for 15 ms gets no force. Only one client can be
connected. Another one can connect after a BYE, or after two seconds without a message.
"""

import math
import secrets
import socket
from contextlib import suppress
from typing import Any, Final

import numpy as np

from hapscene.bridge.conventions import Convention
from hapscene.bridge.packets import (
    BYE,
    FRAME,
    HELLO,
    REFUSED,
    SIZE_MAX,
    STATE,
    VERSION,
    WELCOME,
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
from hapscene.constants import TICK_S
from hapscene.device.driver import Connection, Driver, Found, Option
from hapscene.device.model import Device, Limits
from hapscene.errors import DeviceError
from hapscene.wall_clock import CLOCK, Clock

FORCE_N: Final = 3.0
"""Force limit [N]. The device on the other side is unknown."""

REACH_M: Final = 0.5
"""Largest valid coordinate of a position [m]."""

SILENT_S: Final = 0.015
"""Time without a FRAME after which a client gets no force [s]."""

GONE_S: Final = 2.0
"""Time without a message after which another client may connect [s]."""

FLOOD: Final = 64
"""Most packets that are processed in a tick."""

WAITING, SILENT = 1, 2


class NetworkConnection(Connection):
    """A UDP socket for one client."""

    def __init__(self, host: str = "127.0.0.1", port: int = 47811, clock: Clock = CLOCK) -> None:
        super().__init__()
        self._clock = clock
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except (OSError, OverflowError) as error:
            self._socket.close()
            raise DeviceError(
                f"network: cannot listen at {host}:{port}: {error}; choose another --option port= or host="
            ) from None
        self._socket.setblocking(False)
        self.address: tuple[str, int] = self._socket.getsockname()
        self._key, self._nonce, self._client = 0, None, ("", 0)
        self._convention = Convention.of({})
        self._last = self._waiting = self._tick = 0
        self._pushes = False
        self._message_s = self._frame_s = -math.inf
        self.state.trouble = WAITING

    def read(self) -> None:
        for _ in range(FLOOD):
            try:
                data, client = self._socket.recvfrom(SIZE_MAX + 1)
                self._take(unpack(data), client)
            except BlockingIOError:
                break
            except (PacketError, ConnectionError):  # on Windows, a client that has exited resets the connection
                continue
            except OSError as error:
                raise DeviceError(f"network: {self.address[0]}:{self.address[1]}: {error}") from None
        state = self.state[0]
        if self._key == 0 or self._clock.now_s() - self._frame_s > SILENT_S:
            state.ready, state.trouble = 0, SILENT if self._key else WAITING

    def _take(self, packet: Packet, client: tuple[str, int]) -> None:
        """Process one packet. Packets without a valid session are ignored."""
        now_s = self._clock.now_s()
        if packet.kind == HELLO:
            self._welcome(packet, client, now_s)
        elif packet.key != self._key or client != self._client or self._key == 0:
            if packet.kind == FRAME:
                self._refuse(packet, client, "no such session")
        elif packet.kind == BYE:
            self._key = 0
        elif packet.kind == FRAME and packet.sequence > self._last:
            self._message_s = now_s
            frame = unpack_frame(packet.payload)
            if frame.aim is None:
                return
            p = self._convention.position(frame.aim)
            if not float(np.abs(p).max()) <= REACH_M:  # false for NaN
                return
            self._last = self._waiting = packet.sequence
            self._frame_s, self.state.p_DT_m = now_s, p
            self.state.ready, self.state.trouble = 1, 0
            self.state.count += 1

    def _welcome(self, packet: Packet, client: tuple[str, int], now_s: float) -> None:
        """Start a session, unless another client is connected."""
        try:
            hello = unpack_json(packet.payload)
            if hello.get("version") != VERSION:
                raise PacketError(f"this side has protocol version {VERSION}")
            convention = Convention.of(hello)
        except PacketError as error:
            self._refuse(packet, client, str(error))
            return
        again = self._key != 0 and client == self._client and hello.get("nonce") == self._nonce
        if self._key != 0 and not again and now_s - self._message_s < GONE_S:
            self._refuse(packet, client, "another client is here")  # clients compare this text
            return
        if not again:
            self._key, self._client, self._nonce = 1 + secrets.randbits(63), client, hello.get("nonce")
            self._convention, self._last, self._waiting = convention, 0, 0
            self._message_s, self._frame_s = now_s, -math.inf
        welcome = {"version": VERSION, "bodies": [], "swatches": [], "tick_s": TICK_S}
        self._send(Packet(WELCOME, self._key, packet.sequence, pack_json(welcome)), client)

    def _refuse(self, packet: Packet, client: tuple[str, int], reason: str) -> None:
        self._send(Packet(REFUSED, 0, packet.sequence, pack_json({"error": reason})), client)

    def _send(self, packet: Packet, client: tuple[str, int]) -> None:
        with suppress(OSError):  # UDP does not guarantee delivery anyway
            self._socket.sendto(pack(packet), client)

    def write(self) -> None:
        self._tick += 1
        force = self.state.f_D_N[0] if self.state.ready[0] == 1 else np.zeros(3)
        if self._key != 0 and (self._waiting > 0 or (self._pushes and not force.any())):  # the end of a force at once
            self._waiting = self._last
            self._answer(force)

    def _answer(self, force: Any) -> None:
        """Send the force, in the STATE that answers the newest FRAME."""
        size = float(np.sqrt(force @ force))
        force = force * min(1.0, FORCE_N / size) if 0.0 < size < math.inf else np.zeros(3)
        place, zero = self._convention.client_position(self.state.p_DT_m[0]), (0.0, 0.0, 0.0)
        sent = self._convention.client_vector(force)
        state = State(self._tick, 0.0, place, place, zero, sent, 0.0, 0.0, -1, -1, -1, 0, 0, (), ())
        self._send(Packet(STATE, self._key, self._waiting, pack_state(state)), self._client)
        self._waiting, self._pushes = 0, bool(force.any())

    def close(self) -> None:
        if self._key != 0 and self._socket.fileno() >= 0:
            self._waiting = self._last
            self._answer(np.zeros(3))
            self._send(Packet(BYE, self._key, self._last, b""), self._client)
        self._key = 0
        self._socket.close()

    def reason(self, trouble: int) -> str:
        where = f"{self.address[0]}:{self.address[1]}"
        reasons = {
            WAITING: f"no client has connected to UDP {where}",
            SILENT: f"no FRAME from the client of UDP {where}",
        }
        return reasons.get(trouble, "")


DRIVER = Driver(
    name="network",
    summary="Device on another computer, through the bridge's UDP protocol.",
    open=NetworkConnection,
    find=lambda host="127.0.0.1", port=47811, **options: [Found(f"UDP {host}:{port}")],
    model=Device("network", None, Limits(FORCE_N, 1000.0 * FORCE_N, stiffness_N_m=300.0, damping_Ns_m=1.0)),
    low_D_m=(-REACH_M, -REACH_M, -REACH_M),
    high_D_m=(REACH_M, REACH_M, REACH_M),
    rate_Hz=200.0,
    needs="a client of the bridge's protocol that sends its position at 200 Hz or more",
    options=(
        Option("host", "127.0.0.1", "address to listen at: 127.0.0.1 for this computer only, 0.0.0.0 for all networks"),
        Option("port", 47811, "UDP port to listen at; 0 for any free port"),
    ),
    watchdog_s=SILENT_S,
    assumptions=(f"The client stops its force when it receives none for {1e3 * SILENT_S:g} ms.",),
)
