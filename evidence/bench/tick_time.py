"""Time of contact and tick with hot caches, the minimum of several runs for each tick; time of the closed loop."""

import time
import timeit
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

import numpy as np
import trimesh
from numpy.typing import NDArray

from hapscene.capture import FitOptions, SurfaceRecording, fit_swatch, synthesize
from hapscene.clock import new_clock, now_ns
from hapscene.compiled.native import native
from hapscene.contact.world import Shapes
from hapscene.device.sim.omni import Omni
from hapscene.handle.plant import Plant
from hapscene.loop import Twin
from hapscene.motion.gestures import act
from hapscene.render.recording import Recording
from hapscene.render.renderer import EFFECTS, Renderer
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.surface.effect import Effect
from hapscene.surface.swatch import Swatch
from hapscene.swatches.library import load_swatch

from .case import Case
from .sheet import Sheet

Times = NDArray[np.int64]

REPEATS: Final = 5
"""Runs of a path after a warm-up run [count]."""

TWIN_REPEATS: Final = 7
"""Runs of the closed loop, of which the fastest counts [count]."""

ORDERS: Final = (8, 20, 40, 80, 120)
"""Orders that are timed [coefficients]."""

FORCE_N, SPEED_M_S, DURATION_S = 1.0, 0.1, 10.0
"""Conditions and duration of the synthesised texture that is fitted."""

RATE_HZ: Final = 10_000.0


def swatch_of_order(order: int) -> Swatch:
    """Return the shipped wood with its texture played for `DURATION_S` and fitted at `order`."""
    wood = load_swatch("wood")
    count = round(DURATION_S * RATE_HZ)
    force_N, speed_m_s = np.full(count, FORCE_N), np.full(count, SPEED_M_S)
    played = synthesize(wood, force_N, speed_m_s, rate_Hz=RATE_HZ)
    fitted = fit_swatch(
        SurfaceRecording(RATE_HZ, played, force_N, speed_m_s), FitOptions(f"wood {order}", order, model_count=1)
    )
    return replace(wood, name=fitted.name, texture=fitted.texture)


@dataclass(frozen=True)
class Hot:
    """Times of the ticks in contact, the minimum of all runs for each tick, and the last run."""

    contact_ns: Times
    tick_ns: Times
    run_s: float
    """Minimum time of `Renderer.run` [s]."""
    recording: Recording


def hot(renderer: Renderer, p_WT_m: NDArray[np.float64], repeats: int = REPEATS) -> Hot:
    """Run a path several times after a warm-up run."""
    contact: list[Times] = []
    tick: list[Times] = []
    run_s: list[float] = []
    for _ in range(repeats + 1):
        renderer.reset(p_WT_m[0])
        start_s = time.perf_counter()
        recording = renderer.run(p_WT_m)
        run_s.append(time.perf_counter() - start_s)
        contact.append(recording.contact_ns)
        tick.append(recording.tick_ns)
    on = recording.touching
    least = [np.min(runs[1:], axis=0)[on] for runs in (contact, tick)]
    return Hot(least[0], least[1], min(run_s[1:]), recording)


def measure_clock(sheet: Sheet) -> None:
    """Measure the time between two successive reads of the clock, which is included in all times."""
    between = np.zeros(20_000, np.int64)
    for _ in range(2):
        _read_clock(new_clock(), between)
    sheet.add("clock", "between two reads median", float(np.median(between)), "ns")


@native
def _read_clock(clock: Times, between: Times) -> None:
    for i in range(len(between)):
        start = now_ns(clock)
        between[i] = now_ns(clock) - start


def measure_contact(sheet: Sheet, case: Case, repeats: int = REPEATS) -> Recording:
    """Measure the contact part of the tick on one case, and the time to build the search structure."""

    def build() -> None:  # face neighbours, packed faces, search structure
        Shapes([replace(case.mesh)], 0.0)  # a copy, whose neighbours are not cached

    sheet.add(case.name, "build", 1e3 * min(timeit.repeat(build, number=1, repeat=3)), "ms")
    found = hot(Renderer(case.scene(), effects=["wall"]), case.p_WT_m, repeats)
    sheet.add(case.name, "triangles", len(case.mesh.faces), "1")
    sheet.add(case.name, "ticks in contact", len(found.contact_ns), "1")
    sheet.add_spread(case.name, "contact", found.contact_ns, "µs", 1e-3)
    return found.recording


