"""The Falcon's driver against a Falcon at the wire, and its geometry against another way to solve it."""

import ctypes
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

from hapscene.clock import VIRTUAL, new_clock
from hapscene.device.driver import new_state
from hapscene.device.response_timeout import GONE_S, PAUSE_S
from hapscene.device.serial_port import DISCONNECTED, REFUSED
from hapscene.errors import DeviceError
from hapscene.records import records
from hapscene_plugins.devices import falcon_board, usb_transfers
from hapscene_plugins.devices.falcon import DRIVER
from hapscene_plugins.devices.falcon_kinematics import (
    COUNT_RAD,
    LEG,
    MIDDLE_M,
    TURN,
    UNIT_MAX,
    ZERO_RAD,
    forward,
    motor_units,
)
from tests.virtual_clock import VirtualClock

START = (0.0, 0.0, MIDDLE_M)


def angles(p: np.ndarray) -> np.ndarray:
    """(3,) of the legs at a place in F: inverse kinematics, in closed form."""
    a, b, c, links, f, r, s = LEG
    found = []
    for cos, sin in TURN:
        u, v, w = cos * p[0] + sin * p[1] - r + c, -sin * p[0] + cos * p[1] - s + f, p[2]
        rho = links + math.sqrt(b * b - v * v)
        # a knee at (a cos θ, a sin θ), ρ from (u, w): u cos θ + w sin θ = (u² + w² + a² − ρ²)/2a
        size = math.hypot(u, w)
        found.append(math.atan2(w, u) - math.acos((u * u + w * w + a * a - rho * rho) / (2 * a * size)))
    return np.array(found)


def places(count: int) -> np.ndarray:
    rng = np.random.default_rng(3)
    return np.array((0.0, 0.0, 0.12)) + rng.uniform(-0.04, 0.04, (count, 3))


def test_forward_kinematics_are_those_of_the_loops_closing() -> None:
    """All nine unknowns at once: the grip, and of each shin how it is inclined and turned."""
    a, b, c, links, f, r, s = LEG

    def gaps(x: np.ndarray, theta: np.ndarray) -> np.ndarray:
        out = []
        for (cos, sin), angle, incline, skew in zip(TURN, theta, x[3:6], x[6:9], strict=True):
            reach = links + b * math.sin(skew)
            out += [
                cos * x[0] + sin * x[1] - r - (a * math.cos(angle) - c + reach * math.cos(incline)),
                -sin * x[0] + cos * x[1] - s - (b * math.cos(skew) - f),
                x[2] - (a * math.sin(angle) + reach * math.sin(incline)),
            ]
        return np.array(out)

    for p in places(20):
        theta = angles(p)
        solved = least_squares(
            gaps, (0, 0, 0.11, 1.5, 1.5, 1.5, 1.5, 1.5, 1.5), args=(theta,), xtol=1e-15, ftol=1e-15, gtol=1e-15
        )
        found = forward(tuple(theta.tolist()), START)
        assert np.abs(solved.fun).max() < 1e-9
        np.testing.assert_allclose(found, solved.x[:3], atol=1e-7)


def test_inverse_then_forward_is_where_it_was() -> None:
    for p in places(300):
        np.testing.assert_allclose(forward(tuple(angles(p).tolist()), START), p, atol=1e-7)


@pytest.mark.parametrize(("count", "z_m", "units"), [(-1463, 0.075, 135), (-516, 0.11, 242), (872, 0.17, 158)])
def test_published_counts_and_units(count: int, z_m: float, units: int) -> None:
    theta = (count * COUNT_RAD + ZERO_RAD,) * 3
    p = forward(theta, START)
    np.testing.assert_allclose(p, (0, 0, z_m), atol=3e-5)
    assert motor_units((0.0, 0.0, 1.0), p, theta) == (-units,) * 3


def test_force_and_motors_do_the_same_work() -> None:
    for p in places(20):
        theta, f, step = angles(p), np.array((1.0, -2.0, 0.5)), np.array((1e-6, 2e-6, -1e-6))
        turned = angles(p + step) - theta
        units = motor_units(tuple(f), tuple(p), tuple(theta.tolist()))
        assert np.dot(units, turned) * -1e-4 == pytest.approx(f @ step, rel=2e-2, abs=1e-9)


