"""The page server of a study session, driven by messages and over its socket."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Event
from typing import Any

import pytest

pytest.importorskip("websockets", reason="websockets is not installed: pip install 'hapscene[serve]'")
from websockets.sync.client import connect

from hapscene.errors import StudyError
from hapscene.study.plan import parse_plan
from hapscene.study.session import Session, load_rows
from hapscene.study.study_server import GAP_S, StudyServer
from hapscene.study.trial_order import Interval
from tests.virtual_clock import BEGIN_NS, VirtualClock

PATIENCE_S = 120.0

SECRETS = ("zebra", "yak", "secretblock", "wood", "paper")

PLAN = """
title = "Surfaces"
people = 4
seed = 2
consent = "I take part of my own free will."
instructions = "Listen, then answer."
[stimuli.zebra]
swatch = "wood"
[stimuli.yak]
swatch = "paper"
[[blocks]]
name = "secretblock1"
kind = "rating"
stimuli = ["zebra", "yak"]
repeats = 2
question = "How real is it?"
labels = ["not at all", "just like it"]
[[blocks]]
name = "secretblock2"
kind = "2ifc"
pairs = [["zebra", "yak"]]
repeats = 2
[[blocks]]
name = "secretblock3"
kind = "2ifc"
pairs = [["zebra", "yak"]]
repeats = 2
"""


class FakePlayer:
    """Plays in zero time, unless it is blocked."""

    def __init__(self) -> None:
        self.played: list[Interval] = []
        self.made: list[tuple[Interval, int]] = []  # and how many had been played by then
        self.fault, self.free, self.closed = "", Event(), False
        self.free.set()

    def ready(self, interval: Interval) -> Callable[[], None]:
        self.made.append((interval, len(self.played)))

        def play() -> None:
            assert self.free.wait(PATIENCE_S)
            if self.fault:
                raise StudyError(self.fault)
            self.played.append(interval)

        return play

    def close(self) -> None:
        self.closed = True
        self.free.set()

    def report(self) -> dict[str, float]:
        return {}


Asked = tuple[StudyServer, Session, FakePlayer]


@pytest.fixture
def ask(tmp_path: Path) -> Iterator[Callable[..., Asked]]:
    """Starts the session of a participant, with an open page."""
    opened: list[Any] = []

    def begin(text: str = PLAN, person: str = "P01") -> Asked:
        session, player = Session(parse_plan(text), tmp_path / "answers", person), FakePlayer()
        server = StudyServer(session, player, clock=VirtualClock())
        server.__enter__()
        opened[:] = [server, session]
        return server, session, player

    yield begin
    for one in opened:
        one.close()


def order(server: StudyServer, **expected: Any) -> None:
    server.take(expected)


def await_play(server: StudyServer) -> None:
    """Wait until the requested intervals are played."""
    server._lane.submit(bool).result(PATIENCE_S)
    assert not server.state()["playing"]


def play_all(server: StudyServer) -> dict[str, Any]:
    """Play all intervals of the trial."""
    state = server.state()
    order(server, play=[state["number"], 0, len(state["intervals"])])
    await_play(server)
    return server.state()


def answer_all(server: StudyServer, session: Session, upto: int | None = None) -> list[dict[str, Any]]:
    """Answer trials, and return the states that the page showed."""
    shown = []
    while session.trial is not None and session.done != upto:
        state = server.state()
        if state["screen"] != "trial":
            order(server, **{"continue": True})
            continue
        shown.append(play_all(server))
        order(server, answer=[state["number"], 0, 0.5])
    return shown


def test_a_complete_session(ask: Callable[..., Asked], tmp_path: Path) -> None:
    server, session, player = ask()
    shown = answer_all(server, session)
    assert server._clock.now_s() == pytest.approx(1e-9 * BEGIN_NS + 4 * GAP_S)  # between the intervals of four pairs
    ends = {"rating": ("not at all", "just like it"), "pair": ()}
    assert len(shown) == 8 and all(tuple(state["ends"]) == ends[state["kind"]] for state in shown)
    rows = load_rows(tmp_path / "answers" / "results.csv")
    assert len(rows) == session.total == 8 and server.ended.is_set() and server.state()["screen"] == "end"
    assert {row["latency_s"] for row in rows} == {"0.500"} and {row["replays"] for row in rows} == {"0"}
    names = [interval.stimulus.name for interval in player.played]
    asked = [row[f"stimulus_{k}"] for row in rows for k in (1, 2) if row[f"stimulus_{k}"] != "NA"]
    assert names == asked
    server.__exit__()
    session.close()
    with pytest.raises(RuntimeError, match="shutdown"):
        server._lane.submit(bool)
    with pytest.raises(ConnectionRefusedError):
        connect(server.url.replace("http", "ws") + "socket", open_timeout=5.0)
    assert player.closed
    again, *_ = ask()
    assert again.ended.is_set() and again.state()["screen"] == "end"


def test_the_page_does_not_receive_what_is_compared(ask: Callable[..., Asked]) -> None:
    server, session, _ = ask()
    shown: list[str] = []
    origin: Any = "/".join(server.url.split("/")[:3])
    with connect(server.url.replace("http", "ws") + "socket", origin=origin) as tab:
        shown.append(str(tab.recv()))
        while session.trial is not None:
            state = server.state()
            if state["screen"] != "trial":
                tab.send('{"continue": true}')
            else:
                tab.send(json.dumps({"play": [state["number"], 0, len(state["intervals"])]}))
                while json.loads(shown[-1]).get("played") != list(range(len(state["intervals"]))):
                    shown.append(str(tab.recv()))
                tab.send(json.dumps({"answer": [state["number"], 0, 1.0]}))
            shown.append(str(tab.recv()))
    assert len(shown) > 30
    for text in shown:
        assert not any(secret in text for secret in SECRETS), text
        assert not {"correct", "level", "block", "stimulus", "seed"} & json.loads(text).keys()


def test_an_answer_needs_all_intervals_and_counts_once(ask: Callable[..., Asked]) -> None:
    server, session, player = ask()
    order(server, **{"continue": True})
    number = server.state()["number"]
    order(server, answer=[number, 0, 1.0])
    for first, end in ((0, 3), (-1, 1), (1, 1), (True, 1), (0, 1.0), (0, True)):
        order(server, play=[number, first, end])
    order(server, play=[number + 1, 0, 1])
    await_play(server)
    assert session.done == 0 and not player.made
    play_all(server)
    for choice, latency_s in ((-1, 1.0), (99, 1.0), (True, 1.0), (0, -1.0), (0, 1e9), (0, "x"), (0, None), (0.0, 1.0)):
        order(server, answer=[number, choice, latency_s])
    order(server, answer=[number + 1, 0, 1.0])
    assert session.done == 0
    order(server, answer=[number, 0, 1.0])
    order(server, answer=[number, 0, 1.0])  # the key was pressed twice
    assert session.done == 1


def test_a_fault_is_shown_and_answers_are_kept(ask: Callable[..., Asked]) -> None:
    server, session, player = ask()
    answer_all(server, session, upto=2)
    player.fault = "headphones: plays no more: was it unplugged?"
    order(server, **{"continue": True})
    order(server, play=[server.state()["number"], 0, 1])
    await_play(server)
    assert "was it unplugged" in server.state()["error"] and session.done == 2
    player.fault, made = "", len(player.made)
    order(server, play=[server.state()["number"], 0, 1])  # the session has ended
    await_play(server)
    assert len(player.made) == made
    order(server, answer=[server.state()["number"], 0, 1.0])
    assert session.done == 2


def test_messages_are_ignored_while_an_interval_plays(ask: Callable[..., Asked]) -> None:
    server, _, player = ask()
    order(server, **{"continue": True})
    number = server.state()["number"]
    player.free.clear()
    for _ in range(2):
        order(server, play=[number, 0, 1])
    assert server.state()["playing"]
    player.free.set()
    await_play(server)
    assert len(player.played) == 1


def test_invalid_messages_have_no_effect(ask: Callable[..., Asked]) -> None:
    server, session, _ = ask()
    order(server, **{"continue": True})
    values: list[Any] = [None, True, -1, 10**400, "x", "", [], {}, [[]], [1, 2, 3], [None] * 3, [0, 0, float("nan")]]
    for key in ("go", "play", "answer", "error"):
        for value in values:
            order(server, **{key: value})
    for value in ("", [], 7, None):
        server.take(value)
    assert server.state()["screen"] == "trial" and not server.fault and session.done == 0


def test_a_resumed_session_begins_at_the_next_trial(ask: Callable[..., Asked]) -> None:
    server, session, _ = ask()
    answer_all(server, session, upto=3)
    server.close()
    session.close()
    again, resumed, _ = ask()
    assert resumed.done == 3 and again.state()["screen"] == "begin"
    order(again, **{"continue": True})
    assert again.state()["number"] == 3
    answer_all(again, resumed)
    assert resumed.done == 8
