"""Textures that rise and fall, or that go on beyond what was recorded, on a stiff wall.

On a device without an actuator in its handle a texture is folded into the force of the motors. How loud it is depends
on the force and the speed of the tool, which it moves: so it might feed itself through the wall. The tool slides, held
by nobody and pushed evenly, twice: from depths that differ by a ten-millionth, with the same random numbers. How fast
the two strokes part is the growth of a small motion, noise or no noise; where it passes zero is the critical stiffness.
"""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from hapscene.constants import LEVEL_BOUND_DB, TICK_S
from hapscene.device.hand import GRIPS, Grip
from hapscene.device.model import Limits
from hapscene.device.point import PointMass
from hapscene.renderer import Renderer
from hapscene.stability.answer import Answer
from hapscene.stability.closed_form import limit_without_delay
from hapscene.stability.rig import sheet
from hapscene.stability.wall_chart import draw_panels
from hapscene.surface.life import Life
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import Texture
from hapscene.swatches.library import load_swatch
from hapscene.twin.hand_intent import Intent
from hapscene.twin.twin import Twin
from hapscene.view.palette import INK, OKABE_ITO

Array = NDArray[np.float64]

DEVICE: Final = PointMass(mass_kg=0.05, b_Ns_m=0.5, c_N=0.0, quantum_m=0.0)
FOLD_KG: Final = 0.045
"""The mass by which all of a texture is folded into its force [kg]: as of an Omni."""

PUSH_N, SPEED_M_S, SIDE_M = 1.0, 0.1, 12.0
"""The even push, the speed of the stroke, and the side of the sheet, on which the fastest stroke finds room."""

APART: Final = 1e-7
"""How far the two strokes are apart at first, over their depth [1]."""

SETTLE, TICKS = 20, 1500
"""Ticks for which the hand leads the tool, and for which it is then left alone [count]."""

LIFE: Final = Life(np.array([0.5, 0.4, 0.3]), np.array([100.0, 20.0, 3.0]), np.zeros(3))
"""As lively as any recording: a standard deviation of 0.7, 6 dB."""

FAST: Final = 5.0
"""How many times faster than the fastest recorded the stroke is that is felt beyond it [1]."""


@cache
def textures() -> dict[str, Texture | None]:
    """What the tool slides over, by name."""
    wood = load_swatch("wood").texture
    assert wood is not None
    steady = replace(wood, life=None, exponents=np.zeros(2))
    return {
        "no texture": None,
        "steady": steady,
        "alive": replace(steady, life=LIFE),
        "beyond": replace(steady, exponents=np.array([1.0, 2.0])),
    }


def speed_of(name: str) -> float:
    """The speed of the stroke over a texture [m/s]: what goes on beyond the recorded is felt there."""
    texture = textures()[name]
    return FAST * texture.speed_max_m_s if name == "beyond" and texture is not None else SPEED_M_S


def life_cases() -> list[Answer]:
    """All of them, in about 10 s."""
    said = "critical stiffness over that of the wall alone [1]"
    answers = [Answer(f"life-{name}", said, 1.0, critical(name), 0.02) for name in textures()]
    return [*answers, *levels()]


def wall_N_m() -> float:
    """The closed form of the wall alone [N/m]."""
    return limit_without_delay(DEVICE.mass_kg, DEVICE.b_Ns_m, TICK_S)


def critical(name: str) -> float:
    """The stiffness at which small motion over a texture neither grows nor dies, over the wall's own limit [1]."""
    return float(brentq(lambda share: growth(name, share * wall_N_m()), 0.8, 1.2, xtol=1e-3))


def growth(name: str, stiffness_N_m: float) -> float:
    """Natural logarithm of how much small motion grows in a tick, below 0 where it dies."""
    one, two = (_stroke(name, stiffness_N_m, apart) for apart in (0.0, APART))
    apart, part = np.abs(one - two), TICKS // 5
    start, end = (math.sqrt(float(np.mean(apart[window] ** 2))) for window in (np.s_[part : 2 * part], np.s_[-part:]))
    return math.log(max(end, 1e-30) / start) / (TICKS - 2 * part)