def test_motors_saturate_before_the_wire_does() -> None:
    p = (0.0, 0.0, 0.125)
    theta = tuple(angles(np.array(p)).tolist())
    small, large = (np.array(motor_units((f, 0.0, f), p, theta)) for f in (1.0, 1000.0))
    assert np.abs(large).max() == UNIT_MAX
    np.testing.assert_allclose(large / UNIT_MAX, small / np.abs(small).max(), atol=5e-3)


def test_bytes_as_published() -> None:
    message = np.zeros(16, np.uint8)
    falcon_board.pack(message, (0, 0, 0), 0)
    assert message.tobytes() == b"<AAAAAAAAAAAAAA>"
    assert falcon_board.REST == b"<AAAAAAAAAAAAJA>"
    falcon_board.pack(message, (-1447, 0, 0), 0)
    assert message[1:5].tobytes() == b"JFKP"
    packet = np.frombuffer(b"<JFKPAAAAPPPP" + bytes([0x41 + 0x74]) + b"A>", np.uint8).copy()
    assert falcon_board.is_packet(packet) and [falcon_board.encoder_count(packet, i) for i in range(3)] == [
        -1447,
        0,
        -1,
    ]
    for at, byte in ((0, 0x3D), (1, 0x40), (12, 0x51), (13, 0x40), (13, 0xC1), (15, 0x3D)):
        wrong = packet.copy()
        wrong[at] = byte
        assert not falcon_board.is_packet(wrong), at


class Bus:
    """A USB line without libusb, for compiled code: its transfers end when their events are handled.

    Attributes:
        arrived: transfers of the device that have arrived.
        late: a transfer that arrives 0.1 ms after a wait for it begins.
        sent: packets that the device has received.
        answer: transfer that arrives after each packet.
        status: how the next transfers end; `PENDING` for never.
    """

    def __init__(self, clock: np.ndarray) -> None:
        self.arrived: list[bytes] = []
        self.late, self.answer, self.status, self.clock = b"", b"", usb_transfers.COMPLETED, clock
        self.sent: list[bytes] = []
        self.transfers = [records(1, usb_transfers.TRANSFER)[0] for _ in range(3)]
        self.transfers[0].status = self.transfers[1].status = usb_transfers.PENDING
        place = ctypes.c_size_t
        self.functions = (
            ctypes.CFUNCTYPE(ctypes.c_int, place)(self._submit),
            ctypes.CFUNCTYPE(ctypes.c_int, place, place, place)(self._handle_events),
        )
        state, buffers = records(1, usb_transfers.LINE)[0], np.zeros((3, usb_transfers.PACKET), np.uint8)
        state.submit, state.handle_events = (ctypes.cast(f, ctypes.c_void_p).value for f in self.functions)
        own = np.arange(3, dtype=np.uint64), buffers, np.zeros(usb_transfers.PACKET, np.uint8), np.zeros(2, np.int64)
        self.line = usb_transfers.UsbLine(state, tuple(self.transfers), *own)

    def _submit(self, k: int) -> int:
        if k == 2:
            self.sent.append(self.line.buffers[2, : self.transfers[2].length].tobytes())
            self.arrived += [self.answer] if self.answer else []
            self.transfers[2].status = self.status
        return 0

    def _handle_events(self, context: int, wait: int, done: int) -> int:
        k, wait_ns = int(self.line.state.turn), 1000 * int(self.line.wait[1])
        if wait_ns and self.late:
            self.arrived, self.late, wait_ns = [self.late], b"", 100_000
        self.clock[VIRTUAL] += wait_ns
        if self.arrived:
            data = self.arrived.pop(0)
            self.line.buffers[k, : len(data)] = np.frombuffer(data, np.uint8)
            self.transfers[k].actual_length, self.transfers[k].status = len(data), self.status
        return 0


STATUS, FAR = b"\x01\x60", (-516, -500, -530)


def packet(counts: tuple[int, ...] = FAR, bits: int = falcon_board.HOMED) -> bytes:
    """A packet of the device, as its sources give it: '<', four nibbles for each encoder, low first, bits, '>'."""
    return b"<" + bytes(0x41 + (n >> 4 * k & 15) for n in counts for k in range(4)) + bytes((0x41 + bits, 0x41)) + b">"


