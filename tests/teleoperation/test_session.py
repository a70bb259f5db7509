"""One end in this process, the other made by hand over a socket: silence, strangers, flood."""

import json
import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from hapscene.constants import ACCELERATION_RATE_HZ
from hapscene.contact.world import records
from hapscene.device.omni import Omni
from hapscene.errors import HapsceneError
from hapscene.handle.loop import new_handle
from hapscene.handle.plant import Plant
from hapscene.teleoperation import session as module
from hapscene.teleoperation.coupling import Coupling
from hapscene.teleoperation.datagram import pack
from hapscene.teleoperation.leader import new_leader
from hapscene.teleoperation.message import MESSAGE
from hapscene.teleoperation.operation import UP
from hapscene.teleoperation.session import Session
from hapscene.teleoperation.site import START_M, explore

HOST = "127.0.0.1"


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


def new_session(sock: socket.socket, scheme: str = "wave") -> Session:
    handle = new_handle(Plant(), Plant(), "inverse", ACCELERATION_RATE_HZ)
    side = new_leader(Omni(), handle, Coupling(scheme), START_M, UP)
    session = Session(side, sock, explore("medium", 500.0).intent)
    session.rehearse()
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
    heard = went["heard"]
    assert 50 < heard["let in"] <= 300 and heard["duplicate"] > 50  # a machine that is held up drops some
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
    assert went["heard"]["malformed"] > 50


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
