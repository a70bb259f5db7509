"""A synthetic recording: taps and strokes over four swatches with a known acceleration."""

import numpy as np
import pytest

from hapscene.render.recording import Recording

STROKE_HZ = 250.0
SPANS_S = ((0.2, 0.25), (0.5, 0.55), (0.8, 1.4), (1.6, 1.9))


@pytest.fixture(scope="session")
def recording() -> Recording:
    """Two seconds; a sine of `STROKE_HZ` and 3 m/s² in every contact."""
    count, block, rate_Hz = 2000, 10, 10_000.0
    t_s = np.arange(count) * 1e-3
    touching = np.zeros(count, bool)
    for start_s, end_s in SPANS_S:
        touching |= (t_s >= start_s) & (t_s < end_s)
    depth_m = np.where(touching, 1e-3, 0.0)
    p_WP_m = np.column_stack((0.05 * t_s, 0.01 * np.sin(5 * t_s), np.where(touching, 0.0, 0.01)))
    up = np.tile([0.0, 0.0, 1.0], (count, 1))
    a_t_s = np.arange(count * block) / rate_Hz
    a_m_s2 = 3.0 * np.sin(2 * np.pi * STROKE_HZ * a_t_s).reshape(count, block) * touching[:, None]
    index = np.where(touching, 0, -1).astype(np.int32)
    return Recording(
        t_s=t_s,
        p_WT_m=p_WP_m - depth_m[:, None] * up,
        p_WP_m=p_WP_m,
        nhat_W=up,
        depth_m=depth_m,
        touching=touching,
        body=index,
        face=index,
        swatch=np.where(touching, 1 + (t_s / 0.3).astype(int) % 4, -1).astype(np.int32),
        f_W_N=500.0 * depth_m[:, None] * up,
        flags=np.zeros(count, np.uint32),
        tick_ns=np.full(count, 2500),
        contact_ns=np.full(count, 900),
        slip_m_s=np.zeros(count),
        normal_force_N=500.0 * depth_m,
        a_m_s2=a_m_s2,
        a_rate_Hz=rate_Hz,
        body_names=("plate",),
        swatch_names=("plain", "wood", "leather", "paper", "epoxy"),
        seed=0,
        effects=("wall",),
    )
