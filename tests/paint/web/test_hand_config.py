"""What the hand can hold."""

from typing import Any

import numpy as np
import pytest

from hapscene.device.model import DEVICES
from hapscene.device.sim.omni import Omni
from hapscene.errors import HapsceneError
from hapscene.handle import COMPENSATORS
from hapscene.paint.web.hand import COMPENSATOR_HINTS, HAND_DEVICES, NO_HANDLE, HandConfig


def test_every_device_that_moves_and_every_compensator_can_be_held() -> None:
    movable = {name for name, device in DEVICES.items() if device.point is not None}
    assert {held.limits for held in HAND_DEVICES.values()} == movable
    assert [name for name, held in HAND_DEVICES.items() if isinstance(held.model, Omni)] == ["omni"]
    assert set(COMPENSATOR_HINTS) == {*COMPENSATORS, NO_HANDLE} - {"none"}


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"device": "ideal"}, "'ideal'.*omni, omni-point"),
        ({"device": "omi"}, "'omi'"),
        ({"grip": "none"}, "'none'"),
        ({"compensator": ["flat"]}, "compensator"),
    ],
)
def test_unsupported_device_is_refused(given: dict[str, Any], said: str) -> None:
    with pytest.raises(HapsceneError, match=said):
        HandConfig(**given)


@pytest.mark.parametrize("start", [(0.0, 0.0, 0.0), (2.0, -1.0, 0.3)])
def test_arm_reaches_its_workspace_only(start: tuple[float, ...]) -> None:
    at = np.array(start)
    for way in ((0.08, 0.0, 0.0), (0.0, 0.035, 0.0), (0.0, 0.0, 0.06)):
        assert HandConfig().reaches(at, at + way) and HandConfig().reaches(at, at - way)
    assert not HandConfig().reaches(at, np.add(at, (0.0, 0.0, 1.0)))
    assert HandConfig("premium-1.5").reaches(at, np.add(at, (0.0, 0.0, 1.0)))
