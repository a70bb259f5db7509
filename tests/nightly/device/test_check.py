"""`hapscene device check` against emulators behind a pseudo-terminal and a UDP socket."""

import math
import socket

import numpy as np
import pytest

from hapscene.cli import main
from hapscene.device.driver import Connection, Driver, Option, clip_force
from hapscene.device.emulator import Emulator
from hapscene.device.model import Device, Limits
from hapscene.device.response_timeout import ResponseTimeout
from hapscene.device.sim.point import PointMass
from hapscene.geometry import Vector
from hapscene_plugins.devices.haply2diy_board import ANSWER, HARDWARE, ID, SETUP, TORQUES
from hapscene_plugins.devices.haply2diy_kinematics import arm_torques, forward
from tests.device.test_check import MESSAGE, Board

THETA_DEG = (120.0, 60.0)


class Haply2diyBoard(Emulator):
    """The board of a 2DIY, whose arms do not move."""

    def message_size(self, data: bytes) -> int:
        return 26 if data[0] == SETUP else TORQUES.size

    def force_N(self, message: bytes) -> Vector | None:
        if message[0] == SETUP:
            return None
        _, _, second, first = TORQUES.unpack(message)
        theta, base_m = tuple(np.radians(THETA_DEG)), HARDWARE["v3"].base_m
        p = forward(theta, base_m)
        torques = [arm_torques(unit, p, theta, base_m) for unit in ((-0.1, 0.0), (0.0, -0.1))]
        x, y = 0.1 * np.linalg.solve(np.transpose(torques), (first, second))
        return float(x), float(y), 0.0

    def answer(self, message: bytes, position_m: Vector) -> bytes:
        turned_deg = 1000.0 * position_m[0] if math.isnan(position_m[0]) or position_m[0] > 0.05 else 0.0
        first, second = THETA_DEG
        return b"" if message[0] == SETUP else ANSWER.pack(ID, second - turned_deg, first + turned_deg)


class UdpBoard(Board):
    transport = "udp"


class UdpConnection(Connection):
    def __init__(self, host: str, port: int) -> None:
        super().__init__()
        self._socket, self._timeout = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), ResponseTimeout()
        self._socket.connect((host, port))
        self._socket.setblocking(False)
        self._closed = False
        self.write()

    def read(self) -> None:
        try:
            while True:
                data = self._socket.recv(64)
                p = MESSAGE.unpack(data) if len(data) == MESSAGE.size else (math.nan,)
                if np.isfinite(p).all() and np.abs(p).max() < 1.0:
                    self.state.p_DT_m, self.state.ready = p, 1
                    self.state.count += 1
                    self._timeout.received()
        except BlockingIOError:
            pass
        self._timeout.check(self, "udp", "start the device")

    def write(self) -> None:
        force_N = self.state.f_D_N[0] if self.state.ready[0] else np.zeros(3)
        self._socket.send(MESSAGE.pack(*clip_force(force_N, 3.0)))

    def close(self) -> None:
        if not self._closed:
            self._socket.send(MESSAGE.pack(0.0, 0.0, 0.0))
            self._socket.close()
        self._closed = True


UDP = Driver(
    name="udp",
    summary="A board on UDP.",
    open=UdpConnection,
    model=Device("udp", PointMass(0.1, 0.5, 0.1, 1e-6), Limits(3.0)),
    options=(Option("host", "127.0.0.1", "address"), Option("port", 0, "UDP port")),
    watchdog_s=0.02,
)


@pytest.mark.parametrize(
    ("driver", "emulator", "skipped"),
    [(["haply2diy"], "Haply2diyBoard", 0), ([f"{__name__}:UDP"], "UdpBoard", 1)],
)
def test_a_driver_passes_on_its_emulator(
    driver: list[str], emulator: str, skipped: int, capfd: pytest.CaptureFixture[str]
) -> None:
    code = main(["device", "check", *driver, "--emulator", f"{__name__}:{emulator}"])
    lines = capfd.readouterr().out.splitlines()
    assert code == 0 and len(lines) == 16, "\n".join(lines)
    assert sum(line.startswith("skipped") for line in lines) == skipped
