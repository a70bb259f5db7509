"""Real devices of a servo: events of their buttons, pose of the tool, states, recovery."""

import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapscene.clock import VIRTUAL
from hapscene.device import DeviceChoice, choose
from hapscene.device.driver import BUTTON_ROOM, VendorConnection, new_state
from hapscene.device.safety import RESUME_S, STALL_S
from hapscene.errors import DeviceError, HapsceneError
from hapscene.loop import SessionLog
from hapscene.loop.driver import BLOCKING, ENDED
from hapscene.loop.servo_state import ButtonEvent, button_events_of
from hapscene.scene.scene import Scene
from tests.until import until
from tests.virtual_servo import VirtualServo


@pytest.fixture
def servo(plate: Scene) -> Iterator[VirtualServo]:
    with VirtualServo(plate, choose("simulated")) as running:
        running.start((0.0, 0.0, 0.05))
        yield running


def press(servo: VirtualServo, buttons: int) -> int:
    """Press buttons in the next tick; return its number."""
    servo.handler.connections[0].state.buttons = buttons
    servo.advance(1)
    return servo.state().tick


def test_each_change_is_one_event_with_its_tick_and_time(servo: VirtualServo) -> None:
    pressed = (0b1, 0b11, 0b11, 0b100)
    ticks = [(press(servo, buttons), 1e-9 * servo._channel.channel[0].done_ns) for buttons in pressed]
    events, count = servo.button_events()
    assert [(event.button, event.pressed) for event in events] == [
        (0, True),
        (1, True),
        (0, False),
        (1, False),
        (2, True),
    ]
    assert [event.tick for event in events] == [ticks[k][0] for k in (0, 1, 3, 3, 3)] and count == 3
    assert [event.time_s for event in events] == pytest.approx([ticks[k][1] for k in (0, 1, 3, 3, 3)], abs=1e-3)
    assert servo.button_events(count) == ([], count)
    tick = press(servo, 0)
    assert [event[:1] + event[2:] for event in servo.button_events(count)[0]] == [(tick, 2, False)]


def test_old_changes_are_dropped_and_the_rest_is_consistent() -> None:
    state = new_state()[0]
    for number in range(3 * BUTTON_ROOM):  # one button, pressed and released in turn
        state.button_log[number % BUTTON_ROOM] = number, 1_000_000_000 * number, (number + 1) % 2
        state.button_count = number + 1
    events, count = button_events_of(state, 0)
    assert count == 3 * BUTTON_ROOM and len(events) == BUTTON_ROOM - 1
    assert events[0] == ButtonEvent(count - BUTTON_ROOM + 1, count - BUTTON_ROOM + 1.0, 0, False)
    assert [event.pressed for event in events] == [bool((event.tick + 1) % 2) for event in events]


def test_a_function_is_called_for_each_event(servo: VirtualServo) -> None:
    events: list[ButtonEvent] = []
    press(servo, 0b1)
    servo.on_button(events.append)
    press(servo, 0b0)
    press(servo, 0b10)
    until(lambda: len(events) == 2, 10.0)
    assert [(event.button, event.pressed) for event in events] == [(0, False), (1, True)]


def test_pose_of_the_tool_in_the_world(plate: Scene) -> None:
    """The device is turned by a quarter about z, and its tool by half a turn about x."""
    X_WD, R_DT = np.eye(4), np.diag((1.0, -1.0, -1.0))
    X_WD[:3, :3] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    with VirtualServo(plate, choose("simulated"), X_WD=X_WD) as servo:
        servo.start((0.0, 0.0, 0.05))
        servo.handler.connections[0].state.R_DT = R_DT
        servo.advance(1)
        X_WT = servo.tool_pose()
    assert np.array_equal(X_WT[:3, :3], X_WD[:3, :3] @ R_DT) and X_WT[3].tolist() == [0.0, 0.0, 0.0, 1.0]
    assert X_WT[:3, 1].tolist() == [1.0, 0.0, 0.0]  # its y axis, which points towards −y of the device


