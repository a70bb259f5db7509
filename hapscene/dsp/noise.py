"""Random numbers for effects: xoshiro256+ (Blackman & Vigna 2018), compiled and reproducible to the bit.

Declare `State("rng", seeded=True)` and call `normal(s.rng)`. The framework seeds the state from the renderer's seed and
the name of the effect, so that the numbers do not depend on other effects.
"""

import math
import zlib

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.native import native

__all__ = ["normal", "seeded_state", "uniform"]


@native
def uniform(rng: NDArray[np.uint64]) -> float:
    """Next random number, uniform in [0, 1); advances the generator state `rng` (4,)."""
    result = rng[0] + rng[3]
    shifted = rng[1] << np.uint64(17)
    rng[2] ^= rng[0]
    rng[3] ^= rng[1]
    rng[1] ^= rng[2]
    rng[0] ^= rng[3]
    rng[2] ^= shifted
    rng[3] = (rng[3] << np.uint64(45)) | (rng[3] >> np.uint64(19))
    return float(result >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@native
def normal(rng: NDArray[np.uint64]) -> float:
    """Next random number of the standard normal distribution (Marsaglia polar method, one number of the pair)."""
    while True:
        x = 2.0 * uniform(rng) - 1.0
        y = 2.0 * uniform(rng) - 1.0
        r2 = x * x + y * y
        if 0.0 < r2 < 1.0:
            return x * math.sqrt(-2.0 * math.log(r2) / r2)


def seeded_state(seed: int, name: str) -> NDArray[np.uint64]:
    """Initial generator state (4,) uint64 for the effect `name` and the renderer's `seed`."""
    sequence = np.random.SeedSequence([seed, zlib.crc32(name.encode())])
    return sequence.generate_state(4, np.uint64).astype(np.uint64, copy=False)
