"""`hapscene lab teleoperate`, as typed."""

import pytest

from hapscene.cli import main
from hapscene.cli.sessions import SessionOptions


def test_options_are_milliseconds_and_shares() -> None:
    line = SessionOptions(delay=50.0, jitter=10.0, loss=0.1, reorder=0.2).given()["impairment"]
    assert (line.delay_s, line.jitter_s, line.loss, line.reorder) == (0.05, 0.01, 0.1, 0.2)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["leader", "--loss", "2"], "--loss"),
        (["follower", "--delay", "-1"], "--delay"),
        (["follower", "--host", "0.0.0.0", "--port", "0"], "--allow"),
        (["leader", "--grip", "none"], "does not hold the tool"),
    ],
)
def test_what_cannot_be_is_refused(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lab", "teleoperate", *words]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.nightly
def test_nobody_follows(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    from hapscene.teleoperation import udp_session

    monkeypatch.setattr(udp_session, "WAIT_S", 0.05)
    assert main(["lab", "teleoperate", "leader", "--port", "9", "--duration", "1"]) == 2
    assert "no follower answers at 127.0.0.1:9" in capsys.readouterr().err
