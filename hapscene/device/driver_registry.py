"""The registry of drivers: all entry points of the group `hapscene.devices`."""

import atexit
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from hapscene.device.driver import Connection, Driver, OptionValue
from hapscene.errors import DeviceError
from hapscene.plugin_registry import PluginRegistry

__all__ = ["DRIVERS", "DeviceChoice", "choose", "open"]

GROUP: Final = "hapscene.devices"
"""Name of the entry-point group of drivers."""

DRIVERS: Final = PluginRegistry(GROUP, "device", Driver, DeviceError)


@dataclass(frozen=True)
class DeviceChoice:
    """A driver name with options. A `Servo` opens it in its own process.

    Attributes:
        name: name of the driver.
        options: options of the driver; strings are converted.
    """

    name: str
    options: Mapping[str, OptionValue] = field(default_factory=dict)

    def open(self) -> Connection:
        """Open the device. It is closed at the exit of the program at the latest.

        Raises:
            DeviceError: unknown driver, invalid option, or no usable device.
        """
        driver, options = self.checked()
        assert driver.open is not None
        connection = driver.open(**options)
        atexit.register(connection.close)  # may be called twice
        return connection

    def checked(self, handle: bool = False) -> tuple[Driver, dict[str, OptionValue]]:
        """The driver and its converted options. Opens nothing.

        Args:
            handle: True for a driver that plays vibrations, False for one with a position.

        Raises:
            DeviceError: unknown driver, invalid option, or a driver of the other kind.
        """
        driver = DRIVERS.load(self.name)
        if handle and driver.open_handle is None:
            raise DeviceError(f"{self.name!r} is a position device and plays no vibrations: use --device {self.name}")
        if not handle and driver.open is None:
            raise DeviceError(f"{self.name!r} is a handle and has no position: use --handle {self.name}")
        return driver, driver.read_options(self.options)


def open(name: str, /, **options: OptionValue) -> Connection:
    """Open a device by the name of its driver: `with hapscene.device.open("falcon", firmware="falcon.bin") as device:`.

    Raises:
        DeviceError: unknown driver, invalid option, or no usable device.
    """
    return DeviceChoice(name, options).open()


def choose(name: str, /, **options: OptionValue) -> DeviceChoice:
    """A device for a `Servo`: `Servo(scene, hapscene.device.choose("falcon", firmware="falcon.bin"))`."""
    return DeviceChoice(name, options)
