"""Who decides under load: down at once when ticks take too long, up when they have long taken well less."""

import numpy as np
import pytest

import hapscene
from hapscene.fidelity.load import CALM_S, OVER_COUNT, OVER_TICKS, PATIENCE_MAX, watch_load
from hapscene.flags import Flag

from .conftest import scene_of, stroke

CALM = round(CALM_S / 1e-3)
FEW, MANY = 10_000, 60_000  # of a budget of 50 µs


@pytest.fixture
def watched(fidelity):
    """A renderer whose watcher is told how long ticks took: runs of (count, ns); the level after each."""
    renderer = hapscene.Renderer(scene_of("box"), fidelity=fidelity("box"), budget_us=50.0)
    renderer.reset((0.0, 0.0, 0.05))

    def levels(*runs, late=0):
        found = []
        for count, ns in runs:
            for _ in range(count):
                watch_load(renderer.levels, 1e-3, ns, late)
                renderer.level = int(renderer.levels.state[0].wanted)  # as a loop goes there between two ticks
            found.append(renderer.level)
        return found

    levels.renderer = renderer
    return levels


def test_single_long_ticks_are_let_pass(watched):
    assert watched(*[(1, MANY), (OVER_TICKS, FEW)] * 20)[-1] == 0
    assert watched(*[(OVER_COUNT - 1, MANY), (OVER_TICKS, FEW)] * 20)[-1] == 0


def test_several_among_few_are_a_step_down_and_so_on_to_the_last(watched):
    assert watched((OVER_COUNT, MANY), (5, FEW)) == [1, 1]
    assert watched((1, MANY), (10, FEW), (1, MANY), (10, FEW), (1, MANY)) == [1, 1, 1, 1, 2]
    assert watched((1000, MANY)) == [2]


def test_ticks_that_begin_late_count_as_long_ones(watched):
    assert watched((OVER_COUNT, FEW), late=1) == [1]


def test_up_after_a_calm_time_level_by_level(watched):
    watched((100, MANY))
    assert watched((CALM - 1, FEW), (1, FEW), (CALM - 1, FEW), (1, FEW), (CALM, FEW)) == [2, 1, 1, 0, 0]


def test_ticks_near_the_budget_are_not_calm(watched):
    watched((100, MANY))
    assert watched((10 * CALM, 49_000)) == [2]
    assert watched((CALM - 1, FEW), (1, 49_000), (CALM - 1, FEW)) == [2, 2, 2]


def test_after_a_step_up_that_was_too_much_it_waits_longer_each_time(watched):
    """A load at which only the last level is calm: twice as long each time, and a minute at most."""
    watched((100, MANY))
    for times in (1, 2, 4):
        assert watched((times * CALM - 1, FEW), (1, FEW), (OVER_COUNT, MANY)) == [2, 1, 2]
    state = watched.renderer.levels.state[0]
    state.patience, state.calm = PATIENCE_MAX * CALM, PATIENCE_MAX * CALM - 1
    assert watched((1, FEW), (OVER_COUNT, MANY)) == [1, 2]
    assert state.patience == PATIENCE_MAX * CALM
    state.patience, state.calm = CALM, CALM - 1
    assert watched((1, FEW), (CALM, FEW), (CALM, FEW), (OVER_COUNT, MANY)) == [1, 0, 0, 1]
    assert state.patience == CALM  # the level had been borne for long enough


def test_a_path_is_run_coarser_where_no_tick_keeps_the_budget(fidelity):
    """At 1 ns a tick no level does: it goes down to the last, and is felt there."""
    path = stroke("sphere", 2)
    renderer = hapscene.Renderer(scene_of("sphere"), fidelity=fidelity("sphere"), budget_us=1e-3)
    recording = renderer.run(path)
    assert renderer.level == 2 and recording.touching.any()
    coarser = (recording.flags & Flag.COARSER) != 0
    assert not coarser[:OVER_COUNT].any() and coarser[OVER_COUNT:].all()
    generous = hapscene.Renderer(scene_of("sphere"), fidelity=fidelity("sphere"), budget_us=1e6)
    fine = hapscene.Renderer(scene_of("sphere")).run(path)
    np.testing.assert_array_equal(generous.run(path).f_W_N, fine.f_W_N)
