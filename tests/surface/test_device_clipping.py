"""What a device takes of a swatch's numbers: springs that it holds, and the dampers that let it hold more."""

import pytest

from hapscene.device.model import Limits
from hapscene.surface.device_clipping import WALL, given
from hapscene.surface.effect_registry import load_effect

EFFECTS = [load_effect(name) for name in ("wall", "friction")]
LIMITS = Limits(undamped_N_m=400.0, stiffness_N_m=900.0, damping_time_s=1e-3, damping_Ns_m=0.4)
NUMBERS = {
    (WALL, "stiffness_N_m"): 300.0,
    (0, "damping_Ns_m"): 0.0,
    (1, "tangential_stiffness_N_m"): 300.0,
    (1, "tangential_damping_Ns_m"): 0.0,
}


@pytest.mark.parametrize(
    ("spring", "damper"),
    [
        ((WALL, "stiffness_N_m"), (0, "damping_Ns_m")),
        ((1, "tangential_stiffness_N_m"), (1, "tangential_damping_Ns_m")),
    ],
)
@pytest.mark.parametrize(
    ("asked_N_m", "asked_Ns_m", "given_N_m", "given_Ns_m"),
    [
        (400.0, 0.0, 400.0, 0.0),
        (600.0, 0.0, 600.0, 0.2),
        (600.0, 0.3, 600.0, 0.3),
        (600.0, 9.0, 600.0, 0.4),
        (5000.0, 0.0, 900.0, 0.4),
    ],
)
def test_each_spring_has_its_own_damper(spring, damper, asked_N_m, asked_Ns_m, given_N_m, given_Ns_m):
    """Beyond what is held undamped it is damped, up to what the device holds; the other spring stays as it is."""
    taken = given(LIMITS, EFFECTS, NUMBERS | {spring: asked_N_m, damper: asked_Ns_m})
    assert taken == NUMBERS | {spring: given_N_m, damper: pytest.approx(given_Ns_m)}


def test_a_spring_that_nothing_damps_is_softer():
    for spring in ((WALL, "stiffness_N_m"), (1, "tangential_stiffness_N_m")):
        assert given(LIMITS, EFFECTS, {spring: 600.0}) == {spring: 400.0}
