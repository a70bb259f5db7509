"""Simulations whose bodies are touched: MuJoCo, and whatever has the three methods of `Simulation`.

```python
import hapscene
import mujoco

model = mujoco.MjModel.from_xml_path("table.xml")
data = mujoco.MjData(model)
bridge = hapscene.bridge.MuJoCo(model, data, swatches={"crate": "wood"})
renderer = hapscene.Renderer(bridge.scene)
command = bridge.step(renderer, (0.0, 0.0, 0.2))  # one step of the physics, the ticks in it, and what the tool pushes
```
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
