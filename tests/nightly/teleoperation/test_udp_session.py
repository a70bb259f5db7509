"""UDP sessions: one end in this process, and datagrams from the test; then two processes."""

import json
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hapscene.constants import ACCELERATION_RATE_HZ
from hapscene.device.sim.omni import Omni
from hapscene.errors import HapsceneError
from hapscene.handle.handle_record import new_handle
from hapscene.handle.plant import Plant
from hapscene.records import records
from hapscene.teleoperation import udp_session as module
from hapscene.teleoperation.datagram import MESSAGE, pack
from hapscene.teleoperation.endpoint import Coupling
from hapscene.teleoperation.leader_follower import new_leader
from hapscene.teleoperation.operation import UP
from hapscene.teleoperation.plate import START_M, explore
from hapscene.teleoperation.udp_session import TickTimer, UdpSession, run_follower

HOST = "127.0.0.1"


def test_timer_measures_latency_and_skips_ticks(monkeypatch: pytest.MonkeyPatch) -> None:
    now_ns = [0]

    def sleep(s: float) -> None:
        now_ns[0] += round(s * 1e9) + 20_000

    monkeypatch.setattr(module, "time", SimpleNamespace(perf_counter_ns=lambda: now_ns[0], sleep=sleep))
    timer = TickTimer()
    for _ in range(4):
        timer.await_tick()
        now_ns[0] += 150_000
    assert set(timer.latency_ns) == {20_000} and timer.skipped == 0
    now_ns[0] += 300_000_000
    timer.await_tick()
    assert timer.skipped == 299 and timer.latency_ns[-1] < 1_000_000


@pytest.fixture
def sockets() -> Iterator[tuple[socket.socket, socket.socket, socket.socket]]:
    """Sockets of a leader, connected to the follower; of the follower; and of an unknown sender."""
    made = tuple(socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(3))
    leader, follower, stranger = made
    follower.bind((HOST, 0))
    leader.bind((HOST, 0))
    leader.connect(follower.getsockname())
    try:
        yield leader, follower, stranger
    finally:
        for each in made:
            each.close()


def new_session(sock: socket.socket, scheme: str = "wave") -> UdpSession:
    handle = new_handle(Plant(), Plant(), "inverse", ACCELERATION_RATE_HZ)
    side = new_leader(Omni(), handle, Coupling(scheme), START_M, UP)
    session = UdpSession(side, sock, explore("medium", 500.0).intent)
    session.compile_first_tick()
    return session


def follow_for(sock: socket.socket, address: Any, count: int, scheme: int = 1) -> None:
    """A follower that pulls to one side, sends each datagram twice, and then stops."""
    outgoing = records(1, MESSAGE)[0]
    for k in range(count):
        outgoing.tick, outgoing.echo, outgoing.p_WT_m = k, -1, (1e-4 * k, 0.0, 0.0)
        for _ in range(2):
            sock.sendto(pack(outgoing, 1, 77, scheme), address)
        time.sleep(1e-3)


@pytest.mark.parametrize("scheme", ["wave", "position"])
def test_leader_ends_without_force_when_the_follower_is_silent(
    sockets: tuple[socket.socket, socket.socket, socket.socket], scheme: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "SILENCE_MAX_S", 0.3)
    leader, follower, stranger = sockets
    session = new_session(leader, scheme)
    address = leader.getsockname()
    thread = threading.Thread(target=follow_for, args=(follower, address, 300, int(scheme == "wave")))
    thread.start()
    for data in (b"", b"x" * 5000, pack(records(1, MESSAGE)[0], 1, 5)):
        stranger.sendto(data, address)
    follower.sendto(b"not a datagram", address)
    went = session.run(60.0)
    thread.join()
    assert went["ended"] == "no message from the peer for 0.3 s"
    received = went["received"]
    assert 50 < received["accepted"] <= 300 and received["duplicate"] > 50  # a busy machine drops some
    assert received["malformed"] == 1
    if scheme == "position":
        assert went["force_max_N"] > 0.5  # the leader was pulled
    assert went["force_in_silence_N"] == 0.0
    json.dumps(went, allow_nan=False)


