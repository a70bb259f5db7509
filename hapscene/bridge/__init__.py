"""Connection of haptic rendering to other programs: MuJoCo, any simulation with the methods of `Simulation`, and game
engines over a socket, as specified in docs/reference/bridge-protocol.md.

```python
import hapscene
import mujoco

crate = '<body name="crate"><freejoint/><geom type="box" size=".05 .05 .05" mass=".2"/></body>'
model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{crate}</worldbody></mujoco>")
data = mujoco.MjData(model)
bridge = hapscene.bridge.MuJoCo(model, data, swatches={"crate": "wood"})
renderer = hapscene.Renderer(bridge.scene)
command = bridge.step(renderer, (0.0, 0.0, 0.06))  # one step of MuJoCo, with the haptic ticks in it
```
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
