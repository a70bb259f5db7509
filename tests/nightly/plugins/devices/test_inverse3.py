"""The Inverse3's driver: messages as published, both spellings, grips, events."""

import threading

import numpy as np
import pytest
from websockets.sync.server import serve

from hapscene_plugins.devices.inverse3 import DRIVER, IGNORED, TRANSFORMED


def turn(device, count: int) -> None:
    for _ in range(count):
        device.read()
        device.state.f_D_N = (3.0, 0.0, 4.0)
        device.write()


@pytest.mark.parametrize("field", ["vector", "values"])
def test_force_in_the_service_s_spelling_and_within_its_limit(field: str, emulate) -> None:
    service = emulate("inverse3")
    service.set(ready=1, values=field == "values", speed=0.25)
    with DRIVER.open(uri=service.place, field=field) as device:
        turn(device, 20)
        np.testing.assert_allclose(device.state.p_DT_m[0], (0.01, 0.02, -0.01), atol=1e-9)
        np.testing.assert_array_equal(device.state.v_DT_m_s[0], (0.25, 0.0, 0.0))
        np.testing.assert_allclose(service.rows()[-1][1:], (1.2, 0.0, 1.6), atol=1e-6)


def test_an_unknown_key_of_the_force_is_reported(emulate) -> None:
    service = emulate("inverse3")
    service.set(ready=1, values=1)
    with DRIVER.open(uri=service.place) as device:
        turn(device, 80)
        assert device.state.trouble[0] == IGNORED and "field=values" in device.reason(IGNORED)


def test_each_state_message_counts_once_and_events_do_not(emulate) -> None:
    service = emulate("inverse3")
    service.set(ready=1, events=1)
    with DRIVER.open(uri=service.place) as device:
        turn(device, 50)
        assert device.state.count[0] <= len(service.rows()) + 1  # and the one as it connects
        assert device.state.count[0] > 40


def test_buttons_and_orientation_of_both_grips(emulate) -> None:
    service = emulate("inverse3")
    with DRIVER.open(uri=service.place) as device:
        for wireless, buttons in ((0, 1), (1, 5), (1, 2)):
            service.set(wireless=wireless, buttons=buttons)
            for _ in range(200):  # a command appears in the state after next, or later where the service has no time
                turn(device, 5)
                if device.state.buttons[0] == buttons:
                    break
            assert device.state.buttons[0] == buttons
            np.testing.assert_allclose(device.state.R_DT[0], np.diag((-1.0, -1.0, 1.0)), atol=1e-12)


def test_positions_that_are_moved_take_no_force(emulate) -> None:
    service = emulate("inverse3")
    service.set(ready=1, moved=1)
    with DRIVER.open(uri=service.place) as device:
        turn(device, 5)
        assert device.state.trouble[0] == TRANSFORMED and device.state.ready[0] == 0


def test_another_service_on_the_port_is_not_an_inverse3() -> None:
    with serve(lambda socket: socket.send('{"inverse3": 5}'), "127.0.0.1", 0) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        assert DRIVER.find(uri=f"ws://127.0.0.1:{server.socket.getsockname()[1]}") == []
        server.shutdown()