def measure_tick(sheet: Sheet, case: Case, swatch: Swatch, order: int, repeats: int = REPEATS) -> None:
    """Measure the tick with five effects and a texture of `order`: inside `run`, `run` itself, and `step`."""
    name = f"tick, order {order}"
    renderer = Renderer(case.scene(swatch), effects=EFFECTS)
    found = hot(renderer, case.p_WT_m, repeats)
    sheet.add_spread(name, "tick", found.tick_ns, "µs", 1e-3)
    sheet.add_spread(name, "contact", found.contact_ns, "µs", 1e-3)
    path_s = len(case.p_WT_m) * renderer.tick_s
    sheet.add(name, "run for 10 s of path", found.run_s * 10.0 / path_s, "s")
    sheet.add(name, "step over the tick median", 1e-3 * _step_over_tick_ns(renderer, case.p_WT_m, repeats), "µs")


def _step_over_tick_ns(renderer: Renderer, p_WT_m: NDArray[np.float64], repeats: int) -> float:
    """Return the median time of `step` from Python without the tick [ns]."""
    row = renderer._row.view(np.ndarray)[0]  # of the last `step`
    over: list[list[int]] = []
    for _ in range(repeats + 1):
        renderer.reset(p_WT_m[0])
        one: list[int] = []
        for p in p_WT_m:
            start_ns = time.perf_counter_ns()
            renderer.step(p)
            one.append(time.perf_counter_ns() - start_ns - row["tick_ns"])
        over.append(one)
    return float(np.median(np.min(over[1:], axis=0)))


def measure_harness(sheet: Sheet, case: Case, repeats: int = REPEATS) -> None:
    """Measure the cost of calling effects: a tick with idle effects minus a tick without effects."""
    idle = [Effect(f"idle_{i}", "Does nothing.", _do_nothing) for i in range(len(EFFECTS))]
    with_idle = hot(Renderer(case.scene(), effects=idle), case.p_WT_m, repeats)
    without = hot(Renderer(case.scene(), effects=[]), case.p_WT_m, repeats)
    sheet.add("harness", "four idle effects median", 1e-3 * np.median(with_idle.tick_ns - without.tick_ns), "µs")
    sheet.add("harness", "tick without effects median", 1e-3 * np.median(without.tick_ns), "µs")


def measure_effects(sheet: Sheet, case: Case, swatch: Swatch, repeats: int = REPEATS) -> None:
    """Measure the mean time that each effect alone adds to a tick in contact."""
    bare = hot(Renderer(case.scene(swatch), effects=[]), case.p_WT_m, repeats).tick_ns
    for name in EFFECTS:
        alone = hot(Renderer(case.scene(swatch), effects=[name]), case.p_WT_m, repeats).tick_ns
        sheet.add("profile", name, float(np.mean(alone - bare)), "ns")


def measure_twin(sheet: Sheet) -> None:
    """Measure the simulated closed loop: a hand that scrubs wood with an Omni and a handle."""
    scene = Scene()
    box = Mesh.from_trimesh(trimesh.creation.box((0.12, 0.12, 0.02)), "m")
    scene.add(box, name="plate", swatch=load_swatch("wood"))
    intent = act("scrub", scene, 1e-3, grip="medium")
    twin = Twin(scene, Omni(), handle=Plant())
    ticks = len(twin.run(intent))  # compiles, and moves the Omni to its start
    run, reset = partial(twin.run, intent), partial(twin.reset, intent.target_W_m[0])
    least_s = min(timeit.repeat(run, reset, number=1, repeat=TWIN_REPEATS))
    sheet.add("twin, Omni, handle", "tick", 1e6 * least_s / ticks, "µs")


def _do_nothing(touch: Any, p: Any, table: Any, s: Any, out: Any) -> None:
    pass
