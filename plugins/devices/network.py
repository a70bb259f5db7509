"""The bridge's protocol as a device: the tool's place comes from another machine, the force goes back to it.

Any client of the bridge (`docs/bridge-protocol.md`, `examples/engines`) is such a device: what it says of the hand's
aim in a FRAME is where the tool is, relative to the middle of the workspace, and the STATE that answers a tick's newest
FRAME says the force, in the frame and unit of its HELLO. Bodies are none: the scene is here.

Over a network a force is late: walls are soft, and a client that is silent for 20 ms gets none. One client at a time;
another may come when it has said BYE, or nothing for two seconds.
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
"""Largest force: what is at the other end, nobody here knows."""

REACH_M: Final = 0.5
"""Farthest place from the middle that is taken for one."""

SILENT_S: Final = 0.02
"""After how long without a FRAME a client gets no force."""

GONE_S: Final = 2.0
"""After how long another client may come."""

FLOOD: Final = 64
"""Most packets that are read in a tick [count]."""

WAITING, SILENT = 1, 2


class NetworkConnection(Connection):
    """A client of the bridge that is somebody's device."""

    def __init__(self, host: str = "127.0.0.1", port: int = 47811, clock: Clock = CLOCK) -> None:
        super().__init__()
        self._clock = clock
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except (OSError, OverflowError) as error:
            self._socket.close()
            raise DeviceError(f"network: cannot listen at {host}:{port}: {error}; say another port= or host=") from None
        self._socket.setblocking(False)
        self.address: tuple[str, int] = self._socket.getsockname()
        self._key, self._nonce, self._client = 0, None, ("", 0)
        self._convention = Convention.of({})
        self._last = self._waiting = self._tick = 0
        self._heard_s = self._framed_s = -math.inf
        self.state.trouble = WAITING

    def read(self) -> None:
        for _ in range(FLOOD):
            try:
                data, client = self._socket.recvfrom(SIZE_MAX + 1)
                self._take(unpack(data), client)
            except BlockingIOError:
                break
            except (PacketError, ConnectionError):  # Windows says of a client that is gone that it was reset
                continue
            except OSError as error:
                raise DeviceError(f"network: {self.address[0]}:{self.address[1]}: {error}") from None
        state = self.state[0]
        if self._key == 0 or self._clock.now_s() - self._framed_s > SILENT_S:
            state.ready, state.trouble = 0, SILENT if self._key else WAITING

    def _take(self, packet: Packet, client: tuple[str, int]) -> None:
        """What one packet says; whatever is of no session changes nothing."""
        now_s = self._clock.now_s()
        if packet.kind == HELLO:
            self._welcome(packet, client, now_s)
        elif packet.key != self._key or client != self._client or self._key == 0:
            if packet.kind == FRAME:
                self._refuse(packet, client, "no such session")
        elif packet.kind == BYE:
            self._key = 0
        elif packet.kind == FRAME and packet.sequence > self._last:
            self._heard_s = now_s
            frame = unpack_frame(packet.payload)
            if frame.aim is None:
                return
            p = self._convention.position(frame.aim)
            if not float(np.abs(p).max()) <= REACH_M:  # NaN, too
                return
            self._last = self._waiting = packet.sequence
            self._framed_s, self.state.p_DT_m = now_s, p
            self.state.ready, self.state.trouble = 1, 0
            self.state.count += 1

    def _welcome(self, packet: Packet, client: tuple[str, int], now_s: float) -> None:
        """Begin a session, unless another one goes on."""
        try:
            hello = unpack_json(packet.payload)
            if hello.get("version") != VERSION:
                raise PacketError(f"version {VERSION} is spoken here")
            convention = Convention.of(hello)
        except PacketError as error:
            self._refuse(packet, client, str(error))
            return
        again = self._key != 0 and client == self._client and hello.get("nonce") == self._nonce
        if self._key != 0 and not again and now_s - self._heard_s < GONE_S:
            self._refuse(packet, client, "another client is here")
            return
        if not again:
            self._key, self._client, self._nonce = 1 + secrets.randbits(63), client, hello.get("nonce")
            self._convention, self._last, self._waiting = convention, 0, 0
            self._heard_s, self._framed_s = now_s, -math.inf
        welcome = {"version": VERSION, "bodies": [], "swatches": [], "tick_s": TICK_S}
        self._send(Packet(WELCOME, self._key, packet.sequence, pack_json(welcome)), client)

    def _refuse(self, packet: Packet, client: tuple[str, int], why: str) -> None:
        self._send(Packet(REFUSED, 0, packet.sequence, pack_json({"error": why})), client)

    def _send(self, packet: Packet, client: tuple[str, int]) -> None:
        with suppress(OSError):  # as if it were lost on the way
            self._socket.sendto(pack(packet), client)

    def write(self) -> None:
        self._tick += 1
        if self._key != 0 and self._waiting > 0:
            self._answer(self.state.f_D_N[0] if self.state.ready[0] == 1 else np.zeros(3))

    def _answer(self, force: Any) -> None:
        """Tell the force: the STATE that answers the newest FRAME."""
        size = float(np.sqrt(force @ force))
        force = force * min(1.0, FORCE_N / size) if 0.0 < size < math.inf else np.zeros(3)
        place, none = self._convention.client_position(self.state.p_DT_m[0]), (0.0, 0.0, 0.0)
        told = self._convention.client_vector(force)
        state = State(self._tick, 0.0, place, place, none, told, 0.0, 0.0, -1, -1, -1, 0, 0, (), ())
        self._send(Packet(STATE, self._key, self._waiting, pack_state(state)), self._client)
        self._waiting = 0

    def close(self) -> None:
        if self._key != 0 and self._socket.fileno() >= 0:
            self._waiting = self._last
            self._answer(np.zeros(3))
            self._send(Packet(BYE, self._key, self._last, b""), self._client)
        self._key = 0
        self._socket.close()

    def reason(self, trouble: int) -> str:
        where = f"{self.address[0]}:{self.address[1]}"
        return {WAITING: f"nobody has come to UDP {where} yet", SILENT: f"the client of UDP {where} is silent"}.get(
            trouble, ""
        )


DRIVER = Driver(
    name="network",
    summary="Another machine's device, by the bridge's protocol over UDP.",
    open=NetworkConnection,
    find=lambda host="127.0.0.1", port=47811, **options: [Found(f"UDP {host}:{port}")],
    model=Device("network", None, Limits(FORCE_N, 1000.0 * FORCE_N, stiffness_N_m=300.0, damping_Ns_m=1.0)),
    low_D_m=(-REACH_M, -REACH_M, -REACH_M),
    high_D_m=(REACH_M, REACH_M, REACH_M),
    rate_Hz=200.0,
    needs="a client of the bridge's protocol that says its tool's place 100 times a second or more",
    options=(
        Option("host", "127.0.0.1", "where to listen: this machine alone, or 0.0.0.0 for all that can reach it"),
        Option("port", 47811, "UDP port to listen at; 0 for any"),
    ),
    watchdog_s=SILENT_S,
    assumptions=("The client gives no force when it hears of none for a moment.",),
)