def test_stop_force_ends_with_the_next_start(plate_of: Callable[..., Any]) -> None:
    """The force rises from the first tick on, without the calm of a safety stop."""
    with VirtualServo(plate_of(), choose("simulated")) as servo:
        servo.handler._twins[0].safety.ramp_s, servo.handler._twins[0].safety.calm_s = 0.1, 0.5
        servo.start((0.0, 0.0, 0.001))
        servo.stop_force()
        servo.advance(20)
        assert servo.handler._twins[0].safety.gain[0] == 0.0
        servo.start((0.0, 0.0, 0.001))
        servo.advance(200)
        assert servo.handler._twins[0].safety.gain[0] == 1.0
        servo.repaint(servo.scene)
        assert (servo.handler._twins[0].safety.gain[0], servo.handler._twins[0].safety.rise_s[0]) == (0.0, RESUME_S)
        servo.advance(200)
        servo.pause()
        servo.resume()
        assert (servo.handler._twins[0].safety.gain[0], servo.handler._twins[0].safety.rise_s[0]) == (0.0, 0.1)


def test_modes_and_recovery_from_a_fault(plate: Scene) -> None:
    servo = VirtualServo(plate, choose("simulated"))
    assert servo.mode == "ended"
    with servo:
        servo.start((0.0, 0.0, 0.05))
        servo.advance(10)
        assert servo.mode == "running"
        failed = servo.handler.connections[0]
        failed.state.ready = 0
        servo.advance(1)
        assert servo.mode == "stopped"
        failed.state.ready = 1
        servo.advance(1)
        assert servo.mode == "running"
        press(servo, 0b1)

        def fail() -> None:
            raise DeviceError("the cable is out")

        failed.read = fail  # type: ignore[method-assign]
        servo.advance(2)
        assert servo.mode == "error"
        with pytest.raises(DeviceError, match="cable"):
            servo.state()
        servo.recover()
        assert servo.mode == "paused" and servo.handler.connections[0] is not failed
        tick = servo.state().tick
        servo.resume()
        servo.advance(10)
        assert servo.mode == "running" and servo.state().tick == tick + 10
        events, _ = servo.button_events()  # the button is up on the device that was opened again
        assert [event.pressed for event in events] == [True, False]
        with pytest.raises(HapsceneError, match="no device waits"):
            servo.handler.connections[0].state.ready = 0
            servo.home()
    assert servo.mode == "ended"


