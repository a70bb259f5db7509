"""The interface of drivers: defaults, options, and the limit of a force."""

import math
from typing import Any

import numpy as np
import pytest

from hapscene.device.driver import BUTTON_ROOM, DRIVER_FIELDS, Connection, Driver, Option, clip_force, new_state
from hapscene.device.driver_registry import DeviceChoice
from hapscene.errors import DeviceError

OPTIONS = (
    Option("port", None, "port"),
    Option("baud", 9600, "speed [bit/s]"),
    Option("gain", 0.5, "gain"),
    Option("homed", False, "homed"),
    Option("hardware", "v3", "version", ("v2", "v3")),
)


def driver(**more: Any) -> Driver:
    return Driver("toy", "A toy.", **more)


def test_only_the_magnitude_of_a_force_is_limited() -> None:
    assert clip_force((3.0, 0.0, -4.0), 2.5) == pytest.approx((1.5, 0.0, -2.0))
    assert clip_force((3.0, 0.0, -4.0), 6.0) == (3.0, 0.0, -4.0)
    for none in ((0.0, 0.0, 0.0), (math.nan, 1.0, 1.0), (1.0, -math.inf, 1.0)):
        assert clip_force(none, 2.0) == (0.0, 0.0, 0.0)


def test_nothing_is_known_at_the_start() -> None:
    (state,) = new_state()
    assert np.array_equal(state.R_DT, np.eye(3)) and np.isnan([state.heat, state.gripper_rad, *state.v_DT_m_s]).all()
    assert not any(np.any(state[name]) for name in ("p_DT_m", "buttons", "ready", "count", "trouble", "f_D_N"))
    assert state.button_log.shape == (BUTTON_ROOM, 3) and DRIVER_FIELDS[-1] == "f_D_N"


def test_properties_by_default() -> None:
    made = driver(force=False)
    assert (made.continuous_N, made.heat_s, made.speed_m_s, made.watchdog_s) == (math.inf, 10.0, 2.0, math.inf)
    assert (made.low_D_m, made.high_D_m) == ((-math.inf,) * 3, (math.inf,) * 3)
    assert (made.orientation, made.simulated, made.button_count, made.rate_Hz) == (False, False, 0, 0.0)
    assert made.find() == () and made.open is None and driver().force
    with pytest.raises(DeviceError, match=r"toy.*model"):
        driver(open=Connection)
    for fine in ({"force": False}, {"simulated": True}):
        assert driver(open=Connection, **fine).open is Connection


def test_options_have_the_type_of_their_default() -> None:
    read = driver(options=OPTIONS).read_options
    defaults = {"port": None, "baud": 9600, "gain": 0.5, "homed": False, "hardware": "v3"}
    assert read({}) == defaults and read({"baud": 1.5}) == defaults | {"baud": 1.5}  # only text is converted
    texts = {"port": "COM3", "baud": "115200", "gain": "1e-3", "homed": "Yes", "hardware": "v2"}
    assert read(texts) == {"port": "COM3", "baud": 115_200, "gain": 1e-3, "homed": True, "hardware": "v2"}
    assert [read({"homed": text})["homed"] for text in ("true", "1", "no", "FALSE", "0")] == [True, True] + 3 * [False]
    for name, text in (("baud", "1.5"), ("gain", "much"), ("homed", "perhaps"), ("hardware", "v4"), ("colour", "red")):
        with pytest.raises(DeviceError, match=name):
            read({name: text})


def test_a_handle_is_no_position_device() -> None:
    assert DeviceChoice("simulated").checked()[1] == {"model": "omni", "grip": "light"}
    assert DeviceChoice("audio").checked(handle=True)[0].name == "audio"
    with pytest.raises(DeviceError, match="no position: use --handle audio"):
        DeviceChoice("audio").checked()
    with pytest.raises(DeviceError, match="no vibrations: use --device simulated"):
        DeviceChoice("simulated").checked(handle=True)


def test_a_connection_does_what_is_optional_by_default() -> None:
    class Toy(Connection):
        closed = 0

        def close(self) -> None:
            self.closed += 1

    with Toy() as toy:
        toy.check()
        assert toy.compiled() is None and toy.reason(0) == "" and "17" in toy.reason(17)
        with pytest.raises(DeviceError, match="calibrates itself"):
            toy.home()
    assert toy.closed == 1