class Falcon:
    """The compiled reads and writes of a Falcon on a `Bus`, with a virtual clock; a tick every millisecond."""

    def __init__(self) -> None:
        self.clock, self.board, self.state = new_clock(10**12), records(1, falcon_board.BOARD)[0], new_state()[0]
        self.bus = Bus(self.clock)
        self.board.polled_ns, self.board.p = 10**12, START
        buffers = np.zeros(usb_transfers.PACKET + falcon_board.SIZE, np.uint8), np.zeros(falcon_board.SIZE, np.uint8)
        self.given = falcon_board.Board(self.board, self.state, self.bus.line, *buffers, self.clock)

    def tick(self, *arrived: bytes, after_ms: float = 1.0, late: bytes = b"") -> bool:
        """Receive transfers, with the two bytes of status that begin each; whether the state was renewed."""
        count, self.bus.late = int(self.state.count), STATUS + late if late else b""
        self.bus.arrived += [STATUS + data for data in arrived]
        self.clock[VIRTUAL] += round(1e6 * after_ms)
        falcon_board.read_board(self.given)
        return bool(self.state.count > count)

    def write(self, *force_N: float) -> bytes:
        self.state.f_D_N = force_N
        falcon_board.write_board(self.given)
        return self.bus.sent[-1]


def homed_falcon() -> Falcon:
    falcon = Falcon()
    for k in range(falcon_board.HOMED_COUNT):
        assert falcon.state.ready == 0 and falcon.tick(packet()), k
    assert (falcon.state.ready, falcon.state.trouble) == (1, 0)
    return falcon


def test_packets_are_found_in_any_division_into_transfers() -> None:
    falcon, theta = Falcon(), tuple(n * COUNT_RAD + ZERO_RAD for n in FAR)
    x, y, z = forward(theta, START)
    whole = packet(bits=falcon_board.HOMED | 5)
    assert falcon.tick(b"A<A", whole[:7], b"", whole[7:12]) is False and falcon.tick(whole[12:] + whole[:3])
    np.testing.assert_allclose(falcon.state.p_DT_m, (x, MIDDLE_M - z, y), atol=1e-12)
    np.testing.assert_allclose(falcon.board.theta, theta)
    assert falcon.state.buttons == 5 and falcon.board.homed == 1 and falcon.board.unread == 3
    newest = packet((-400, -400, -400), falcon_board.HOMED | 2)
    assert falcon.tick(whole[3:] + packet() + newest) and falcon.state.count == 2  # the newest counts
    assert falcon.state.buttons == 2 and falcon.board.unread == 0
    np.testing.assert_allclose(falcon.board.theta, -400 * COUNT_RAD + ZERO_RAD)


def test_force_needs_consecutive_homed_packets_and_a_known_position() -> None:
    falcon = homed_falcon()
    falcon.tick(packet(bits=0x30))  # one of three arms is not homed
    assert (falcon.state.ready, falcon.state.trouble, falcon.board.homed) == (0, 1, 0)
    falcon, before = homed_falcon(), 0
    before = falcon.state.copy()
    assert not falcon.tick(packet((3_000, -500, -530)))  # no position of the grip has these counts
    assert falcon.state.ready == 0 and np.array_equal(falcon.state.p_DT_m, before.p_DT_m)


def test_motors_get_the_limited_force_of_a_ready_falcon() -> None:
    assert Falcon().write(0.0, 0.0, 1.0) == falcon_board.REST
    falcon = homed_falcon()
    for f_D_N, share in (((1.0, -2.0, 0.5), 1.0), ((0.0, 12.0, 16.0), 0.4)):
        sent = np.frombuffer(falcon.write(*f_D_N), np.uint8).copy()
        x, y, z = np.multiply(f_D_N, share)
        wanted = motor_units((x, z, -y), falcon.board.p, falcon.board.theta)
        assert tuple(falcon_board.encoder_count(sent, i) for i in range(3)) == wanted and sent[13] - 0x41 == 1 | 2
    assert len(falcon.write(0.0, 0.0, 0.0)) == falcon_board.SIZE


