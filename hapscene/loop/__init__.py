"""Closed loops of device, haptic tick and handle: `Twin` is simulated, `Servo` runs in real time.

```python
import numpy as np
import hapscene
from hapscene.device.sim.omni import Omni
from hapscene.loop import ReferenceTrajectory, Twin

scene = hapscene.Scene()
scene.add("assets/meshes/plate.obj", name="plate", unit="mm", swatch="wood")
path = np.linspace([0.0, 0.0, 0.01], [0.01, 0.0, -0.01], 1000)  # target of the hand, 1 s
result = Twin(scene, Omni()).run(ReferenceTrajectory.along(path, grip="light"))
print(result.recording.f_W_N[-1])
```

```python
import hapscene
from hapscene.device.sim.omni import Omni
from hapscene.loop import Servo

if __name__ == "__main__":  # the process of the servo imports this file
    scene = hapscene.Scene()
    scene.add("assets/meshes/plate.obj", name="plate", unit="mm", swatch="wood")
    with Servo(scene, Omni()) as servo:
        servo.start((0.0, 0.0, 0.01))
        servo.aim((0.0, 0.0, 0.002))
        print(servo.state().f_W_N)
```
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
