"""Emulated devices: messages, faults, and both ways to reach them."""

import math
import os
import socket
import struct
import threading

import numpy as np
import pytest

from hapscene.device.emulator import JUMP_M, HAND_N_m, serve
from tests.device.test_check import MESSAGE, Board


class Counter(Board):
    """A board whose answers are integers, and whose messages with 0 N command nothing."""

    def force_N(self, message: bytes) -> tuple[float, float, float] | None:  # type: ignore[override]
        force_N = super().force_N(message)
        return force_N if any(force_N) else None

    def answer(self, message: bytes, position_m: tuple[float, float, float]) -> bytes:
        return struct.pack("<3h", *(round(1e5 * part) for part in position_m))


def placed(answers: bytes) -> np.ndarray:
    """Positions of the answers in N of the hand's spring."""
    return np.array(list(MESSAGE.iter_unpack(answers))) * HAND_N_m


def test_messages_in_any_division_are_answered_with_the_position_of_the_hand() -> None:
    board, sent = Board(), MESSAGE.pack(3.0, 0.0, -4.0) + MESSAGE.pack(0.5, -1.0, 0.0)
    assert board.receive(sent[:5]) == b"" and board.message_count == 0
    np.testing.assert_allclose(placed(board.receive(sent[5:] + sent[:1])), [(3.0, 0.0, -4.0), (0.5, -1.0, 0.0)], 1e-6)
    assert (board.last_N, board.largest_N, board.message_count) == ((0.5, -1.0, 0.0), 5.0, 2)
    assert len(board.receive(sent[1:12])) == 12 and board.message_count == 3
    board.receive(MESSAGE.pack(math.nan, 0.0, 0.0))
    assert board.largest_N == math.inf
    counter = Counter()
    assert (
        counter.receive(MESSAGE.pack(3.0, 0.0, -6.0))
        == counter.receive(bytes(12))
        == struct.pack("<3h", 1000, 0, -2000)
    )
    assert (counter.last_N, counter.largest_N) == ((3.0, 0.0, -6.0), pytest.approx(math.hypot(3.0, 6.0)))


def test_faults_change_the_answers() -> None:
    board, message = Board(), MESSAGE.pack(1.0, 2.0, 3.0)
    whole = board.receive(message)
    answers = {}
    for board.fault in ("silence", "truncated", "nan", "random"):
        answers[board.fault] = board.receive(message)
    assert answers["silence"] == b"" and answers["truncated"] == whole[:6]
    assert np.isnan(placed(answers["nan"])).all()
    assert len(answers["random"]) == 12 and answers["random"] != whole
    board.fault, board.message_count = "jump", 0
    x, y, z = placed(board.receive(40 * message)).T
    away = np.flatnonzero(x > 2.0)
    assert away.tolist() == [k - 1 for k in range(1, 41) if k % 20 < 10]
    np.testing.assert_allclose(x[away], 1.0 + HAND_N_m * JUMP_M, 1e-6)
    assert np.ptp(y) == np.ptp(z) == 0.0
    counter = Counter()
    counter.fault = "nan"
    assert len(counter.receive(message)) == 8  # integers have no NaN


def test_a_virtual_serial_port_carries_all_bytes_and_is_removed(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("tty", reason="this system has no pseudo-terminals")
    ends, pair, write = [], os.openpty, os.write
    monkeypatch.setattr(os, "openpty", lambda: ends.append(pair()) or ends[-1])
    monkeypatch.setattr(os, "write", lambda file, data: write(file, data[:5]))  # the port is nearly full
    message = b"\r\n\x03\x04" + MESSAGE.pack(0.0, 1.0, -1.0)[4:]  # raw: no byte has a meaning
    with serve(board := Board()) as options:
        port = os.open(str(options["port"]), os.O_RDWR | os.O_NOCTTY)
        write(port, message)
        answer = b""
        while len(answer) < 12:
            answer += os.read(port, 100)
        os.close(port)
    np.testing.assert_allclose(placed(answer)[0, 1:], (1.0, -1.0), 1e-6)
    assert board.last_N == MESSAGE.unpack(message)
    assert all(thread.name != "hapscene emulator" for thread in threading.enumerate())
    for file in ends[0]:
        with pytest.raises(OSError):
            os.fstat(file)


class Reluctant(Board):
    """A board that does not answer 1 N along x."""

    transport = "udp"

    def answer(self, message: bytes, position_m: tuple[float, float, float]) -> bytes:
        return b"" if self.last_N[0] == 1.0 else super().answer(message, position_m)


def test_a_udp_device_answers_its_sender_only_if_there_is_an_answer() -> None:
    with serve(Reluctant()) as options, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as driver:
        driver.connect((options["host"], options["port"]))
        for x_N in (1.0, 2.0):
            driver.send(MESSAGE.pack(x_N, 0.0, 0.0))
        np.testing.assert_allclose(placed(driver.recv(100)), [(2.0, 0.0, 0.0)], 1e-6)
        assert options["host"] == "127.0.0.1"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind((options["host"], options["port"]))  # it is free again
