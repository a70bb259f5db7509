"""The question of the whole tick: how far all that is felt is from the best, against the worst tick."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Final

import numpy as np

from hapscene.constants import TICK_S
from hapscene.perception import force_jnd
from hapscene.recording import Recording
from hapscene.renderer import EFFECTS, Renderer
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import Texture
from hapscene.swatches.library import load_swatch

from ..tick_time import hot
from .measuring import RATE_HZ, apart_jnd, enough, texture_bands
from .mesh import CREASE_RAD, DEPTH_M, LATE
from .question import Measure, Point, Question, Setting
from .touched_surface import Array, Touched, bodies_of, reduced, touched

DIVISORS: Final = (1, 4, 16, 64)
ORDERS: Final = (0, 8, 20, 40)
"""Of the texture; 0 leaves it as it is."""

TICKS_MS: Final = (1, 2, 4)
"""From one tick to the next [ms]."""

SLIP_M_S: Final = 5e-3
"""Slip from which a texture is judged [m/s]."""

PLACES: Final = 60
"""Ticks at which the texture's spectrum is looked at [count]."""


def settings(quick: bool, scene_file: str | None) -> list[Setting]:
    bodies = bodies_of(scene_file)[:1]
    divisors, orders = (DIVISORS[::2], ORDERS[::3]) if quick else (DIVISORS, ORDERS)
    found = []
    for body, shaded, every_ms in product(bodies, (False, True), (1,) if quick else TICKS_MS):
        for divisor, order in product(divisors, orders):
            arguments = {"scene_file": scene_file, "body": body, "divisor": divisor, "order": order,
                         "shaded": shaded, "every_ms": every_ms}  # fmt: skip
            method = f"tick of {every_ms} ms" + (", shaded" if shaded else "")
            found.append(Setting(method, f"÷{divisor}, order {order or 'own'}", arguments))
    return found


def swatch_of(on: Touched, order: int) -> Swatch:
    """The swatch that is touched most, wood where that has no texture, its models of a lower order."""
    swatch = on.swatch if on.swatch.texture is not None else load_swatch("wood")
    assert swatch.texture is not None
    return replace(swatch, texture=swatch.texture.truncated(order)) if order else swatch


def error(scene_file: str | None, body: str, divisor: int, order: int, shaded: bool, every_ms: int) -> dict[str, float]:
    on = touched(scene_file, body)
    swatch = swatch_of(on, order)
    scene = on.scene(reduced(scene_file, body, divisor), swatch)
    crease_rad = CREASE_RAD if shaded else 0.0
    renderer = Renderer(scene, ["wall"], tick_s=every_ms * TICK_S, crease_rad=crease_rad)
    found = errors(on, renderer.run(on.p_WT_m[::every_ms]), swatch, swatch_of(on, 0), every_ms)
    return {"total": max(found.values()), **found}


def errors(on: Touched, felt: Recording, swatch: Swatch, best: Swatch, every: int) -> dict[str, float]:
    """Of the force and of the vibration's bands [JND], against closest points and the best swatch's own spectra.

    The vibration's spectra are those of the models at the force and the slip that were felt, in closed form: no noise.
    """
    count = len(on.p_WT_m)
    held = np.minimum(np.arange(count) // every, len(felt) - 1)  # a force is held until the next tick
    force_N, true_N = felt.f_W_N[held], best.stiffness_N_m * on.into_m
    true_m = np.linalg.norm(on.into_m, axis=1)
    touching = felt.touching[held] | (true_m > 0.0)
    force = float(np.percentile(force_jnd(force_N, true_N)[touching], LATE))
    slip_m_s = _slip_m_s(on)
    sliding = np.flatnonzero((true_m > DEPTH_M) & (slip_m_s > SLIP_M_S))
    if not len(sliding) or swatch.texture is None or best.texture is None:
        return {"force": force}
    at = sliding[np.linspace(0, len(sliding) - 1, min(PLACES, len(sliding))).astype(int)]
    true = _bands(best.texture, best.stiffness_N_m * true_m[at], slip_m_s[at])
    found = _bands(swatch.texture, felt.normal_force_N[held[at]], slip_m_s[at])
    return {"force": force, "vibration": float(np.percentile(apart_jnd(found, true), LATE))}


def _slip_m_s(on: Touched) -> Array:
    """Speed (n,) of the tool across the surface: what of its velocity is not along the force."""
    v = np.gradient(on.p_WT_m, TICK_S, axis=0)
    n = on.into_m / np.maximum(np.linalg.norm(on.into_m, axis=1, keepdims=True), 1e-12)
    return np.asarray(np.linalg.norm(v - np.einsum("ni,ni->n", v, n)[:, None] * n, axis=1))


def _bands(texture: Texture, force_N: Array, slip_m_s: Array) -> Array:
    texture = texture.resampled(RATE_HZ)
    return texture_bands(texture, force_N, slip_m_s)


def time(
    scene_file: str | None, body: str, divisor: int, order: int, shaded: bool, every_ms: int
) -> tuple[float, float]:
    """The 99th percentile and the longest tick, with all five effects."""
    on = touched(scene_file, body)
    scene = on.scene(reduced(scene_file, body, divisor), swatch_of(on, order))
    crease_rad = CREASE_RAD if shaded else 0.0
    renderer = Renderer(scene, EFFECTS, tick_s=every_ms * TICK_S, crease_rad=crease_rad)
    ticks = hot(renderer, on.p_WT_m[::every_ms], 3).tick_ns
    return 1e-3 * float(np.percentile(ticks, 99)), 1e-3 * float(np.max(ticks))


def advice(points: Sequence[Point]) -> str:
    whole, least = points[0], enough(points, "total", 1.0)
    reached = least.errors["total"] <= 1.0
    said = "the quickest that nobody tells from the best" if reached else "the nearest to the truth"
    return (
        f"Choose {least.method}, {least.label}: {said}, {least.errors['total']:.2g} JND at {least.median_us:.2g} µs a "
        f"tick (p99), where all of it takes {whole.median_us:.2g} and is {whole.errors['total']:.2g} off. The order of "
        "the texture is what a tick costs, the mesh is what the force is worth: cut the first to what is felt, the "
        "second only for memory. Not on a surface that rings at sharp lines, nor where a slower tick must hold a stiff "
        "wall."
    )


QUESTION: Final = Question(
    name="whole-tick",
    title="How much of everything is needed?",
    measures=(
        Measure("total", "all that is felt: the larger of force and vibration", "JND", 1.0),
        Measure("force", "force, off by (95 % of ticks)", "JND", 1.0, "7 % or 18.4°: Pang 1991, Barbagli 2006"),
        Measure("vibration", "vibration's bands, off by (95 % of ticks)", "JND", 1.0, "2 dB a band, Israr 2006"),
    ),
    settings=settings,
    error=error,
    time=time,
    advice=advice,
    conditions="The largest body of the scene, all of the swatch that its path meets most (wood where that has no "
    "texture), along the path of a hand that explores it. Truth: the closest point of the unreduced mesh at each "
    "millisecond, and the spectra of the swatch's own models there. The error is of wall and texture; the time is of a "
    "tick with wall, friction, texture and tap.",
    quantiles=("p99", "longest"),
)
