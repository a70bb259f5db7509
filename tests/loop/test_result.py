"""Key figures and file of a closed loop, from arrays whose figures are known."""

from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hapscene.loop.result import ClosedLoopResult, summarise_result

LATE = 7


def make_result(desired_m_s2: np.ndarray, a_rate_Hz: float = 10_000.0) -> ClosedLoopResult:
    """A second at 1000 Hz in which the handle plays the desired acceleration `LATE` samples later."""
    t_s, played = 1e-3 * np.arange(1000), np.full(desired_m_s2.size, 9.0)
    played[LATE:] = desired_m_s2.ravel()[:-LATE]
    recording: Any = SimpleNamespace(t_s=t_s, a_m_s2=desired_m_s2, a_rate_Hz=a_rate_Hz)
    zeros = {name.name: np.zeros((1000, 3)) for name in fields(ClosedLoopResult)[1:6]}
    v_W_m_s, f_motor_W_N, work_J, f_coil_N, heat = np.ones((1000, 3)), np.zeros((1000, 3)), *np.zeros((3, 1000))
    v_W_m_s[699:], f_motor_W_N[3], work_J[:2] = (3e-3, 0.0, 4e-3), (0.03, 0.04, 0.12), (0.003, -0.005)
    f_coil_N[5], heat[6] = 0.5, 0.75
    numbers = {"v_W_m_s": v_W_m_s, "f_motor_W_N": f_motor_W_N, "work_J": work_J, "f_coil_N": f_coil_N, "heat": heat}
    handle = {"a_handle_m_s2": played.reshape(desired_m_s2.shape), "latency_s": LATE / a_rate_Hz}
    return ClosedLoopResult(recording, **zeros | numbers | handle, trouble=np.zeros(1000, np.int64))


def test_key_figures(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).normal(size=(1000, 10))
    result = make_result(noise)
    figures = {
        "force_motor_max_N": 0.13,
        "force_coil_max_N": 0.5,
        "work_of_motors_mJ": -2.0,
        "speed_at_rest_mm_s": 5.0,
        "motor_warmth_max": 0.75,
        "handle_spectrogram_error": 0.0,
        "handle_latency_s": 7e-4,
    }
    assert summarise_result(result) == pytest.approx(figures)
    for silent in (make_result(0.0 * noise), make_result(noise[:, :1], 1000.0)):  # or too slow for the band
        assert summarise_result(silent)["handle_spectrogram_error"] is None
    result.save(tmp_path / "hand.npz")
    with np.load(tmp_path / "hand.npz") as stored:
        assert set(stored) == {"t_s", "format_version", *(each.name for each in fields(result)[1:])}
        assert stored["format_version"] == 1 and np.array_equal(stored["t_s"], result.recording.t_s)
        assert np.array_equal(stored["v_W_m_s"], result.v_W_m_s) and stored["latency_s"] == result.latency_s