def test_a_tick_waits_only_for_an_answer_that_is_due() -> None:
    """An answer is due 0.9 to 1.3 ms after the packet."""
    for after_ms, waits in ((0.5, False), (0.95, True), (1.25, True), (1.4, False)):
        falcon = homed_falcon()
        falcon.write(0.0, 0.0, 0.0)
        began_ns = int(falcon.clock[VIRTUAL])
        assert falcon.tick(after_ms=after_ms, late=packet()) is waits, after_ms
        assert falcon.clock[VIRTUAL] - began_ns < 1e6 * after_ms + (150_000 if waits else 50_000)
    falcon.write(0.0, 0.0, 0.0)
    began_ns = int(falcon.clock[VIRTUAL])
    assert not falcon.tick(after_ms=1.0)  # no answer
    assert falcon.clock[VIRTUAL] - began_ns == pytest.approx(1_300_000, abs=20_000)


def test_silence_ends_the_force_and_a_pause_does_not() -> None:
    falcon = homed_falcon()
    count = 0
    while falcon.state.ready == 1:
        falcon.tick()
        count += 1
    assert count == pytest.approx(1000 * GONE_S, rel=0.05)
    falcon = homed_falcon()
    assert not falcon.tick(packet(), after_ms=1000.0 * PAUSE_S + 100.0)  # what arrived in a pause is old
    assert falcon.state.ready == 1 and falcon.board.paused == 1 and falcon.board.silent_ns < 1e9 * GONE_S
    assert falcon.tick(packet()) and (falcon.board.paused, falcon.board.silent_ns) == (0, 0)


@pytest.mark.parametrize(
    ("status", "problem"), [(usb_transfers.TIMED_OUT, 0), (usb_transfers.OVERFLOW, 0), (4, DISCONNECTED)]
)
def test_failed_reads_end_the_force(status: int, problem: int) -> None:
    falcon = homed_falcon()
    falcon.bus.status = status
    falcon.tick(packet())
    assert falcon.bus.line.state.problem == problem and falcon.state.ready == (problem == 0)


def test_packets_that_the_device_does_not_accept_are_dropped() -> None:
    falcon = homed_falcon()
    falcon.bus.status = usb_transfers.PENDING
    first = falcon.write(1.0, 0.0, 0.0)
    falcon.clock[VIRTUAL] += 40_000_000
    assert falcon.write(2.0, 0.0, 0.0) == first and falcon.bus.line.state.problem == 0
    falcon.clock[VIRTUAL] += 11_000_000
    falcon.write(2.0, 0.0, 0.0)
    assert falcon.bus.line.state.problem == REFUSED and len(falcon.bus.sent) == 1
    falcon = homed_falcon()
    falcon.bus.status = 4  # stalled
    falcon.write(1.0, 0.0, 0.0)
    falcon.write(1.0, 0.0, 0.0)
    assert falcon.bus.line.state.problem == DISCONNECTED
    falcon.write(1.0, 0.0, 0.0)
    assert len(falcon.bus.sent) == 1


class Usb:
    """A Falcon at a USB port, as `UsbDevice`: its boot loader, and its firmware once that is loaded."""

    def __init__(self, falcon: Falcon) -> None:
        self.falcon, self.loaded, self.baud, self.image, self.echo, self.zero = falcon, False, 0, b"", 1, b""
        self.asked: list[tuple[int, int]] = []
        self.out: list[bytes] = []
        self.last: tuple[Any, ...] | None = None  # what was sent before it was closed
        self.written: list[bytes] = []
        self.ended = 0
        self.buses: list[Bus] = []

    def control(self, request: int, value: int) -> None:
        self.asked.append((request, value))
        self.baud = value if request == 3 else self.baud

    def write(self, endpoint: int, data: bytes) -> None:
        assert endpoint == 0x02
        self.written.append(data)
        if self.baud == 0x4138:
            self.out.append(self.zero + b"\x0a\x44\x2c\x0d" if data == b"\x0a\x43\x0d" else b"?")
        elif self.baud == 0x15:
            self.image, self.loaded = self.image + (b"" if data == b"A" else data), data != b"A"
            self.out.append(self.zero + data if data == b"A" else data[:: self.echo])

    def read(self, endpoint: int, size: int, wait_ms: int) -> bytes:
        assert endpoint == 0x81
        self.falcon.clock[VIRTUAL] += 0 if self.out else 1_000_000 * wait_ms
        return STATUS + (self.out.pop(0) if self.out else b"")

    def transfers(self, ends: tuple[int, int]) -> Any:
        assert ends == (0x81, 0x02)
        self.buses.append(bus := Bus(self.falcon.clock))
        self.falcon.bus, bus.answer = bus, STATUS + packet() if self.loaded else b""
        return SimpleNamespace(line=self.falcon.bus.line, wait=lambda *which: None)

    def end_transfers(self) -> None:
        self.ended += 1

    def close(self, *last: Any) -> None:
        self.last = last


