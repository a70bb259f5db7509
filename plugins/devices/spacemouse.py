"""3Dconnexion SpaceMouse over HID. Its deflection sets the velocity of a point; there is no force.

Reports as in PySpaceMouse (devices.toml): report 1 is x, y, z, followed by the rotation on devices that do not send it
as report 2; report 3 is the buttons. The device's axes: x to the right, y towards the hand, z down.
"""

import importlib
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, Final

import numpy as np

from hapscene.constants import TICK_S
from hapscene.device.driver import Connection, Driver, Found, Option
from hapscene.errors import DeviceError

PRODUCTS: Final = {
    **{(0x256F, product): "SpaceMouse" for product in (0xC62E, 0xC632, 0xC633, 0xC635, 0xC638, 0xC63A, 0xC641, 0xC652)},
    **{(0x046D, product): "SpaceNavigator" for product in (0xC625, 0xC626, 0xC627, 0xC628, 0xC629, 0xC62B)},
}
"""USB ids of the supported devices."""

FULL: Final = 350.0
"""Full deflection [count]."""

REST: Final = 8.0
"""Dead zone [count], for the weight of the hand and the hysteresis of the springs."""

_INSTALL: Final = "pip install 'hapscene[hid]'"
_RULE: Final = (
    'add the line KERNEL=="hidraw*", ATTRS{idVendor}=="256f", TAG+="uaccess" (and one with 046d) to '
    "/etc/udev/rules.d/60-hapscene.rules, and reconnect the device"
)


def _hid(backend: str) -> Any:
    try:
        hid = importlib.import_module(backend)
    except ImportError:
        raise DeviceError(f"spacemouse: hidapi is not installed; {_INSTALL}") from None
    if not hasattr(hid, "device"):  # two packages have the module name hid
        raise DeviceError(f"spacemouse: the module {backend!r} is not hidapi; pip uninstall hid; {_INSTALL}")
    return hid


def _plugged(hid: Any) -> list[dict[str, Any]]:
    """The connected motion controllers: usage page 1, usage 8, or unknown usage."""
    known = [each for each in hid.enumerate() if (each["vendor_id"], each["product_id"]) in PRODUCTS]
    return [each for each in known if (each.get("usage_page", 0), each.get("usage", 0)) in ((1, 8), (0, 0))]


class SpaceMouseConnection(Connection):
    """A SpaceMouse that moves a point."""

    def __init__(self, speed_m_s: float = 0.1, reach_m: float = 0.1, backend: str = "hid") -> None:
        super().__init__()
        hid = _hid(backend)
        plugged = _plugged(hid)
        if not plugged:
            raise DeviceError("spacemouse: not connected")
        self._way_m, self._reach_m = speed_m_s * TICK_S / FULL, reach_m
        self._pushed = np.zeros(3)
        self._device = hid.device()
        try:
            self._device.open_path(plugged[0]["path"])
            self._device.set_nonblocking(1)
        except OSError as error:
            raise DeviceError(f"spacemouse: cannot be opened: {error}; {_RULE}") from None
        self.state.ready = 1

    def read(self) -> None:
        try:
            while report := self._device.read(64):
                self._take(bytes(report))
        except (OSError, ValueError) as error:  # hidapi raises ValueError for a closed device
            raise DeviceError(f"spacemouse: disconnected ({error}); reconnect it") from None
        p = self.state.p_DT_m[0] + self._way_m * self._pushed
        self.state.p_DT_m = np.clip(p, -self._reach_m, self._reach_m)
        self.state.count += 1

    def _take(self, report: bytes) -> None:
        """Process one report. Invalid reports are ignored."""
        if report[0] == 1 and len(report) in (7, 13):
            x, y, z = np.frombuffer(report, "<i2", 3, 1).clip(-FULL, FULL).astype(float)
            pushed = np.array((x, -y, -z))
            self._pushed = np.where(np.abs(pushed) > REST, pushed, 0.0)
        elif report[0] == 3 and 2 <= len(report) <= 8:
            self.state.buttons = int.from_bytes(report[1:], "little") & 0xFFFFFFFF

    def write(self) -> None:
        pass

    def close(self) -> None:
        with suppress(OSError, ValueError):
            self._device.close()


def find(backend: str = "hid", **options: Any) -> Sequence[Found]:
    """The connected devices. Opens each for a moment, to check the permission."""
    try:
        hid = _hid(backend)
    except DeviceError as error:
        trouble, _, remedy = str(error).partition("; ")
        return [Found("HID", trouble=trouble, remedy=remedy)]
    found = []
    for each in _plugged(hid):
        where = f"{each.get('product_string') or PRODUCTS[each['vendor_id'], each['product_id']]}"
        device = hid.device()
        try:
            device.open_path(each["path"])
            found.append(Found(where))
        except OSError as error:
            found.append(Found(where, trouble=f"{where}: cannot be opened: {error}", remedy=_RULE))
        device.close()
    return found


DRIVER = Driver(
    name="spacemouse",
    summary="3Dconnexion SpaceMouse: velocity input for a position, no force.",
    open=SpaceMouseConnection,
    find=find,
    force=False,
    button_count=2,
    needs="hidapi (pip install 'hapscene[hid]'), permission for the device",
    options=(
        Option("speed_m_s", 0.1, "speed at full deflection [m/s]"),
        Option("reach_m", 0.1, "largest distance from the middle on each axis [m]"),
        Option("backend", "hid", "Python module with the interface of hidapi"),
    ),
    assumptions=("Full deflection is 350 counts on each axis.",),
)
