"""One end in this process, the other made by hand over a socket: silence, strangers, flood."""

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
from hapscene.handle.handle_loop import new_handle
from hapscene.handle.plant import Plant
from hapscene.records import records
from hapscene.teleoperation import udp_session as module
from hapscene.teleoperation.datagram import MESSAGE, pack
from hapscene.teleoperation.endpoint import Coupling
from hapscene.teleoperation.leader_follower import new_leader
from hapscene.teleoperation.link import Impairment
from hapscene.teleoperation.operation import UP
from hapscene.teleoperation.plate import START_M, explore
from hapscene.teleoperation.udp_session import TickTimer, UdpSession, run_follower

HOST = "127.0.0.1"


def test_a_pace_tells_how_late_it_was_and_skips_what_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    now_ns = [0]

    def sleep(s: float) -> None:
        now_ns[0] += round(s * 1e9) + 20_000

    monkeypatch.setattr(module, "time", SimpleNamespace(perf_counter_ns=lambda: now_ns[0], sleep=sleep))
    timer = TickTimer()
    for _ in range(4):
        timer.await_tick()
        now_ns[0] += 150_000
    assert set(timer.latency_ns) == {20_000} and timer.slipped == 0
    now_ns[0] += 300_000_000
    timer.await_tick()
    assert timer.slipped == 299 and timer.latency_ns[-1] < 1_000_000


@pytest.fixture
def sockets() -> Iterator[tuple[socket.socket, socket.socket, socket.socket]]:
    """The leader's, connected to the follower's; the follower's; and a stranger's."""
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
    """A follower that pulls to one side, sends each datagram twice, and then is silent."""
    told = records(1, MESSAGE)[0]
    for k in range(count):
        told.tick, told.echo, told.p_WT_m = k, -1, (1e-4 * k, 0.0, 0.0)
        for _ in range(2):
            sock.sendto(pack(told, 1, 77, scheme), address)
        time.sleep(1e-3)


@pytest.mark.parametrize("scheme", ["wave", "position"])
def test_when_the_follower_dies_the_motors_let_go_and_the_leader_ends(
    sockets: tuple[socket.socket, socket.socket, socket.socket], scheme: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "PATIENCE_S", 0.3)
    leader, follower, stranger = sockets
    session = new_session(leader, scheme)
    address = leader.getsockname()
    thread = threading.Thread(target=follow_for, args=(follower, address, 300, int(scheme == "wave")))
    thread.start()
    for data in (b"", b"x" * 5000, pack(records(1, MESSAGE)[0], 1, 5)):
        stranger.sendto(data, address)
    follower.sendto(b"no datagram of ours", address)
    went = session.run(60.0)
    thread.join()
    assert went["ended"] == "the peer has been silent for 0.3 s"
    heard = went["received"]
    assert 50 < heard["accepted"] <= 300 and heard["duplicate"] > 50  # a machine that is held up drops some
    assert heard["malformed"] == 1
    if scheme == "position":
        assert went["force_max_N"] > 0.5  # it did pull
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
    assert went["ended"] == "it was stopped"
    assert went["ticks"] + went["slipped_ticks"] > 20
    assert went["received"]["malformed"] > 50


def test_a_leader_without_a_follower_says_what_would_help(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "WAIT_S", 0.05)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as nobody:
        nobody.bind((HOST, 0))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.connect(nobody.getsockname())
            session = new_session(sock)
            with pytest.raises(HapsceneError, match=r"no follower answers at 127\.0\.0\.1:.*teleoperate follower"):
                session.run(60.0)


def test_ends_tied_by_different_schemes_say_so(sockets: tuple[socket.socket, socket.socket, socket.socket]) -> None:
    leader, follower, _ = sockets
    session = new_session(leader, "wave")
    follower.sendto(pack(records(1, MESSAGE)[0], 1, 77, scheme=0), leader.getsockname())
    with pytest.raises(HapsceneError, match="the same --scheme"):
        session.run(1.0)


# Two real processes on this machine, over UDP, with loss and reordering.


LINE = "Impairment(delay_s=0.02, jitter_s=0.003, loss=0.1, reorder=0.1)"

FOLLOWER = f"""
import json
from hapscene.teleoperation.udp_session import Coupling, Impairment, run_follower
print(json.dumps(run_follower(("127.0.0.1", 0), "127.0.0.1", "wood", Coupling(), {LINE})))
"""

LEADER = f"""
import json, sys
from hapscene.teleoperation.udp_session import Coupling, Impairment, UdpSession, run_leader
receive = UdpSession._receive
def told(session):
    before, heard = session.filter_.counts["accepted"], receive(session)
    if before < 500 <= session.filter_.counts["accepted"]:
        print("it has heard enough", flush=True)
    return heard
UdpSession._receive = told
address = ("127.0.0.1", int(sys.argv[1]))
print(json.dumps(run_leader(address, "medium", "inverse", Coupling(), {LINE}, duration_s=60.0)))
"""


def start(code: str, *words: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-c", code, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


@pytest.mark.skipif(sys.platform == "win32", reason="SIGINT to another process")
def test_two_processes_stay_passive_over_a_bad_line_and_end_at_ctrl_c() -> None:
    follower = start(FOLLOWER)
    leader = None
    try:
        assert follower.stdout is not None
        ready = follower.stdout.readline()
        assert ready.startswith("a follower listens at 127.0.0.1:"), follower.stderr and follower.stderr.read()
        leader = start(LEADER, ready.rsplit(":", 1)[1].strip())
        assert leader.stdout is not None
        leader.stdout.readline()
        leader.stdout.readline()
        leader.send_signal(signal.SIGINT)
        told = [process.communicate(timeout=120.0) for process in (leader, follower)]
    finally:
        for process in (leader, follower):
            if process is not None and process.poll() is None:
                process.kill()
    assert leader.returncode == follower.returncode == 0, told
    led, followed = (json.loads(out.splitlines()[-1]) for out, _ in told)
    assert led["ended"] == "it was stopped" and followed["ended"] == "the peer has ended"
    for went in (led, followed):
        assert went["received"]["accepted"] > 100 and went["lost_by_impairment"] > 10
        assert went["received"]["overtaken"] > 10
        assert went["received"]["malformed"] == went["received"]["foreign"] == 0
        assert went["force_in_silence_N"] == 0.0
    assert led["work_of_motors_mJ"] + followed["work_of_motors_mJ"] < 2.0


def test_an_address_of_another_machine_cannot_be_listened_at() -> None:
    with pytest.raises(HapsceneError, match=r"192\.0\.2\.1:1: cannot be used"):
        run_follower(("192.0.2.1", 1), "127.0.0.1", "wood", Coupling(), Impairment())