def _stroke(name: str, stiffness_N_m: float, apart: float) -> Array:
    """Heights (n,) [m] of a tool that slides, held by nobody, after a hand has led it to its depth."""
    texture, speed = textures()[name], speed_of(name)
    wall = Swatch("wall", stiffness_N_m=stiffness_N_m, texture=texture)
    twin = Twin(
        sheet(wall, SIDE_M), DEVICE, ["wall", "lpc_texture"], tick_s=TICK_S, limits=Limits(fold_mass_kg=FOLD_KG)
    )
    depth = PUSH_N / stiffness_N_m * (1.0 + apart)
    down = np.concatenate((depth * np.linspace(-0.01, 1.0, 4)[:3], np.full(SETTLE, depth)))
    target = np.column_stack((speed * TICK_S * np.arange(len(down)) - 0.4 * SIDE_M, np.full(len(down), 0.01), -down))
    k_N_m = 100.0 * max(DEVICE.mass_kg / TICK_S**2, stiffness_N_m)
    grip = np.broadcast_to(Grip(k_N_m, 2.0 * math.sqrt(k_N_m * DEVICE.mass_kg)).row(), target.shape).copy()
    grip[-1] = 0.0
    push = (DEVICE.b_Ns_m * speed, 0.0, -PUSH_N)
    twin.reset(target[0])
    twin.run(Intent(target, grip, np.broadcast_to(push, target.shape)))
    return np.asarray(twin.run(Intent.hold((0.0, 0.0, 0.0), TICKS, GRIPS["none"], push_W_N=push)).p_W_m[:, 2])


def levels(seconds: float = 200.0) -> list[Answer]:
    """Through the tick: life keeps the mean power, and beyond the recorded the level goes to its bound."""
    steady, alive = (played(name, seconds) for name in ("steady", "alive"))
    loudest = float(np.abs(alive).max()) / float(np.std(steady))
    texture = textures()["beyond"]
    assert texture is not None
    edge, beyond = (float(np.mean(played("beyond", 2.0, speed * texture.speed_max_m_s) ** 2)) for speed in (1.0, FAST))
    rise_dB = 10.0 * math.log10(beyond / edge)
    faster = f"level at {FAST:g} times the fastest recorded, over that there [dB]"
    power = float(np.var(alive) / np.var(steady))
    return [
        Answer("life-power", "mean power, alive over steady [1]", 1.0, power, 0.15),
        Answer("life-peak", "loudest sample over the steady level [1]", 40.0, loudest, 0.0, at_most=True),
        Answer("beyond-bound", faster, LEVEL_BOUND_DB, rise_dB, 0.1),
    ]


def played(name: str, seconds: float, speed_m_s: float = SPEED_M_S, seed: int = 0) -> Array:
    """The acceleration (n,) [m/s²] of a steady stroke to and fro at a depth, through the tick."""
    swatch = Swatch("wall", stiffness_N_m=500.0, texture=textures()[name])
    along = speed_m_s * TICK_S * np.arange(round(seconds / TICK_S))
    there = 0.4 * SIDE_M - np.abs((along % (1.6 * SIDE_M)) - 0.8 * SIDE_M)
    path = np.column_stack((there, np.full(len(along), 0.01), np.full(len(along), -2e-3)))
    path[0, 2] = 1e-3
    renderer = Renderer(sheet(swatch, SIDE_M), ["wall", "lpc_texture"], seed=seed, tick_s=TICK_S)
    return np.asarray(renderer.run(path).a_m_s2[200:].ravel())


COLOURS: Final = "green", "blue", "orange", "purple"


def draw_life(path: Path) -> None:
    """Chart of growth over stiffness."""
    draw_panels(path, 1, 1, (7.0, 4.6), lambda _, axes: _draw(axes[0, 0]))


def _draw(axes: Any) -> None:
    shares = np.linspace(0.7, 1.3, 13)
    for name, colour, marker in zip(textures(), COLOURS, "os^v", strict=True):
        grown = [1e3 * growth(name, share * wall_N_m()) for share in shares]
        axes.plot(shares, grown, marker, color=OKABE_ITO[colour], label=name)
    axes.axhline(0.0, color=INK, linewidth=0.8)
    axes.axvline(1.0, color=INK, linewidth=0.8, linestyle=":")
    axes.set(xlabel="stiffness over the wall's own limit [1]", ylabel="growth of small motion [1/s]")
    axes.set_title("A texture folded into the force of a wall")
    axes.legend(loc="upper left")
