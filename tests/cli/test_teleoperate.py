"""`hapscene lab teleoperate`."""

import pytest

from hapscene.cli import main


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["leader", "--duration", "0"], "--duration"),
        (["follower", "--host", "0.0.0.0", "--port", "0"], "--allow"),
        (["leader", "--grip", "none"], "'none'"),
    ],
)
def test_invalid_options(words: list[str], expected: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lab", "teleoperate", *words]) == 2
    assert expected in capsys.readouterr().err


@pytest.mark.nightly
def test_a_leader_without_a_follower(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    from hapscene.teleoperation import udp_session

    monkeypatch.setattr(udp_session, "CONNECT_S", 0.05)
    assert main(["lab", "teleoperate", "leader", "--port", "9", "--duration", "1"]) == 2
    assert "no follower answers at 127.0.0.1:9" in capsys.readouterr().err
