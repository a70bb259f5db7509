"""Haply Inverse3 through Haply's Inverse service: JSON over a WebSocket on this computer.

The service answers each message by one state, and sends none otherwise. A command is valid for one tick of the service,
so the force ends if the driver dies. The axes equal those of D: right-handed, x to the right, y away, z up, in metres.
"""

import math
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, Final

import numpy as np

from hapscene.device.driver import Connection, Driver, Found, Option, clip_force
from hapscene.device.model import Device, Limits
from hapscene.device.response_timeout import ResponseTimeout
from hapscene.device.sim.point import PointMass
from hapscene.errors import DeviceError
from hapscene.geometry import rotation_of
from hapscene.wall_clock import CLOCK, Clock
from hapscene_plugins.devices.inverse3_link import Link
from hapscene_plugins.devices.inverse3_messages import first, force_message, is_identity, listed, numbers, parse, part

URI: Final = "ws://localhost:10001"

FORCE_N: Final = 2.0
"""Force limit [N], as in IsaacLab. Haply publishes none."""

PENDING_MAX: Final = 4
"""Most messages without an answer [count]. A slow service gets no further commands."""

WAIT_S: Final = 0.0003
"""Time that a tick waits for the answer to its last message [s]."""

IGNORED_COUNT: Final = 50
"""Consecutive states without the commanded force before this is reported [count]."""

CALIBRATE, POWER, TRANSFORMED, IGNORED = 1, 2, 3, 4
REASONS = {
    CALIBRATE: "it is not calibrated: move the arm to its end stops and back",
    POWER: "it is not ready: check the power, and its status in the service",
    TRANSFORMED: "the service transforms the positions: remove the transform in its settings",
    IGNORED: "it ignores forces: use --option field=values for services before 3.5, and field=vector since",
}


class Inverse3Connection(Connection):
    """An open Inverse3. Each tick sends a force and receives a state."""

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
        self._link = Link(uri, 2.0)
        self._id = ""
        self._timeout, start_s = ResponseTimeout(clock), clock.now_s()
        try:
            while not self._id:  # a service that has just started may not list the device yet
                content = parse(self._receive(1.0) or b"") or {}
                self._id = str(first(content, "inverse3").get("device_id") or "")
                if not self._id and clock.now_s() - start_s > 1.0:
                    raise DeviceError(f"{self._name}: the service lists no Inverse3; connect it")
            self._take(content)
            self._send((0.0, 0.0, 0.0))
        except BaseException:
            self.close()
            raise

    def _receive(self, wait_s: float) -> bytes | None:
        """Receive a message; None on a timeout."""
        try:
            return self._link.receive(wait_s)
        except OSError as error:
            raise self._gone(error) from None

    def _send(self, force: tuple[float, float, float]) -> None:
        if self._pending > PENDING_MAX and force != (0.0, 0.0, 0.0):
            return
        try:
            self._link.send(force_message(self._id, self._field, force))
        except OSError as error:
            raise self._gone(error) from None
        self._pending += 1

    def _gone(self, error: OSError) -> DeviceError:
        return DeviceError(f"{self._name}: the service has disconnected ({error}); restart it")

    def read(self) -> None:
        wait_s = WAIT_S
        while self._pending > 0:
            message = self._receive(wait_s)
            if message is None:
                break
            content, wait_s = parse(message), 0.0
            if content is not None and "category" in content:
                continue  # an event, not an answer
            self._pending -= 1
            if content is not None:
                self._take(content)
        self._timeout.check(self, self._name, "restart the service")

    def _take(self, content: dict[str, Any]) -> None:
        """Update the state by a message, if it contains a state."""
        entry = first(content, "inverse3", self._id)
        inner = part(entry, "state")
        p = numbers(inner, "cursor_position")
        if p is None or not all(abs(value) < 1.0 for value in p):
            return
        state = self.state.view(np.ndarray)[0]  # the attributes of a record array take microseconds each
        self._timeout.received()
        state["p_DT_m"] = [value - middle for value, middle in zip(p, self._middle, strict=True)]
        state["v_DT_m_s"] = numbers(inner, "cursor_velocity") or math.nan
        if "status" in entry:
            self._status = part(entry, "status")
        self._grip(content, state)
        if self._status.get("calibrated") is not True:
            trouble = CALIBRATE
        elif self._status.get("ready") is not True:
            trouble = POWER
        elif not is_identity(part(inner, "transform")):
            trouble = TRANSFORMED
        else:
            trouble = IGNORED if self._is_ignored(inner, state) else 0
        state["trouble"], state["ready"] = trouble, trouble in (0, IGNORED)
        state["count"] += 1

    def _is_ignored(self, inner: dict[str, Any], state: Any) -> bool:
        """Whether the device has ignored the commanded force for `IGNORED_COUNT` states."""
        measured = numbers(inner, "current_cursor_force")
        sent = state["ready"] == 1 and math.hypot(*state["f_D_N"].tolist()) > 0.1
        self._ignored = self._ignored + 1 if sent and measured == (0.0, 0.0, 0.0) else 0
        return self._ignored > IGNORED_COUNT

    def _grip(self, content: dict[str, Any], state: Any) -> None:
        """Update buttons and orientation from the VerseGrip, wired or wireless."""
        inner = part(first(content, "verse_grip"), "state")
        buttons = int(inner.get("button") is True)
        if not inner:
            inner = part(first(content, "wireless_verse_grip"), "state")
            buttons = sum(1 << i for i, name in enumerate("abc") if part(inner, "buttons").get(name) is True)
        state["buttons"] = buttons
        q = numbers(inner, "orientation", "xyzw")
        if q is not None and any(q):
            state["R_DT"] = rotation_of(np.array(q))

    def write(self) -> None:
        state = self.state.view(np.ndarray)[0]
        self._send(clip_force(state["f_D_N"].tolist(), FORCE_N) if state["ready"] == 1 else (0.0, 0.0, 0.0))

    def close(self) -> None:
        if self._id:
            with suppress(DeviceError):
                self._send((0.0, 0.0, 0.0))
                while self._pending > 0 and self._receive(0.05) is not None:
                    self._pending -= 1  # the service reads a message only after it has sent the last answer
        self._link.close()

    def reason(self, trouble: int) -> str:
        return REASONS.get(trouble, "")