def test_fault_noted_again_during_recovery_ends(plate: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    with VirtualServo(plate, choose("simulated")) as servo:
        servo.start((0.0, 0.0, 0.05))
        opening = DeviceChoice.open

        def open_late(choice: DeviceChoice) -> Any:
            servo.handler._note_fault(DeviceError("no frames"))
            return opening(choice)

        monkeypatch.setattr(DeviceChoice, "open", open_late)
        servo.recover()
        assert servo.mode == "paused"


def test_a_device_that_stays_away_leaves_the_fault(plate: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    with VirtualServo(plate, choose("simulated")) as servo:
        servo.start((0.0, 0.0, 0.05))

        def gone(choice: DeviceChoice) -> None:
            raise DeviceError("not connected")

        monkeypatch.setattr(DeviceChoice, "open", gone)
        with pytest.raises(HapsceneError, match="not connected"):
            servo.recover()
        assert servo.mode == "error"
        monkeypatch.undo()
        servo.recover()
        assert servo.mode == "paused"


def test_servo_without_watchdog_ends_the_force(plate: Scene) -> None:
    with VirtualServo(plate, choose("simulated")) as servo:
        servo.start((0.0, 0.0, 0.05))
        servo.advance(10)
        device, sent_N = servo.handler.connections[0], list[float]()
        state = device.state
        device.write = lambda: sent_N.append(float(state.f_D_N[0, 2]))  # type: ignore[method-assign]
        servo.advance(3)
        state.f_D_N = 1.0
        servo.handler.check_devices(watched=False)
        assert not state.f_D_N.any() and servo.mode == "error"
        assert len(sent_N) == 4 and sent_N[-1] == 0.0
        with pytest.raises(DeviceError, match="watchdog"):
            servo.state()


def test_end_waits_for_the_loop_after_an_interrupted_pause(plate: Scene) -> None:
    """A signal may interrupt the wait for the last tick; devices are closed when that tick is over."""
    with VirtualServo(plate, choose("simulated")) as servo:
        servo.start((0.0, 0.0, 0.05))
        handler, waited = servo.handler, []

        def stop() -> None:
            waited.append(True)
            if len(waited) == 1:
                raise KeyboardInterrupt

        handler._stop = stop
        with pytest.raises(KeyboardInterrupt):
            handler.pause()
        handler.end()
        assert len(waited) == 2


def test_a_vendor_s_device_is_scheduled_checked_and_closed(
    plate: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    acts, wrong = list[Any](), dict[str, Exception]()

    def note(name: str) -> Callable[..., None]:
        def call(device: Any, *given: int) -> None:
            acts.append(name if name != "unschedule" else (name, int(row.waiting)))
            if name in wrong:
                raise wrong[name]

        return call

    names = ("read", "write", "check", "close", "schedule", "unschedule", "home")
    vendor = type("Vendor", (VendorConnection,), {name: note(name) for name in names})
    monkeypatch.setattr(DeviceChoice, "open", lambda choice: vendor())
    with VirtualServo(plate, choose("simulated"), log_folder=tmp_path, force_N=0.25) as servo:
        handler, row = servo.handler, servo._channel.channel[0]
        assert handler._twins[0].safety.force_N == 0.25
        servo.start((0.0, 0.0, 0.05))
        assert acts == ["read", "schedule"] and (row.pause, row.waiting) == (0, 0)
        handler._calls[0]()  # as the vendor's thread does
        assert servo.state().tick == 0
        handler.connections[0].state.trouble = 7
        handler.check_devices()
        assert acts[2:] == ["check"] and "7" in servo.notice
        servo.home()
        assert acts[3:] == [("unschedule", BLOCKING), "home", "schedule"]
        wrong["check"] = OSError("lost")
        handler.check_devices()
        assert acts[6:] == ["check", ("unschedule", BLOCKING)] and (row.pause, row.waiting) == (1, ENDED)
        assert servo.mode == "error" and not list(tmp_path.iterdir())
        handler.check_devices()  # a paused device is not checked
        assert len(acts) == 8 and [SessionLog.load(one).reason for one in tmp_path.iterdir()] == ["OSError: lost"]
        assert str(tmp_path) in capsys.readouterr().err
        servo.recover()
        servo.resume()
        assert acts[8:] == ["close", "schedule"]
        wrong["unschedule"] = DeviceError("no answer")
        monkeypatch.setattr(os, "kill", lambda *given: acts.append(given))
        servo.pause()
        assert acts[-1] == (os.getpid(), getattr(signal, "SIGKILL", signal.SIGTERM))
        assert len(list(tmp_path.iterdir())) == 2


def test_threads_of_vendors_have_clocks_of_their_own(plate: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """They remove the force if the loop has stopped. A time in the loop's clock would become the span of its sleep."""
    silent = dict.fromkeys(("read", "write", "check", "close", "schedule", "unschedule"), lambda device, *given: None)
    monkeypatch.setattr(DeviceChoice, "open", lambda choice: type("Vendor", (VendorConnection,), silent)())
    with VirtualServo(plate, [choose("simulated")] * 2) as servo:
        servo.start([(0.0, 0.0, 0.05)] * 2)
        servo.advance(1)
        calls, devices = servo.handler._calls, servo.handler.connections
        clocks = [servo.clock.buffer, *(call._argument.clock for call in calls)]  # type: ignore[attr-defined]
        for k, force_N in ((0, 1.0), (1, 1.0), (0, 0.0)):
            devices[k].state.f_D_N, others = 1.0, np.delete(clocks, k + 1, axis=0)
            calls[k]()
            assert (devices[k].state.f_D_N == force_N).all()
            assert np.array_equal(np.delete(clocks, k + 1, axis=0), others)
            clocks[k + 1][VIRTUAL] += round(1.1e9 * STALL_S)
        servo.pause()
        servo.resume()
        servo.pause()
        devices[0].state.f_D_N = 1.0
        servo.handler._calls[0]()
        assert not devices[0].state.f_D_N.any()
