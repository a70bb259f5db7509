"""What the simulated hand holds: a device, the handle on it, and how firmly; and the servo of it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from hapscene.constants import DEFAULT_GRIP
from hapscene.device.hand import GRIPS
from hapscene.device.model import DEVICES, limits_of
from hapscene.device.omni import Omni, stand
from hapscene.device.omni_kinematics import reachable
from hapscene.device.point import PointMass
from hapscene.errors import HapsceneError, no_such
from hapscene.handle import Plant
from hapscene.scene.scene import Scene
from hapscene.servo import Servo


class HandDevice(NamedTuple):
    """A device that the hand can hold: whose limits it has, a name of `DEVICES`; and how it moves."""

    limits: str
    model: PointMass | Omni


HAND_DEVICES: Final[Mapping[str, HandDevice]] = {
    "omni": HandDevice("omni", Omni()),
    **{
        "omni-point" if name == "omni" else name: HandDevice(name, device.point)
        for name, device in DEVICES.items()
        if device.point is not None
    },
}
"""By name: the whole Omni, as `hapscene touch` has it, and every device as a mass with friction and encoders."""

GRIP_NAMES: Final = tuple(name for name in GRIPS if name != "none")

NO_HANDLE: Final = "no-handle"

COMPENSATOR_HINTS: Final[Mapping[str, str]] = {
    "adaptive": "what the handle gives whose drive learns from its own accelerometer",
    "flat": "what the handle gives, driven by the inverse of its model: even from 20 Hz on",
    "inverse": "what the handle gives, driven by the inverse of its model: weaker the slower it shakes",
    "naive": "what the handle gives, driven by its mass times what is asked for: its spring and the grip are forgotten",
    NO_HANDLE: "what the swatches ask for, as if a perfect handle gave it",
}
"""What is heard and plotted, by compensator. `none` of `hapscene touch` is left out: the handle would stay silent."""


@dataclass(frozen=True)
class HandConfig:
    """What the hand holds.

    Attributes:
        device: a name of `HAND_DEVICES`.
        grip: how firmly, one of `GRIP_NAMES`.
        compensator: what drives the handle, a name of `COMPENSATOR_HINTS`.

    Raises:
        HapsceneError: no such name.
    """

    device: str = "omni"
    grip: str = DEFAULT_GRIP
    compensator: str = "adaptive"

    def __post_init__(self) -> None:
        if self.device == "ideal":
            raise HapsceneError(f"an ideal device has no mass to move; choose one of {', '.join(HAND_DEVICES)}")
        for kind, known in (("device", HAND_DEVICES), ("grip", GRIP_NAMES), ("compensator", COMPENSATOR_HINTS)):
            name = getattr(self, kind)
            if name not in tuple(known):  # a page may send anything
                raise HapsceneError(no_such(kind, name, known))

    @property
    def limits(self) -> str:
        """Whose limits apply, a name of `DEVICES`."""
        return HAND_DEVICES[self.device].limits

    def __str__(self) -> str:
        handle = "no handle" if self.compensator == NO_HANDLE else f"{self.compensator} handle"
        return f"{self.device}, {self.grip} grip, {handle}"

    def reaches(self, from_W_m: Any, p_W_m: Any) -> bool:
        """Whether an arm whose tool began at `from_W_m` (3,) gets it to `p_W_m` (3,) [m]; a point mass always does."""
        if not isinstance(HAND_DEVICES[self.device].model, Omni):
            return True
        X_WD = stand(from_W_m)  # as the servo's twin places it
        return bool(reachable(X_WD[:3, :3].T @ (p_W_m - X_WD[:3, 3])))


def make_servo(scene: Scene, config: HandConfig, tick_s: float, servo: type[Servo] = Servo) -> Servo:
    """A servo with a hand that holds this; an arm is placed anew for each touch, so that it begins in the middle."""
    handle: dict[str, Any] = {}
    if config.compensator != NO_HANDLE:
        handle = {"handle": Plant(), "compensator": config.compensator}
    model = HAND_DEVICES[config.device].model
    return servo(scene, model, tick_s=tick_s, limits=limits_of(config.limits, tick_s), **handle)
