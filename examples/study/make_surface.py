"""Write surface.csv for order.toml: a synthetic recording of a tool that slides over a weave.

A weave with a pitch of 1 mm at 0.1 m/s vibrates at 100 Hz and its multiples. These are more spectral peaks than an AR
model of order 40 can represent, and fewer than one of order 120 can. Results hold for this synthetic surface only.
"""

import sys
from pathlib import Path

import numpy as np

RATE_HZ, SECONDS, PITCH_M = 10_000, 12.0, 1e-3


def surface(seed: int = 0) -> np.ndarray:
    """Return rows (n, 3): acceleration [m/s²], normal force [N], speed [m/s]."""
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
    print(f"wrote {path}: a synthetic surface; results hold for this surface only")


if __name__ == "__main__":
    main()
