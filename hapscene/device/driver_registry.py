"""The drivers there are: ours and anybody's, through the entry-point group `hapscene.devices`."""

import atexit
from dataclasses import dataclass, field
from typing import Any, Final

from hapscene.device.driver import Connection, Driver
from hapscene.errors import DeviceError
from hapscene.plugin_registry import PluginRegistry

__all__ = ["DRIVERS", "DeviceChoice", "choose", "open"]

GROUP: Final = "hapscene.devices"
"""Name of the entry-point group that drivers join."""

DRIVERS: Final = PluginRegistry(GROUP, "device", Driver, DeviceError)


@dataclass(frozen=True)
class DeviceChoice:
    """A device by the name of its driver, with options: what a `Servo` opens in its own process.

    Attributes:
        name: of the driver.
        options: as `Driver.options` has them; texts are read.
    """

    name: str
    options: dict[str, Any] = field(default_factory=dict)

    def open(self) -> Connection:
        """Open it. At the latest when the program ends it is closed.

        Raises:
            DeviceError: no such driver, a wrong option, or no device that can be used.
        """
        driver, told = self.checked()
        assert driver.open is not None
        connection = driver.open(**told)
        atexit.register(connection.close)  # twice does no harm
        return connection

    def checked(self, handle: bool = False) -> tuple[Driver, dict[str, Any]]:
        """Its driver, and its options as that reads them, before anything is opened.

        Args:
            handle: whether it shall play vibrations; else it shall have a position.

        Raises:
            DeviceError: no such driver, a wrong option, or a device of the other kind.
        """
        driver = DRIVERS.load(self.name)
        if handle and driver.open_handle is None:
            raise DeviceError(
                f"{self.name!r} plays no acceleration: it is a device to touch with (--device {self.name})"
            )
        if not handle and driver.open is None:
            raise DeviceError(f"{self.name!r} has no position to touch with: it is a handle (--handle {self.name})")
        return driver, driver.read_options(self.options)


def open(name: str, **options: Any) -> Connection:
    """Open the device that the driver `name` drives: `with hapscene.device.open("falcon", firmware=…) as device`.

    Raises:
        DeviceError: no such driver, a wrong option, or no device that can be used.
    """
    return DeviceChoice(name, options).open()


def choose(name: str, **options: Any) -> DeviceChoice:
    """A device for a `Servo`, which opens it: `Servo(scene, hapscene.device.choose("falcon", firmware=…))`."""
    return DeviceChoice(name, options)
