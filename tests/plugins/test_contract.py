"""Contract of effects, tested for all shipped and installed effects of both scopes."""

import keyword
import pkgutil
import tomllib
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import hapscene_plugins.effects
from hapscene.constants import PASSED_MAX
from hapscene.records import OUTPUT, TOUCH
from hapscene.surface.effect import EFFECTS

SHIPPED = {
    name: import_module(f"hapscene_plugins.effects.{name}").EFFECT
    for _, name, _ in pkgutil.iter_modules(hapscene_plugins.effects.__path__)
}
EACH = [
    pytest.param(effect, id=name)
    for name, effect in {**{name: entry.plugin for name, entry in EFFECTS.listed().items()}, **SHIPPED}.items()
    if effect
]
LINE = [[0.0, 0.0, 0.0], [0.003, 0.0, 0.0], [0.003, 0.004, 0.0]]
SETTINGS = {"guide": {"points_m": LINE}, "magnet": {"points_m": LINE}, "viscosity": {"center_m": LINE[0]}}
"""Settings of scene effects, so that the random walks are in their range."""
UNITS = {
    "kg": "kg",
    "m": "m",
    "s": "s",
    "N": "N",
    "Hz": "Hz",
    "m_s": "m/s",
    "m_s2": "m/s²",
    "N_m": "N/m",
    "Ns_m": "N·s/m",
    "Ns_m2": "N·s/m²",
    "s_m": "s/m",
    "1_kg": "1/kg",
    "1_s": "1/s",
    "deg": "°",
}
LARGE = 1e6


@pytest.fixture(scope="session")
def bench(bench):
    """A bench whose scene effects have settings."""
    return lambda effect, swatch, **more: bench(effect, swatch, settings=SETTINGS.get(effect.name, ()), **more)


