"""`hapscene teleoperate`, as typed."""

import argparse

import pytest

from hapscene.command.teleoperate import add_teleoperate
from hapscene.errors import HapsceneError


def parse(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_teleoperate(parser.add_subparsers())
    return parser.parse_args(["teleoperate", *words])


def test_options_are_milliseconds_and_shares() -> None:
    from hapscene.command.teleoperate import _session

    options = parse("follower", "--delay", "50", "--jitter", "10", "--loss", "0.1", "--reorder", "0.2")
    line = _session(options)["impairment"]
    assert (line.delay_s, line.jitter_s, line.loss, line.reorder) == (0.05, 0.01, 0.1, 0.2)


@pytest.mark.parametrize(
    "words",
    [
        ("leader", "--peer", "nowhere"),
        ("leader", "--loss", "2"),
        ("follower", "--port", "70000"),
        ("follower", "--delay", "-1"),
    ],
)
def test_what_cannot_be_is_refused_by_usage(words: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parse(*words)
    assert "error:" in capsys.readouterr().err


def test_to_be_reached_from_elsewhere_one_says_by_whom() -> None:
    options = parse("follower", "--host", "0.0.0.0", "--port", "0")
    with pytest.raises(HapsceneError, match="--allow who may lead"):
        options.command(options)


def test_a_hand_that_does_not_hold_is_refused() -> None:
    options = parse("leader", "--grip", "none")
    with pytest.raises(HapsceneError, match="does not hold the tool"):
        options.command(options)


@pytest.mark.nightly
def test_nobody_follows(monkeypatch: pytest.MonkeyPatch) -> None:
    from hapscene.teleoperation import udp_session

    monkeypatch.setattr(udp_session, "WAIT_S", 0.05)
    options = parse("leader", "--peer", "127.0.0.1:9", "--duration", "1")
    with pytest.raises(HapsceneError, match=r"no follower answers at 127\.0\.0\.1:9"):
        options.command(options)
