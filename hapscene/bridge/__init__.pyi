from .mujoco_bridge import MuJoCo as MuJoCo
from .mujoco_bridge import load_mujoco as load_mujoco
from .server import BridgeServer as BridgeServer
from .simulation import Bridge as Bridge
from .simulation import ChatterWarning as ChatterWarning
from .simulation import Simulation as Simulation
from .simulation import free_mobility as free_mobility
