"""`hapscene device check` against an emulator behind a UDP socket."""

import math
import socket

import numpy as np
import pytest

from hapscene.cli import main
from hapscene.device.driver import Connection, Driver, Option, clip_force
from hapscene.device.model import Device, Limits
from hapscene.device.response_timeout import ResponseTimeout
from hapscene.device.sim.point import PointMass
from tests.device.test_check import MESSAGE, Board


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


def test_a_driver_passes_on_its_emulator(capfd: pytest.CaptureFixture[str]) -> None:
    code = main(["device", "check", f"{__name__}:UDP", "--emulator", f"{__name__}:UdpBoard"])
    lines = capfd.readouterr().out.splitlines()
    assert code == 0 and len(lines) == 16, "\n".join(lines)
    assert sum(line.startswith("skipped") for line in lines) == 1