def test_a_flood_does_not_stop_the_loop(sockets: tuple[socket.socket, socket.socket, socket.socket]) -> None:
    leader, follower, stranger = sockets
    session = new_session(leader)
    address = leader.getsockname()
    over = threading.Event()

    def flood() -> None:
        junk = np.random.default_rng(0).bytes(152)
        while not over.is_set():
            for _ in range(200):
                stranger.sendto(junk, address)
                follower.sendto(junk, address)
            time.sleep(1e-3)

    thread = threading.Thread(target=flood)
    thread.start()
    follow_for(follower, address, 5)
    until = time.monotonic() + 0.3
    went = session.run(60.0, lambda: time.monotonic() > until)
    over.set()
    thread.join()
    assert went["ended"] == "stopped"
    assert went["ticks"] + went["skipped_ticks"] > 20
    assert went["received"]["malformed"] > 50


def test_a_leader_without_a_follower_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "CONNECT_S", 0.05)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as silent:
        silent.bind((HOST, 0))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.connect(silent.getsockname())
            session = new_session(sock)
            with pytest.raises(HapsceneError, match="no follower answers"):
                session.run(60.0)


def test_different_schemes_are_an_error(sockets: tuple[socket.socket, socket.socket, socket.socket]) -> None:
    leader, follower, _ = sockets
    session = new_session(leader, "wave")
    follower.sendto(pack(records(1, MESSAGE)[0], 1, 77, scheme=0), leader.getsockname())
    with pytest.raises(HapsceneError, match="--scheme"):
        session.run(1.0)


# Two processes on this machine, over UDP.


FOLLOWER = """
import json
from hapscene.teleoperation.udp_session import Coupling, run_follower
print(json.dumps(run_follower(("127.0.0.1", 0), "127.0.0.1", "wood", Coupling())))
"""

LEADER = """
import json, sys
from hapscene.teleoperation.udp_session import Coupling, UdpSession, run_leader
receive = UdpSession._receive
def counted(session):
    before, received = session.filter.counts["accepted"], receive(session)
    if before < 500 <= session.filter.counts["accepted"]:
        print("500 messages received", flush=True)
    return received
UdpSession._receive = counted
address = ("127.0.0.1", int(sys.argv[1]))
print(json.dumps(run_leader(address, "medium", "inverse", Coupling(), duration_s=60.0)))
"""


def start(code: str, *words: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-c", code, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


@pytest.mark.skipif(sys.platform == "win32", reason="SIGINT to another process")
def test_two_processes_are_passive_and_end_at_ctrl_c() -> None:
    follower = start(FOLLOWER)
    leader = None
    try:
        assert follower.stdout is not None
        ready = follower.stdout.readline()
        assert ready.startswith("follower listening at 127.0.0.1:"), follower.stderr and follower.stderr.read()
        leader = start(LEADER, ready.rsplit(":", 1)[1].strip())
        assert leader.stdout is not None
        leader.stdout.readline()
        leader.stdout.readline()
        leader.send_signal(signal.SIGINT)
        outputs = [process.communicate(timeout=120.0) for process in (leader, follower)]
    finally:
        for process in (leader, follower):
            if process is not None and process.poll() is None:
                process.kill()
    assert leader.returncode == follower.returncode == 0, outputs
    led, followed = (json.loads(out.splitlines()[-1]) for out, _ in outputs)
    assert led["ended"] == "stopped" and followed["ended"] == "ended by the peer"
    for went in (led, followed):
        assert went["received"]["accepted"] > 100
        assert went["received"]["malformed"] == went["received"]["foreign"] == 0
        assert went["force_in_silence_N"] == 0.0
    assert led["work_of_motors_mJ"] + followed["work_of_motors_mJ"] < 2.0


def test_an_address_of_another_machine_is_an_error() -> None:
    with pytest.raises(HapsceneError, match=r"192\.0\.2\.1:1"):
        run_follower(("192.0.2.1", 1), "127.0.0.1", "wood", Coupling())
