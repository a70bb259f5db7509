"""Clients of engines, each in one file, push a body over the bridge; its momentum is the received impulse."""

import re
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from hapscene.bridge.packets import ANSWER, FRAME, HELLO, ORDER, REFUSED, WELCOME, Packet, pack, pack_json, unpack
from tests.bridge.served import Served

ENGINES = Path(__file__).resolve().parents[3] / "examples" / "engines"
sys.path.insert(0, str(ENGINES / "python"))

from hapscene_client import Client  # noqa: E402


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    served = Served(tmp_path_factory.mktemp("served"))
    yield served
    served.process.kill()
    served.process.wait()


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(argument) for argument in arguments], capture_output=True, text=True, timeout=120.0, check=False
    )


def built(*words: object) -> None:
    """A program that others are made by, without a word from it."""
    done = run(*words)
    assert (done.returncode, done.stdout + done.stderr) == (0, "")


def python(_: Path) -> list[object]:
    return [sys.executable, ENGINES / "python" / "push.py", "{}"]


def godot(folder: Path) -> list[object]:
    shutil.copytree(ENGINES / "godot", folder / "godot")  # it writes beside what it runs
    return ["godot3-server", "--path", folder / "godot", "--port={}"]


def cpp(folder: Path) -> list[object]:
    strict = ("-std=c++17", "-Wall", "-Wextra", "-Werror", "-O1")
    built("g++", *strict, "-o", folder / "push", ENGINES / "cpp" / "push.cpp")
    return [folder / "push", "{}"]


def javascript(_: Path) -> list[object]:
    return ["node", ENGINES / "javascript" / "push.mjs", "{}"]


def csharp(folder: Path) -> list[object]:
    sources = [ENGINES / "csharp" / name for name in ("Push.cs", "HapsceneClient.cs")]
    built("mcs", "-langversion:7", "-warnaserror", f"-out:{folder / 'push.exe'}", *sources)
    return ["mono", folder / "push.exe", "{}"]


NEEDED = {
    godot: ("godot3-server", "godot3-server"),
    cpp: ("g++", "g++"),
    javascript: ("node", "nodejs"),
    csharp: ("mcs", "mono-mcs mono-runtime"),
}


@pytest.fixture(scope="module", params=[python, *NEEDED], ids=lambda engine: engine.__name__)
def engine(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> list[object]:
    """The words that run it, with {} for the port."""
    program, package = NEEDED.get(request.param, (sys.executable, ""))
    if shutil.which(program) is None:
        pytest.skip(f"no {program} here: apt-get install {package}")
    words: list[object] = request.param(tmp_path_factory.mktemp("engine"))
    return words


def pushed(engine: list[object], port: int) -> subprocess.CompletedProcess[str]:
    return run(*(str(word).format(port) for word in engine))


def test_an_engine_pushes_a_crate(served: Served, engine: list[object]) -> None:
    done = pushed(engine, served.port)
    output = done.stdout
    assert done.returncode == 0, output + done.stderr
    found = re.search(r"momentum ([-\d.e]+) received ([-\d.e]+)", output)
    assert found is not None and "began, crate, wood" in output, output
    momentum, got = (float(number) for number in found.groups())
    assert momentum > 1e-3 and momentum == pytest.approx(got, abs=1.1e-6)  # printed to six digits, kept in float32


class Restarted:
    """A server that has another client for `busy` HELLOs, and knows no session from the first FRAME on."""

    def __init__(self, busy: int) -> None:
        self.busy, self.hellos = busy, 0
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.port = self.socket.getsockname()[1]
        self.thread = Thread(target=self._serve)

    def __enter__(self) -> "Restarted":
        self.thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.socket.sendto(b"end", ("127.0.0.1", self.port))
        self.thread.join()
        self.socket.close()

    def _serve(self) -> None:
        known = True
        while (came := self.socket.recvfrom(65536))[0] != b"end":
            packet = unpack(came[0])
            self.hellos += packet.kind == HELLO
            known = known and packet.kind != FRAME
            kind, key = REFUSED, 0
            answer: dict[str, Any] = {"error": "no such session"}
            if packet.kind == HELLO and self.hellos <= self.busy:
                answer = {"error": "another client is here"}
            elif packet.kind == HELLO:
                kind, key = WELCOME, 7
                answer = {"version": 1, "bodies": ["crate"], "swatches": ["plain", "wood"], "tick_s": 1e-3}
            elif packet.kind == ORDER and known:
                kind, key, answer = ANSWER, 7, {"done": "free"}
            elif packet.kind not in (FRAME, ORDER):
                continue
            self.socket.sendto(pack(Packet(kind, key, packet.sequence, pack_json(answer))), came[1])


def test_an_engine_retries_and_reports_a_lost_session(engine: list[object]) -> None:
    with Restarted(busy=2) as server:
        done = pushed(engine, server.port)
    assert server.hellos == 3
    assert done.returncode != 0 and "the session is lost" in done.stdout + done.stderr


def test_a_python_client_can_reconnect() -> None:
    with Restarted(busy=0) as server:
        client = Client(port=server.port)
        assert client.order("free") == {"done": "free"}
        client.frame()
        with pytest.raises(ConnectionError, match="the session is lost"):
            client.poll(5.0)
        with pytest.raises(ConnectionError, match="the session is lost"):
            client.order("start")
        client.close()
        Client(port=server.port).close()
        server.busy = 1_000_000
        with pytest.raises(ConnectionError, match="another client is here"):
            Client(port=server.port, patience_s=0.3)
        assert 3 <= server.hellos <= 6  # it asks now and then, in no hurry
