"""The 2DIY's driver: bytes as published, and its pantograph."""

import os
import struct
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np
import pytest

from hapscene.clock import VIRTUAL
from hapscene.errors import DeviceError
from hapscene_plugins.devices.haply2diy import DRIVER
from hapscene_plugins.devices.haply2diy_board import ANSWER, HARDWARE, ID, MIDDLE_M, TORQUES, run_message, setup_message
from hapscene_plugins.devices.haply2diy_kinematics import TORQUE_MAX_N_m, arm_torques, forward
from tests.virtual_clock import PATIENCE_S


def test_setup_is_by_port() -> None:
    assert setup_message(HARDWARE["v3"]) == bytes.fromhex("01 05 03 01 01 03 01 01 00 00") + struct.pack(
        "<4f", 12, 4880, 168, 4880
    )
    assert setup_message(HARDWARE["v2"]) == bytes.fromhex("01 05 03 00 01 03 00 01 00 00") + struct.pack(
        "<4f", -61, 10752, 241, 10752
    )
    assert run_message((0.0, 0.0)) == bytes((2, 5)) + bytes(8)
    assert run_message((0.5, -0.25)) == bytes.fromhex("02 05 00 00 80 be 00 00 00 3f")


def test_pantograph_as_published() -> None:
    np.testing.assert_allclose(forward(np.radians((12.0, 168.0)), 0.038), (0.019, -0.0606), atol=5e-5)
    np.testing.assert_allclose(forward(np.radians((168.0, 12.0)), 0.038), (0.019, 0.03574), atol=5e-5)
    assert np.isnan(forward((1.0, 1.0), 0.0)).all()  # elbow on elbow: anywhere


@pytest.mark.parametrize("hardware", HARDWARE)
def test_force_and_motors_do_the_same_work(hardware: str) -> None:
    rng, base = np.random.default_rng(1), HARDWARE[hardware].base_m
    for theta in rng.uniform((1.9, 0.3), (2.8, 1.2), (50, 2)):
        p, f, step = np.array(forward(theta, base)), rng.uniform(-0.2, 0.2, 2), rng.uniform(-1e-6, 1e-6, 2)
        moved = np.array(forward(theta + step, base)) - p
        assert np.dot(arm_torques(f, p, theta, base), step) == pytest.approx(moved @ f, rel=1e-3, abs=1e-10)
        large = arm_torques(1000.0 * f, p, theta, base)
        assert np.abs(large).max() == pytest.approx(TORQUE_MAX_N_m)


def test_a_missing_port_is_an_error(tmp_path) -> None:
    with pytest.raises(DeviceError, match="haply2diy: /nowhere: cannot be opened"):
        DRIVER.open(port="/nowhere")
    (found,) = DRIVER.find(port="/nowhere")
    assert "no such port" in found.trouble and "--option port" in found.remedy


STARTED = setup_message(HARDWARE["v3"]) + run_message((0.0, 0.0))
"""What the board receives first."""


def received(board: int, count: int) -> bytes:
    """The next bytes that the board receives; a pseudo-terminal may deliver them in parts."""
    data = b""
    while len(data) < count:
        with suppress(BlockingIOError):
            data += os.read(board, count - len(data))
    return data


@pytest.fixture
def wire() -> Iterator[tuple[int, Any]]:
    """The board's end of a serial line, and a connection whose arms are at their marks."""
    tty = pytest.importorskip("tty", reason="this system has no pseudo-terminals")
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    os.set_blocking(ours, False)
    with DRIVER.open(port=os.ttyname(theirs), homed=True) as device:
        os.close(theirs)
        assert received(ours, len(STARTED)) == STARTED
        yield ours, device
    with suppress(OSError):
        os.close(ours)


def place_of(first_deg: float) -> float:
    return MIDDLE_M - forward(np.radians((first_deg, 180.0 - first_deg)), HARDWARE["v3"].base_m)[1]


def answer(first_deg: float) -> bytes:
    return ANSWER.pack(ID, 180.0 - first_deg, first_deg)


def test_the_newest_of_many_answers_counts(wire: tuple[int, Any]) -> None:
    board, device = wire
    angles = np.linspace(120.0, 130.0, 101)  # a starved board answers all messages at once: more than one read takes
    os.write(board, b"".join(map(answer, angles)))
    for _ in range(4):
        device.read()
    assert device.state.ready[0] == 1 and device.state.count[0] == 101
    assert device.state.p_DT_m[0, 1] == pytest.approx(place_of(130.0), abs=1e-7)


