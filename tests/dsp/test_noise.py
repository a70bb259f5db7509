"""Random numbers: published reference values, and the normal distribution."""

import numpy as np
from scipy.stats import kstest

from hapscene.dsp.noise import normal, seeded_state, uniform


def test_the_generator_is_xoshiro256_plus() -> None:
    """Published first outputs of the state 1, 2, 3, 4 (crate rand_xoshiro's own test), their upper 53 bits."""
    outputs = [5, 211106232532999, 211106635186183, 9223759065350669058, 9250833439874351877, 13862484359527728515]
    outputs += [2346507365006083650, 1168864526675804870, 34095955243042024, 3466914240207415127]
    state = np.array([1, 2, 3, 4], dtype=np.uint64)
    assert [uniform(state) for _ in outputs] == [(output >> 11) / 2**53 for output in outputs]


def test_normal_numbers_are_independent() -> None:
    state = seeded_state(0, "texture")
    z = np.array([normal(state) for _ in range(50_000)])
    assert kstest(z, "norm").pvalue > 0.01
    assert abs(np.corrcoef(z[1:], z[:-1])[0, 1]) < 4.0 / np.sqrt(len(z))


def test_each_seed_and_name_has_a_different_state() -> None:
    states = [tuple(seeded_state(seed, name)) for seed in (0, 1) for name in ("a", "b")]
    assert len(set(states)) == 4 and tuple(seeded_state(1, "b")) == states[-1]