def find(uri: str = URI, **options: Any) -> Sequence[Found]:
    """The devices that the service on this computer lists."""
    try:
        with Link(uri, 0.2) as link:
            content = parse(link.receive(0.2) or b"") or {}
    except DeviceError as error:
        trouble, _, remedy = str(error).partition("; ")
        return [Found(uri, trouble=trouble.removeprefix(f"inverse3: {uri}: "), remedy=remedy)]
    except Exception as error:  # another program listens at this port
        return [Found(uri, trouble=f"inverse3: {uri}: {error!r:.100}", remedy="start Haply's Inverse service")]
    return [Found(f"{uri} {entry.get('device_id')}") for entry in listed(content, "inverse3")]


def release(**options: Any) -> None:
    """Send zero force after the driver process has died. The last command has expired before."""
    Inverse3Connection(**options).close()


DRIVER = Driver(
    name="inverse3",
    summary="Haply Inverse3, through Haply's Inverse service.",
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
    needs="a running Inverse service; websockets (pip install 'hapscene[serve]')",
    imports=("websockets.client", "websockets.exceptions", "websockets.frames", "websockets.uri"),
    options=(
        Option("uri", URI, "address of the service"),
        Option(
            "field",
            "vector",
            "key of the force in messages: values before service 3.5, vector since",
            ("vector", "values"),
        ),
        Option("x_m", 0.05, "x of the workspace centre in the service's frame [m]"),
        Option("y_m", -0.15, "y of the workspace centre in the service's frame [m]"),
        Option("z_m", 0.17, "z of the workspace centre in the service's frame [m]"),
    ),
    release=release,
    assumptions=(
        "The service stops the force when commands end; the time is not documented.",
        "Force limit, mass, friction and workspace centre are estimates from other software.",
        "The z axis of a VerseGrip is along the handle.",
    ),
)