def walk(ticks, seed: int, count: int = 300, large: float = 1.0) -> np.ndarray:
    """A random sequence of contacts with consistent flags."""
    rng = np.random.default_rng(seed)
    touching = np.repeat(rng.random(count // 10) > 0.3, 10)
    before = np.concatenate(([False], touching[:-1]))
    nhat = rng.normal(size=(count, 3))
    nhat = np.where(rng.random((count, 1)) > 0.3, [0.0, 0.0, 1.0], nhat / np.linalg.norm(nhat, axis=1)[:, None])
    depth = rng.exponential(1e-3 * large, count) * touching
    slip = rng.normal(0, 1e-4 * large, (count, 3)) * touching[:, None]
    slip -= np.einsum("ni,ni->n", slip, nhat)[:, None] * nhat
    v = rng.normal(0, 0.1 * large, (count, 3))
    turned = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return ticks(
        count,
        touching=touching,
        began=touching & ~before,
        ended=before & ~touching,
        crossed=rng.random(count) > 0.9,
        nhat_W=nhat,
        depth_m=depth,
        depth_rate_m_s=rng.normal(0, 0.1 * large, count) * touching,
        leaving_m_s=rng.exponential(0.1 * large, count),
        left_body=np.arange(count) // 40 % 3,
        left_W_m=rng.normal(0, 1e-3, (count, 3)),
        approach_m_s=rng.exponential(0.1 * large, count),
        slip_W_m=slip,
        slip_m_s=np.linalg.norm(slip, axis=1) / 1e-3,
        x_WB=turned[0],
        y_WB=turned[1],
        R_WT=turned,
        normal_force_N=500.0 * depth,
        force_N=500.0 * depth * rng.random(count),
        p_WT_m=np.cumsum(1e-3 * v, axis=0),
        p_WP_m=rng.normal(size=(count, 3)),
        v_WT_m_s=v,
        body=np.where(touching, np.arange(count) // 40 % 3, -1),
        inside=np.repeat(rng.integers(0, 3, count // 20), 20),
        inside_body=np.where(rng.random((count, 1)) > 0.1, np.arange(PASSED_MAX), np.arange(PASSED_MAX)[::-1]),
        inside_X_WB=np.concatenate((turned.ravel(), large * rng.normal(0, 1e-3, 3))),
        p_WC_m=rng.normal(size=(count, 3)),
    )


def corners(effect):
    """All parameters at their minimum or maximum, and each one alone."""
    low = {p.name: max(p.minimum, -LARGE) for p in effect.params}
    high = {p.name: min(p.maximum, LARGE) for p in effect.params}
    yield low
    yield high
    for p in effect.params:
        yield {p.name: low[p.name]}
        yield {p.name: high[p.name]}


def test_all_shipped_effects_are_listed():
    names = EFFECTS.listed()
    assert {"friction", "lpc_texture", "tap", "wall"} <= set(names)
    assert not [entry.error for entry in names.values() if entry.error]


def test_each_shipped_file_is_an_entry_point():
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    points = {name: f"hapscene_plugins.effects.{name}:EFFECT" for name in SHIPPED}
    assert project["entry-points"]["hapscene.effects"] == points
    assert [effect.name for effect in SHIPPED.values()] == list(SHIPPED)


@pytest.mark.parametrize("effect", EACH)
def test_declarations_are_valid(effect):
    assert effect.name.isidentifier() and effect.summary.endswith(".") and len(effect.summary) < 80
    for param in effect.params:
        assert not keyword.iskeyword(param.name) and param.meaning and param.unit
        assert param.minimum <= param.default <= param.maximum
        suffixes = [unit for suffix, unit in UNITS.items() if param.name.endswith(f"_{suffix}")]
        assert param.unit == "1" or param.unit in suffixes, f"{param.name} does not end in its unit {param.unit}"
    for state in effect.state:
        assert not keyword.iskeyword(state.name)


@pytest.mark.parametrize("effect", EACH)
def test_same_seed_same_bits(effect, bench, ticks, swatch_of):
    first, again = (bench(effect, swatch_of(), seed=7).run(walk(ticks, 2)) for _ in range(2))
    assert first.tobytes() == again.tobytes()


@pytest.mark.parametrize("effect", EACH)
def test_adds_to_its_block_and_only_reads_its_inputs(effect, bench, ticks, swatch_of):
    rows, one = walk(ticks, 3), bench(effect, swatch_of())
    before = rows.tobytes(), one.p.tobytes(), one.table.tobytes()
    alone = one.run(rows)
    assert (rows.tobytes(), one.p.tobytes(), one.table.tobytes()) == before
    assert not alone["a_m_s2"][:, 10:].any()
    start = np.zeros(len(rows), OUTPUT)
    start["f_W_N"], start["a_m_s2"] = 2.0, -3.0
    added = bench(effect, swatch_of()).run(rows, start.copy())
    for name in OUTPUT.names:
        np.testing.assert_allclose(added[name] - start[name], alone[name], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("effect", EACH)
def test_output_is_finite_at_parameter_limits(effect, bench, ticks, swatch_of):
    """Parameters at their limits, contact forces up to a thousand times the usual, two swatches."""
    for params in corners(effect):
        for swatch in (
            swatch_of(),
            swatch_of(texture=None, taps=None, friction_static=0, friction_dynamic=0),
        ):
            for seed, large in enumerate((0.0, 1.0, 1e3)):
                out = bench(effect, swatch, params=params).run(walk(ticks, seed, 100, large))
                assert all(np.isfinite(out[name]).all() for name in OUTPUT.names), params


@pytest.mark.parametrize("effect", EACH)
def test_silent_after_reset_in_the_air(effect, bench, ticks, swatch_of):
    """A scene effect starts at less than a twentieth of its final force."""
    rows = ticks(1000, touching=0, swatch=-1, body=-1, p_WT_m=(0.002, 0.001, 0.003))
    out = bench(effect, swatch_of()).run(rows)
    if effect.scope == "scene":
        size_N = np.linalg.norm(out["f_W_N"], axis=1)
        assert size_N[0] <= 0.05 * size_N[-1]
    else:
        assert not any(out[name].any() for name in OUTPUT.names)


@pytest.mark.parametrize("effect", EACH)
def test_swatches_may_change_every_tick(effect, bench, ticks, swatch_of):
    """Parameters and table change at each tick while the state persists."""
    swatches = [
        swatch_of(0, 20),
        swatch_of(1, 3, friction_static=1.0, friction_dynamic=0.1),
        swatch_of(2, 60),
    ]
    swatches.append(swatch_of(texture=None, taps=None))
    benches = [bench(effect, swatch) for swatch in swatches]
    rows = walk(ticks, 6)
    for i in range(len(rows)):
        one = benches[i % 4]
        one.s = benches[0].s
        out = one.run(rows[i : i + 1])
        assert all(np.isfinite(out[name]).all() for name in OUTPUT.names)
        assert np.abs(out["a_m_s2"]).max() < 1e3 and np.abs(out["f_W_N"]).max() < 1e3


def test_walks_cover_the_fields(ticks):
    """Fails if a field is added that the random walks leave at zero."""
    rows = walk(ticks, 0)
    left = {name for name in TOUCH.names if not rows[name].any()}
    assert left <= {"face", "swatch", "bary", "other", "weight"}
