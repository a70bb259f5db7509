"""The twin: a scene, a device and a hand in one closed loop."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.argument import numbers, positions
from hapscene.constants import ACCELERATION_RATE_HZ, TICK_S
from hapscene.contact.world import records
from hapscene.device.hand import HAND
from hapscene.device.limit import Limits
from hapscene.device.point import PointMass
from hapscene.errors import HapsceneError
from hapscene.records import ROW
from hapscene.renderer import EFFECTS, Renderer
from hapscene.twin.feel import FELT, Feel
from hapscene.twin.intent import Intent
from hapscene.twin.loop import DELAY_MAX, Plant, live

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene
    from hapscene.surface.effect import Effect


class Twin:
    """A hand that touches a scene with a device: the real tick, closed over a simulated arm.

    Args:
        scene: what is there.
        device: what the hand holds.
        effects, seed, tick_s, a_rate_Hz, limits: as `Renderer` has them.
        delay_ticks: how many ticks later a force goes out: 0 for a loop that writes in the tick in which it read.

    Attributes:
        renderer: the renderer in the loop; `tune` it as you like.

    Raises:
        HapsceneError: a delay out of range, or what `Renderer` refuses.
    """

    def __init__(
        self,
        scene: "Scene",
        device: PointMass,
        effects: "Sequence[str | Effect]" = EFFECTS,
        seed: int = 0,
        tick_s: float = TICK_S,
        a_rate_Hz: float = ACCELERATION_RATE_HZ,
        limits: Limits | None = None,
        delay_ticks: int = 0,
    ) -> None:
        if not 0 <= delay_ticks < DELAY_MAX:
            raise HapsceneError(f"delay_ticks must be 0 to {DELAY_MAX - 1}, is {delay_ticks}")
        self.device = device
        self.renderer = Renderer(scene, effects, seed, tick_s, a_rate_Hz, limits)
        self._delay = delay_ticks
        self._plant: Any = None

    def reset(self, p_WT: ArrayLike, v_WT_m_s: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """Start anew, the tool at `p_WT` (3,) [m] with a velocity (3,), no force on its way.

        Raises:
            PathError: not three finite numbers.
        """
        p = positions(numbers(p_WT).reshape(1, -1))[0]
        point = self.device.record(p)
        point.v_m_s = numbers(v_WT_m_s)
        wait_N, ticks = np.zeros((DELAY_MAX, 3)), np.zeros(1, np.int64)
        self._plant = Plant(point, records(1, HAND), wait_N, ticks, self._delay)
        self.renderer.reset(p)

    def run(self, intent: Intent) -> Feel:
        """Live through an intention, a tick for each of its rows.

        Goes on from where the last one ended; the first starts at rest at the intention's first target.
        """
        if self._plant is None:
            self.reset(intent.target_W_m[0])
        n, renderer = len(intent), self.renderer
        rows, felt = records(n, ROW), records(n, FELT)
        a_m_s2, a_handle_m_s2 = np.zeros((n, renderer.block)), np.zeros((n, renderer.block))
        hand = (intent.target_W_m, intent.grip, intent.push_W_N)
        live(renderer.world, renderer.surface, self._plant, *hand, rows, a_m_s2, felt, a_handle_m_s2)
        return Feel(
            recording=renderer.recording(rows, a_m_s2),
            p_W_m=_column(felt, "p_W_m"),
            v_W_m_s=_column(felt, "v_W_m_s"),
            target_W_m=intent.target_W_m,
            f_motor_W_N=_column(felt, "f_motor_W_N"),
            f_hand_W_N=_column(felt, "f_hand_W_N"),
            work_J=_column(felt, "work_J"),
            a_handle_m_s2=a_handle_m_s2,
        )


def _column(rows: Any, name: str) -> NDArray[np.float64]:
    return np.ascontiguousarray(rows[name])
