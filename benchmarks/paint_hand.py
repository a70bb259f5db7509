"""The painter's hand on the ball, without a pointer: so that it can touch while the pointer does something else."""

import asyncio
import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.paint.web.page import Page

from .paint_browser import RADIUS_M, do, until

FORCE_N: Final = 1.0
STIFFNESS_N_M: Final = 400.0


@contextmanager
def touching(page: Page, strokes: bool) -> Iterator[Any]:
    """Meanwhile the hand presses on the ball's front, at rest or to and fro at up to 50 mm/s; yields the servo.

    Raises:
        ViewError: the hand does not get there.
    """
    touch, loop = page.context.touch, page.server.get_event_loop()
    do(page, lambda: touch.press(*_contact(0.0)))
    moving = asyncio.run_coroutine_threadsafe(_stroke(page), loop) if strokes else None
    try:
        until(lambda: bool(touch.servo.state().touching), "the painter's hand does not touch the ball")
        yield touch.servo
    finally:
        if moving is not None:
            moving.cancel()
        do(page, lambda: touch.lift(time.monotonic()))


async def _stroke(page: Page) -> None:
    began_s = time.monotonic()
    while True:
        page.context.touch.move(*_contact(0.3 * math.sin(5.5 * (time.monotonic() - began_s))))
        await asyncio.sleep(1 / 60)


def _contact(angle_rad: float) -> tuple[NDArray[np.float64], NDArray[np.float64], float, float]:
    """Place, normal, force and stiffness, so far round the ball from its front."""
    nhat = np.array([0.8 * math.sin(angle_rad), -0.8 * math.cos(angle_rad), 0.6])
    return RADIUS_M * nhat, nhat, FORCE_N, STIFFNESS_N_M
