"""Haply's Inverse3, through the service that comes with it: JSON over a WebSocket of this machine.

The service sends one state for each message, and none by itself; a command holds for one of its ticks, so a driver that
dies gives no force. Its axes are D's: right-handed, x to the right, y away, z up, in metres.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, Final

import numpy as np

from hapscene.device.driver import Connection, Driver, Found, Option, clip_force
from hapscene.device.model import Device, Limits
from hapscene.device.sim.point import PointMass
from hapscene.errors import DeviceError
from hapscene.geometry import rotation_of
from hapscene.wall_clock import CLOCK, Clock
from hapscene_plugins.devices.inverse3_messages import first, force_message, is_identity, listed, numbers, parse, part
from hapscene_plugins.devices.silence import Silence

URI: Final = "ws://localhost:10001"

FORCE_N: Final = 2.0
"""Largest force: what IsaacLab drives it at; Haply says none."""

PENDING_MAX: Final = 4
"""Most messages that wait for their state [count]: a service that is late is not given more to do."""

WAIT_S: Final = 0.0003
"""Time that a tick waits for the answer to its last message [s]."""

IGNORED_COUNT: Final = 50
"""States in which a force was sent and none is there, until that is told [count]."""

CALIBRATE, POWER, TRANSFORMED, IGNORED = 1, 2, 3, 4
REASONS = {
    CALIBRATE: "it is not calibrated: move its arm to its end stops and back",
    POWER: "it is not ready: check its power, and what the service says of it",
    TRANSFORMED: "the service moves or scales its positions: take the transform away in its settings",
    IGNORED: "it takes no force: open it with --option field=values (services before 3.5), or the other way round",
}


def connect(uri: str, wait_s: float) -> Any:
    """A connection to the service.

    Raises:
        DeviceError: websockets is missing, or nobody is there.
    """
    try:
        from websockets.sync.client import connect
    except ImportError:
        raise DeviceError("inverse3 needs one more package: pip install 'hapscene[serve]'") from None
    from websockets.exceptions import WebSocketException

    try:
        return connect(
            uri, compression=None, open_timeout=wait_s, close_timeout=0.2, ping_interval=None, max_size=1 << 20
        )
    except (OSError, ValueError, WebSocketException) as error:
        raise DeviceError(
            f"inverse3: {uri}: no service answers ({error}); start Haply's Inverse service, or say --option uri="
        ) from None


class Inverse3Connection(Connection):
    """An Inverse3. A force goes out each tick, and a state comes back."""

    def __init__(
        self,
        uri: str = URI,
        field: str = "vector",
        x_m: float = 0.05,
        y_m: float = -0.15,
        z_m: float = 0.17,
        clock: Clock = CLOCK,
    ) -> None:
        super().__init__()
        self._field, self._middle, self._name = field, (x_m, y_m, z_m), f"inverse3: {uri}"
        self._pending = self._ignored = 0
        self._status: dict[str, Any] = {}
        self._socket = connect(uri, 2.0)
        self._id = ""
        self._silence, start_s = Silence(clock), clock.now_s()
        try:
            while not self._id:  # a service that has just started may tell of no device yet
                content = parse(self._receive(1.0) or "") or {}
                self._id = str(first(content, "inverse3").get("device_id") or "")
                if not self._id and clock.now_s() - start_s > 1.0:
                    raise DeviceError(f"{self._name}: the service has no Inverse3; plug it in")
            self._take(content)
            self._send((0.0, 0.0, 0.0))
        except BaseException:
            self.close()
            raise

    def _receive(self, wait_s: float) -> str | bytes | None:
        """A message; None where none comes in time."""
        from websockets.exceptions import ConnectionClosed

        try:
            message: str | bytes = self._socket.recv(timeout=wait_s)
        except TimeoutError:
            return None
        except (ConnectionClosed, OSError) as error:
            raise DeviceError(f"{self._name}: the service is gone ({error}); start it again") from None
        return message

    def _send(self, force: tuple[float, float, float]) -> None:
        from websockets.exceptions import ConnectionClosed

        if self._pending > PENDING_MAX and force != (0.0, 0.0, 0.0):
            return
        try:
            self._socket.send(force_message(self._id, self._field, force))
        except (ConnectionClosed, OSError) as error:
            raise DeviceError(f"{self._name}: the service is gone ({error}); start it again") from None
        self._pending += 1

    def read(self) -> None:
        wait_s = WAIT_S
        while self._pending > 0:
            message = self._receive(wait_s)
            if message is None:
                break
            content, wait_s = parse(message), 0.0
            if content is not None and "category" in content:
                continue  # an event: no answer
            self._pending -= 1
            if content is not None:
                self._take(content)
        if self._silence.is_over():
            self.state.ready = 0
            raise DeviceError(f"{self._name}: the service has said nothing of sense for half a second; start it again")

    def _take(self, content: dict[str, Any]) -> None:
        """Read a message into the state, if it is a state."""
        told = first(content, "inverse3", self._id)
        inner = part(told, "state")
        p = numbers(inner, "cursor_position")
        if p is None or not all(abs(value) < 1.0 for value in p):
            return
        state = self.state[0]
        self._silence.end()
        state.p_DT_m = [value - middle for value, middle in zip(p, self._middle, strict=True)]
        if "status" in told:
            self._status = part(told, "status")
        self._grip(content)
        if self._status.get("calibrated") is not True:
            state.trouble = CALIBRATE
        elif self._status.get("ready") is not True:
            state.trouble = POWER
        elif not is_identity(part(inner, "transform")):
            state.trouble = TRANSFORMED
        else:
            state.trouble = IGNORED if self._is_ignored(inner) else 0
        state.ready = int(state.trouble in (0, IGNORED))
        state.count += 1

    def _is_ignored(self, inner: dict[str, Any]) -> bool:
        """Whether forces are sent and none is there."""
        there = numbers(inner, "current_cursor_force")
        sent = self.state.ready[0] == 1 and math.hypot(*self.state.f_D_N[0].tolist()) > 0.1
        self._ignored = self._ignored + 1 if sent and there == (0.0, 0.0, 0.0) else 0
        return self._ignored > IGNORED_COUNT

    def _grip(self, content: dict[str, Any]) -> None:
        """Buttons and orientation of a grip, by wire or without."""
        inner = part(first(content, "verse_grip"), "state")
        buttons = int(inner.get("button") is True)
        if not inner:
            inner = part(first(content, "wireless_verse_grip"), "state")
            buttons = sum(1 << i for i, name in enumerate("abc") if part(inner, "buttons").get(name) is True)
        self.state.buttons = buttons
        q = numbers(inner, "orientation", "xyzw")
        if q is not None and any(q):
            self.state.R_DT = rotation_of(np.array(q))

    def write(self) -> None:
        self._send(clip_force(self.state.f_D_N[0], FORCE_N) if self.state.ready[0] == 1 else (0.0, 0.0, 0.0))

    def close(self) -> None:
        if self._id:
            with suppress(DeviceError):
                self._send((0.0, 0.0, 0.0))
                while self._pending > 0 and self._receive(0.05) is not None:
                    self._pending -= 1  # the service reads no further than it can answer
        with suppress(OSError):
            self._socket.close()

    def reason(self, trouble: int) -> str:
        return REASONS.get(trouble, "")


def find(uri: str = URI, **options: Any) -> Sequence[Found]:
    """The Inverse3s that the service of this machine has."""
    try:
        with connect(uri, 0.2) as socket:
            content = parse(socket.recv(timeout=0.2)) or {}
    except DeviceError as error:
        what, _, remedy = str(error).replace(": pip", "; pip").partition("; ")
        return [Found(uri, trouble=what, remedy=remedy)]
    except Exception as error:  # whatever is at that port is no service of Haply's
        return [Found(uri, trouble=f"inverse3: {uri}: {error!r:.100}", remedy="start Haply's Inverse service")]
    return [Found(f"{uri} {told.get('device_id')}") for told in listed(content, "inverse3")]


def release(**options: Any) -> None:
    """Tell the service zero, whose last command has ended already."""
    Inverse3Connection(**options).close()


DRIVER = Driver(
    name="inverse3",
    summary="Haply's Inverse3, through the service that comes with it.",
    open=Inverse3Connection,
    find=find,
    model=Device(
        "inverse3",
        PointMass(0.1, 0.1, 0.1, 50e-6),
        Limits(FORCE_N, 1000.0 * FORCE_N, stiffness_N_m=500.0, damping_Ns_m=3.0),
    ),
    continuous_N=1.0,
    low_D_m=(-0.15, -0.12, -0.12),
    high_D_m=(0.15, 0.12, 0.12),
    orientation=True,
    button_count=3,
    rate_Hz=1000.0,
    needs="Haply's Inverse service, running; websockets (pip install 'hapscene[serve]')",
    imports=("websockets.sync.client", "websockets.exceptions"),
    options=(
        Option("uri", URI, "where the service listens"),
        Option("field", "vector", "how it spells a force: values before 3.5, vector since", ("vector", "values")),
        Option("x_m", 0.05, "middle of the workspace in the service's frame [m]"),
        Option("y_m", -0.15, "middle of the workspace in the service's frame [m]"),
        Option("z_m", 0.17, "middle of the workspace in the service's frame [m]"),
    ),
    release=release,
    assumptions=(
        "The service lets go when commands end; how soon is not said.",
        "The force, mass, friction, and the middle of the workspace are guessed from what others drive it at.",
        "A grip's z is along the handle.",
    ),
)