def test_torques_of_the_force(wire: tuple[int, Any]) -> None:
    board, device = wire
    first, second = np.radians((121.0, 65.0))
    os.write(board, ANSWER.pack(ID, 65.0, 121.0))
    device.read()
    p = forward((first, second), HARDWARE["v3"].base_m)
    np.testing.assert_allclose(device.state.p_DT_m[0], (0.019 - p[0], MIDDLE_M - p[1], 0.0), atol=1e-6)
    for f_D_N, ready, f_H_N in (
        ((0.2, -0.3, 5.0), 1, (-0.2, 0.3)),
        ((0.2, -0.3, 5.0), 0, (0.0, 0.0)),
        ((np.nan, 0.0, 0.0), 1, (0.0, 0.0)),
        ((0.0, np.inf, 0.0), 1, (0.0, 0.0)),
    ):
        device.state.f_D_N, device.state.ready = f_D_N, ready
        device.write()
        sent = TORQUES.unpack(os.read(board, 4096))[:1:-1]
        np.testing.assert_allclose(sent, arm_torques(f_H_N, p, (first, second), HARDWARE["v3"].base_m), atol=1e-6)
    port = device._port.name.split()[-1]
    for stop in (device.close, lambda: DRIVER.release(port=port)):
        stop()
        assert received(board, TORQUES.size) == run_message((0.0, 0.0))


def test_force_needs_arms_that_were_at_their_marks(wire: tuple[int, Any]) -> None:
    board, device = wire
    device._board.homed = 0
    os.write(board, answer(121.0))
    device.read()
    assert (device.state.ready[0], device.state.trouble[0]) == (0, 1) and "calibrated" in device.reason(1)
    device.home()
    assert received(board, len(STARTED)) == STARTED
    os.write(board, answer(150.0))  # no jump: the board counts from the marks
    device.read()
    assert (device.state.ready[0], device.state.trouble[0], device.reason(0)) == (1, 0, "")


def test_implausible_angles_are_not_used(wire: tuple[int, Any]) -> None:
    board, device = wire
    for message, count in (
        (answer(121.0), 1),
        (ANSWER.pack(ID, 58.0, 142.0), 1),  # the first arm jumps by 21°
        (answer(140.9), 2),
        (ANSWER.pack(ID, 721.0, 140.0), 2),  # beyond two turns
        (ANSWER.pack(ID + 1, 40.0, 140.0), 2),
        (answer(np.nan), 2),
    ):
        os.write(board, message)
        device.read()
        assert device.state.count[0] == count
        device.write()  # after which the answers start afresh
    assert device.state.p_DT_m[0, 1] == pytest.approx(place_of(140.9), abs=1e-7)


def test_answers_arrive_in_parts_and_start_afresh_after_random_bytes(wire: tuple[int, Any]) -> None:
    board, device = wire
    for octet in answer(121.0):
        os.write(board, bytes([octet]))
        device.read()
    assert device.state.count[0] == 1
    os.write(board, b"\xff" * 11)
    device.read()
    os.write(board, answer(123.0)[4:])  # the rest of an answer that was sent before the next message
    device.write()
    os.write(board, answer(122.0))
    device.read()
    assert device.state.count[0] == 2
    assert device.state.p_DT_m[0, 1] == pytest.approx(place_of(122.0), abs=1e-7)


def test_messages_stay_complete_if_the_port_is_full(wire: tuple[int, Any]) -> None:
    board, device = wire
    device._clock[VIRTUAL] = 10**12  # passes by its readings only: nothing times out
    os.write(board, answer(120.0))
    device.read()
    sent = b""
    for force_N in np.linspace(0.1, 1.0, 10_000):  # 100 kB; the board reads seldom, and the port holds less
        device.state.f_D_N = (0.0, force_N, 0.0)
        device.write()
        sent += os.read(board, 7) if force_N > 0.5 else b""
    with suppress(BlockingIOError):
        while True:
            sent += os.read(board, 4096)
    whole = [sent[k : k + 10] for k in range(0, len(sent) - 9, 10)]
    torques = np.array([TORQUES.unpack(message) for message in whole])
    assert len(whole) > 400 and (torques[:, :2] == (2, ID)).all()
    assert (np.diff(torques[:, 3]) > 0.0).all() and len(whole) < 10_000  # in order, none twice, later ones dropped


def test_a_port_that_hangs_up_is_an_error_in_the_next_read(wire: tuple[int, Any]) -> None:
    board, device = wire
    os.write(board, answer(120.0))
    device.read()
    os.close(board)
    with pytest.raises(DeviceError, match="disconnected"):
        device.read()
        device.read()
    assert device.state.ready[0] == 0


def test_prepared_release_sends_a_complete_message_in_parts(
    wire: tuple[int, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    board, device = wire
    assert DRIVER.prepare_release is not None
    write = os.write
    monkeypatch.setattr("hapscene.device.serial_port.WRITE_S", PATIENCE_S)  # on a busy machine
    monkeypatch.setattr(os, "write", lambda file, data: write(file, data[:3]))  # the port is nearly full
    DRIVER.prepare_release(port=device._port.name.split()[-1])()
    assert received(board, TORQUES.size) == run_message((0.0, 0.0))
