"""A fitted texture is silent at no force and at no speed, and nowhere else."""

import numpy as np
import pytest
from scipy.signal import lfilter

from ..signals import fit


@pytest.mark.parametrize("seed", [0, 1, 5])
def test_the_texture_is_never_silent(seed: int) -> None:
    """Level proportional to force times speed, over slow swings of both: the case that once silenced models."""
    rng = np.random.default_rng(seed)
    n, rate_Hz = 40_000, 10_000.0
    t_s = np.arange(n) / rate_Hz
    force_N = 1.2 + 0.6 * np.sin(2 * np.pi * 0.31 * t_s + seed)
    speed_m_s = 0.12 * np.abs(np.sin(2 * np.pi * 0.7 * t_s + seed)) + 0.005
    poles = 0.95 * np.exp(2j * np.pi * np.array([180.0, 420.0]) / rate_Hz)
    a = np.real(np.poly(np.concatenate([poles, poles.conj()])))
    signal = lfilter([1.0], a, rng.standard_normal(n))
    texture = fit(
        10 * force_N * speed_m_s * signal / signal.std(), rate_Hz, force_N=force_N, speed_m_s=speed_m_s
    ).texture
    share = np.linspace(0.01, 1.0, 40)
    force, speed = (grid.ravel() for grid in np.meshgrid(share * texture.force_max_N, share * texture.speed_max_m_s))
    assert (texture.power(force, speed) > 0.0).all()
    assert (texture.power(np.zeros(3), np.array([0.0, 0.05, 0.1])) == 0.0).all()
    assert (texture.power(np.array([0.0, 0.5, 1.0]), np.zeros(3)) == 0.0).all()
