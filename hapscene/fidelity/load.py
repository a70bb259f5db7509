"""Under load: who decides at which level a scene is felt, by how long ticks take and whether they begin in time.

Down at once, when `OVER_COUNT` of `OVER_TICKS` ticks took longer than the budget, or began late; up after `CALM_S` in
which all took well less. Where a step up was too much, the next is waited for twice as long.
"""

from typing import Any, Final

from hapscene.contact.moving import place_bodies
from hapscene.fidelity.level_step import take_step
from hapscene.native import native
from hapscene.tick import tick

OVER_COUNT: Final = 3
"""Ticks over the budget after which the level is a coarser one [count]: one alone may be another program's. So many
are remembered in `LEVEL_STATE`."""

OVER_TICKS: Final = 50
"""Ticks among which they are [count]: what is noticed between seeing and feeling is 45 ms (Adelstein et al. 2003)."""

CALM_SHARE: Final = 0.7
"""Share of the budget that is well less than it [1]."""

CALM_S: Final = 2.0
"""How long ticks must take well less before a step up [s]."""

PATIENCE_MAX: Final = 32
"""How many times as long it is waited for at most, where steps up were too much [1]: a minute."""


@native
def watch_load(levels: Any, tick_s: float, busy_ns: int, late: int) -> None:
    """Note how long a tick took, and whether it began late (1); says in `wanted` what is to be felt."""
    state = levels.state[0]
    if state.budget_ns == 0 or state.count < 2 or state.wanted != state.level:
        return
    state.tick += 1
    calm_ticks = round(CALM_S / tick_s)
    if state.tick == 1:
        state.patience = calm_ticks
        state.over[0] = state.over[1] = state.up_at = -PATIENCE_MAX * calm_ticks
    if busy_ns > state.budget_ns or late == 1:
        state.calm = 0
        if state.tick - state.over[1] < OVER_TICKS and state.level < state.count - 1:
            state.wanted = state.level + 1
            soon = state.tick - state.up_at < state.patience
            state.patience = min(2 * state.patience, PATIENCE_MAX * calm_ticks) if soon else calm_ticks
            state.over[0] = state.over[1] = state.tick - OVER_TICKS
        else:
            state.over[1], state.over[0] = state.over[0], state.tick
    elif busy_ns > CALM_SHARE * state.budget_ns:
        state.calm = 0
    else:
        state.calm += 1
        if state.calm >= state.patience and state.level > 0:
            state.wanted, state.calm, state.up_at = state.level - 1, 0, state.tick


@native
def run_watched(
    world: Any, surface: Any, levels: Any, p_WT_m: Any, moving: Any, X_WB: Any, teleported: Any, rows: Any, a_m_s2: Any
) -> None:
    """As `hapscene.tick.run_ticks`, at one level or another."""
    tick_s = surface.touch[0].tick_s
    for k in range(len(p_WT_m)):
        take_step(world, surface, levels)
        place_bodies(world, surface, moving, X_WB, teleported, k)
        tick(world, surface, p_WT_m[k, 0], p_WT_m[k, 1], p_WT_m[k, 2], rows[k], a_m_s2[k])
        watch_load(levels, tick_s, rows[k].tick_ns, 0)
