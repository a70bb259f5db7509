"""A simulated device as a driver, for tests and for work without hardware.

A simulated hand holds it in place with the given grip. Each `write` advances the simulation by one millisecond.
"""

from hapscene.constants import TICK_S
from hapscene.device.driver import Connection, Driver, Found, Option
from hapscene.device.model import DEVICES
from hapscene.device.sim.arm import advance_arm, drive_arm, new_arm, read_arm, simulated_device
from hapscene.device.sim.hand import GRIPS, grip_named
from hapscene.device.sim.omni import stand

MODELS = tuple(name for name, device in DEVICES.items() if device.point is not None)


class SimulatedConnection(Connection):
    """A simulated device in a simulated hand."""

    def __init__(self, model: str, grip: str) -> None:
        super().__init__()
        self._arm = new_arm(simulated_device(model), (0.0, 0.0, 0.0), stand((0.0, 0.0, 0.0)))
        held, hand = grip_named(grip), self._arm.hand
        hand.k_N_m, hand.b_Ns_m, hand.mass_kg = held.k_N_m, held.b_Ns_m, held.mass_kg
        self.state.ready = 1

    def read(self) -> None:
        self.state.p_DT_m = read_arm(self._arm)
        self.state.count += 1

    def write(self) -> None:
        x, y, z = self.state.f_D_N[0].tolist()
        drive_arm(self._arm, (x, y, z))
        advance_arm(self._arm, TICK_S)

    def close(self) -> None:
        drive_arm(self._arm, (0.0, 0.0, 0.0))


DRIVER = Driver(
    name="simulated",
    summary="Simulated Omni or other Phantom in a simulated hand; no hardware.",
    open=SimulatedConnection,
    find=lambda **options: [Found("built in")],
    model=DEVICES["omni"],
    options=(
        Option("model", "omni", "simulated device", MODELS),
        Option("grip", "light", "grip of the simulated hand", tuple(GRIPS)),
    ),
    simulated=True,
)
