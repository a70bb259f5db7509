"""Makes surface.csv for order.toml: a tool over a weave that is none, from numbers alone.

A weave of 1 mm slid over at 0.1 m/s sounds at 100 Hz and its multiples, each with a width: more peaks than 40
coefficients hold, fewer than 120. What people say of it is true of it; for a real surface, record one.
"""

import sys
from pathlib import Path

import numpy as np

RATE_HZ, SECONDS, PITCH_M = 10_000, 12.0, 1e-3


def surface(seed: int = 0) -> np.ndarray:
    """Rows (n, 3): acceleration [m/s²], normal force [N], speed [m/s]."""
    rng, t_s = np.random.default_rng(seed), np.arange(round(RATE_HZ * SECONDS)) / RATE_HZ
    speed_m_s = 0.1 * (1.0 + 0.01 * np.sin(2.0 * np.pi * 0.4 * t_s))
    force_N = 1.0 + 0.1 * np.sin(2.0 * np.pi * 0.3 * t_s)
    wander = np.cumsum(rng.standard_normal(len(t_s))) * np.sqrt(2.0 * np.pi * 4.0 / RATE_HZ)  # lines 4 Hz wide
    phase = 2.0 * np.pi * np.cumsum(speed_m_s) / RATE_HZ / PITCH_M
    acceleration_m_s2 = 0.3 * rng.standard_normal(len(t_s))
    for k in range(1, 31):
        phase_k = k * phase + np.sqrt(k) * wander + rng.uniform(0.0, 2.0 * np.pi)
        acceleration_m_s2 += 0.8 / (1.0 + 0.05 * k) * np.cos(phase_k)
    return np.column_stack([acceleration_m_s2 * force_N, force_N, speed_m_s])


def main() -> None:
    path = Path(sys.argv[1] if len(sys.argv) > 1 else "surface.csv")
    np.savetxt(path, surface(), fmt="%.6g", delimiter=",", header="acceleration,force,speed", comments="")
    print(f"made {path}: a made surface; what is found about it is about it alone")


if __name__ == "__main__":
    main()
