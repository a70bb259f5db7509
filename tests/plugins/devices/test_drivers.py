"""Contract of all drivers: force only while the device is ready, and zero force however the driver ends."""

import importlib
import sys
from types import SimpleNamespace
from typing import Any, NamedTuple

import pytest

from hapscene.device.driver import Driver
from hapscene.errors import DeviceError


class Case(NamedTuple):
    """A driver with its emulator. In `options`, {place} is the address of the emulator. `homed`: the option is set."""

    name: str
    options: dict[str, Any]
    homed: bool = False
    elsewhere: dict[str, float] = {}  # noqa: RUF012

    @property
    def driver(self) -> Driver:
        driver = importlib.import_module(f"hapscene_plugins.devices.{self.name}").DRIVER
        assert isinstance(driver, Driver)
        return driver

    def filled(self, place: str, ready: bool = True) -> dict[str, Any]:
        texts = {name: value.format(place=place) for name, value in self.options.items()}
        return self.driver.read_options(texts | ({"homed": "yes"} if self.homed and ready else {}))


CASES = [
    Case("falcon", {"backend": "usb_wire"}, elsewhere={"count0": -400}),
    Case("haply2diy", {"port": "{place}"}, homed=True, elsewhere={"first": 160, "second": 20}),
    Case("inverse3", {"uri": "{place}"}, elsewhere={"x": 0.1}),
    Case("woodenhaptics", {"backend": "usb_wire"}, homed=True, elsewhere={"b": 4000}),
]
case = pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)


@pytest.mark.parametrize("name", ["haply2diy", "handle_serial"])
def test_ports_are_found_with_what_is_in_the_way(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    driver = Case(name, {}).driver
    (found,) = driver.find(**driver.read_options({"port": "/nowhere"}))
    assert "no such port" in found.trouble and "--option port" in found.remedy
    own = {"device": "/dev/null", "description": "board"}
    there = [SimpleNamespace(**own, vid=vid) for vid in (None, 5)]
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: there)
    assert [found.where for found in driver.find()] == ["/dev/null (board)"]  # only ports on USB


@pytest.mark.parametrize("name", [*(case.name for case in CASES), "spacemouse", "replay", "network"])
def test_find_raises_nothing_where_nothing_is_plugged_in(name: str) -> None:
    driver = Case(name, {}).driver
    for found in driver.find(**driver.read_options({})):
        assert found.where and bool(found.trouble) == bool(found.remedy)


def test_a_package_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "usb.core", None)
    driver = Case("falcon", {}).driver
    with pytest.raises(DeviceError, match=r"pip install 'hapscene\[usb\]'"):
        driver.open()
    (found,) = driver.find()
    assert found.trouble and found.remedy == "pip install 'hapscene[usb]'"