@pytest.fixture
def usb(monkeypatch: pytest.MonkeyPatch) -> Usb:
    made, clock = Usb(Falcon()), VirtualClock()
    clock.buffer = made.falcon.clock
    monkeypatch.setattr("hapscene_plugins.devices.falcon.UsbDevice", lambda *which: made)
    monkeypatch.setattr("hapscene_plugins.devices.falcon.CLOCK", clock)
    monkeypatch.setattr("hapscene_plugins.devices.compiled_connection.new_clock", lambda: clock.buffer)
    return made


@pytest.mark.parametrize("zero", [b"", b"\0"])
def test_boot_handshake_upload_and_run(usb: Usb, zero: bytes, tmp_path: Path) -> None:
    firmware = np.random.default_rng(0).bytes(1_000)
    (tmp_path / "firmware").write_bytes(firmware)
    usb.zero = zero
    with DRIVER.open(firmware=str(tmp_path / "firmware")) as device:
        assert usb.image == firmware
        device.state = new_state()  # as the servo does
        device.write()
        device.read()
        assert device.state.count[0] == 1 and device.reason(1) and not device.reason(0)
    assert usb.last == (0x02, falcon_board.REST)
    run = [(9, 1), (3, 2), (0, 1), (0, 2)]
    boot = [(0, 1), (0, 2), (9, 16), (3, 0x4138), (4, 8), (2, 0), (1, 0x200), (1, 0x100), (1, 0x101)]
    assert usb.asked == [*run, *boot, (1, 0x100), (3, 0x15), *run] and usb.ended == 1
    usb.asked.clear()
    usb.written.clear()
    with DRIVER.open():  # it runs already
        assert usb.asked == run
    DRIVER.release()
    assert usb.asked == 2 * run and usb.written == [falcon_board.REST] * 2 and usb.last == ()


@pytest.mark.parametrize(("size", "message"), [(0, "firmware="), (999, "999 bytes"), (65_537, "65,537"), (2, "read")])
def test_an_invalid_firmware_file_is_refused(usb: Usb, size: int, message: str, tmp_path: Path) -> None:
    if size > 2:
        (tmp_path / "firmware").write_bytes(bytes(size))
    with pytest.raises(DeviceError, match=message):
        DRIVER.open(firmware=str(tmp_path / "firmware") if size else None)
    assert usb.image == b"" and usb.last == ()


def test_errors_while_the_firmware_is_loaded(usb: Usb, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "firmware").write_bytes(b"firmware" * 125)
    usb.echo = -1
    with pytest.raises(DeviceError, match="byte 0"):
        DRIVER.open(firmware=str(tmp_path / "firmware"))
    usb.loaded, usb.echo = False, 1
    monkeypatch.setattr(usb, "transfers", lambda ends: SimpleNamespace(line=usb.falcon.bus.line, wait=lambda *which: 0))
    usb.falcon.bus.answer = b""
    with pytest.raises(DeviceError, match="does not start"):
        DRIVER.open(firmware=str(tmp_path / "firmware"))
    monkeypatch.setattr(usb, "write", lambda *sent: None)
    with pytest.raises(DeviceError, match="boot loader"):
        DRIVER.open(firmware=str(tmp_path / "firmware"))
    for problem, words in ((DISCONNECTED, "disconnected"), (REFUSED, "accepts no data")):
        usb.falcon.bus.line.state.problem, usb.last = problem, None
        with pytest.raises(DeviceError, match=words):
            DRIVER.open()
        assert usb.last == ()
