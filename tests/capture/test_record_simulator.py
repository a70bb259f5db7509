"""What the simulated probe prints: strokes whose friction, level and spectrum are known."""

from itertools import islice
from types import SimpleNamespace

import numpy as np
import pytest

from hapscene.capture import record_simulator
from hapscene.capture.record_simulator import BLOCK_S, COLUMNS, FRICTION, LEVEL, lines, strokes
from tests.virtual_clock import VirtualClock

RATE_HZ = 3200.0
SECONDS = 20


def table() -> np.ndarray:
    """Acceleration, force, tangential force and speed (4, n) in SI."""
    counts = np.concatenate(list(islice(strokes(RATE_HZ), round(SECONDS / BLOCK_S))))
    return np.asarray((counts * [column.scale for column in COLUMNS]).T)


def test_force_speed_and_friction_are_a_hand_s() -> None:
    acceleration, force, tangential, speed = table()
    t = np.arange(len(force)) / RATE_HZ
    assert len(t) == SECONDS * RATE_HZ
    np.testing.assert_allclose(force, 1.2 + 0.6 * np.sin(2 * np.pi * 0.31 * t), atol=6e-4)
    np.testing.assert_allclose(speed, 0.12 * np.abs(np.sin(2 * np.pi * 0.7 * t)), atol=6e-5)
    np.testing.assert_allclose(np.abs(tangential)[speed > 1e-3], FRICTION * force[speed > 1e-3], atol=1e-3)
    assert np.all(np.sign(tangential[speed > 1e-3]) == np.sign(np.sin(2 * np.pi * 0.7 * t))[speed > 1e-3])
    level = np.sqrt(np.mean(acceleration**2) / np.mean((speed * force) ** 2))
    assert level == pytest.approx(LEVEL, rel=0.1)


def test_its_surface_has_two_resonances() -> None:
    acceleration = table()[0][: 6 * 8192].reshape(-1, 1024) * np.hanning(1024)
    density = np.mean(np.abs(np.fft.rfft(acceleration, axis=1)) ** 2, axis=0)
    frequency = np.fft.rfftfreq(1024, 1.0 / RATE_HZ)
    for low, high, peak in ((100.0, 290.0, 180.0), (300.0, 600.0, 420.0)):
        within = (frequency > low) & (frequency < high)
        assert frequency[within][np.argmax(density[within])] == pytest.approx(peak, abs=25.0)


def test_a_header_each_second_and_as_many_lines_lost_as_said() -> None:
    text = list(islice(lines(RATE_HZ, drop=0.1), 200))
    assert [i for i, part in enumerate(text) if part.startswith(b"#hapscene-probe")] == [0, 100]
    rows = b"".join(text).count(b"\n") - 2
    assert rows / (2 * RATE_HZ) == pytest.approx(0.9, abs=0.02)
    assert list(islice(lines(RATE_HZ, drop=0.1), 200)) == text != list(islice(lines(RATE_HZ, 1, 0.1), 200))


def test_it_prints_as_time_goes_by_and_catches_up_where_it_was_late(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, written_s = VirtualClock(), []
    begin_s = clock.now_s()

    def write(wire: int, text: bytes) -> int:
        written_s.append(clock.now_s() - begin_s)
        clock.sleep_s(0.025 if len(written_s) == 3 else 0.0)  # the machine is busy
        return len(text)

    monkeypatch.setattr(record_simulator, "simulated_port", lambda parser: 9)
    monkeypatch.setattr(record_simulator, "os", SimpleNamespace(write=write))
    assert record_simulator.main(["--seconds", "0.08"], clock) == 0
    assert written_s == pytest.approx([0.0, 0.01, 0.02, 0.045, 0.045, 0.05, 0.06, 0.07])


@pytest.mark.parametrize(("late_s", "lost"), [(0.3, False), (1.5, True)])
def test_a_late_reader_loses_nothing_and_none_loses_what_is_sent(
    late_s: float, lost: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, taken = VirtualClock(), bytearray()
    begin_s = clock.now_s()

    def write(wire: int, text: bytes) -> int:
        if 0.5 < clock.now_s() - begin_s < 0.5 + late_s:
            raise BlockingIOError
        taken.extend(text[:1000])
        return len(text[:1000])

    monkeypatch.setattr(record_simulator, "simulated_port", lambda parser: 9)
    monkeypatch.setattr(record_simulator, "os", SimpleNamespace(write=write))
    assert record_simulator.main(["--seconds", "3"], clock) == 0
    assert (bytes(taken) != b"".join(islice(lines(RATE_HZ), 300))) == lost
