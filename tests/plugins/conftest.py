"""Test bench for a single effect: computes outputs from contacts, compiled as in the tick."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numba import njit

from hapscene.dsp.ar_filter import ar_from_reflection, power_gain
from hapscene.dsp.noise import seeded_state
from hapscene.records import OUTPUT, TOUCH
from hapscene.surface.effect import Effect, field_setting
from hapscene.surface.effect_compile import call_effect, compile_effect
from hapscene.surface.swatch import PLAIN, Swatch
from hapscene.surface.taps import Taps
from hapscene.surface.texture import Texture


def touches(count: int, rate_Hz: float = 10_000.0, **fields: Any) -> np.ndarray:
    """Ticks of a contact with a surface of normal z; `fields` set the rest, one value or one per tick."""
    rows = np.zeros(count, TOUCH)
    rows["tick"] = np.arange(count)
    rows["tick_s"], rows["rate_Hz"], rows["block"] = 1e-3, rate_Hz, round(rate_Hz * 1e-3)
    rows["touching"] = 1
    rows["nhat_W"] = (0.0, 0.0, 1.0)
    rows["stiffness_N_m"] = 500.0
    for name, value in fields.items():
        rows[name] = value
    return rows


@njit
def play(address, rows, params, table, states, outs):
    """Call the effect at an address once per row."""
    for i in range(len(rows)):
        call_effect(address, rows[i], params, 0, table, states, 0, outs[i])


@dataclass
class Bench:
    """One effect with the parameters of one swatch, overruled by `params`. State lasts from call to call.

    A scene effect has `settings` instead of a swatch; its frame is W.
    """

    effect: Effect
    swatch: Swatch = PLAIN
    seed: int = 0
    rate_Hz: float = 10_000.0
    params: Any = ()
    settings: Any = ()

    def __post_init__(self) -> None:
        effect = self.effect
        self.p = np.zeros(1, effect.param_dtype)
        for param in effect.params:
            self.p[param.name] = self.swatch.parameter(effect.name, param.name, param.default)
        field = field_setting(effect, dict(self.settings), (), self.rate_Hz) if effect.scope == "scene" else None
        for name, value in {**(field.numbers if field else {}), **dict(self.params)}.items():
            self.p[name] = value
        self.table = field.table if field else self.table_of(self.swatch)
        self.s = np.zeros(1, effect.state_dtype)
        for state in effect.state:
            if state.seeded:
                self.s[state.name] = seeded_state(self.seed, effect.name)

    def table_of(self, swatch: Swatch) -> np.ndarray:
        return self.effect.table(swatch, self.rate_Hz) if self.effect.table else np.empty(0)

    def run(self, rows: np.ndarray, outs: np.ndarray | None = None) -> np.ndarray:
        """Outputs (n,) OUTPUT, added to `outs` where given."""
        outs = np.zeros(len(rows), OUTPUT) if outs is None else outs
        address = compile_effect(self.effect)
        play(address, rows, self.p.view(np.uint8), self.table, self.s.view(np.uint8), outs)
        return outs

    def samples(self, rows: np.ndarray) -> np.ndarray:
        """The acceleration channel as one signal (n · block,) [m/s²]."""
        return self.run(rows)["a_m_s2"][:, : rows["block"][0]].ravel()


def make_texture(seed: int = 0, order: int = 20, rate_Hz: float = 10_000.0) -> Texture:
    """9 models up to 2 N and 0.2 m/s: variations of one random filter, outputs of 0.5 to 2 (m/s²)²."""
    rng = np.random.default_rng(seed)
    force, speed = (grid.ravel() for grid in np.meshgrid([0.5, 1.0, 2.0], [0.05, 0.1, 0.2]))
    k = rng.uniform(-0.7, 0.7, order) + rng.uniform(-0.1, 0.1, (len(force), order))
    a = ar_from_reflection(k)
    return Texture.from_models(rate_Hz, force, speed, a=a, variance_m2_s4=rng.uniform(0.5, 2.0, len(a)) / power_gain(a))


def make_swatch(seed: int = 0, order: int = 20, **fields: Any) -> Swatch:
    """A swatch with everything: friction, texture, taps; it breaks."""
    taps = Taps(np.array([0.05, 0.3]), np.array([5.0, 30.0]), np.array([180.0, 260.0]), np.array([70.0, 90.0]))
    given = dict(
        damping_Ns_m=0.5,
        friction_static=0.4,
        friction_dynamic=0.3,
        texture=make_texture(seed, order),
        taps=taps,
        effects={"puncture": {"puncture_force_N": 0.5}},
    )
    return Swatch("made up", **{**given, **fields})


@pytest.fixture(scope="session")
def bench() -> type[Bench]:
    return Bench


@pytest.fixture(scope="session")
def ticks() -> Callable[..., np.ndarray]:
    return touches


@pytest.fixture(scope="session")
def swatch_of() -> Callable[..., Swatch]:
    return make_swatch


@pytest.fixture(scope="session")
def texture_of() -> Callable[..., Texture]:
    return make_texture
