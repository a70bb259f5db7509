"""The tick in a process of its own: no viewer, plot or garbage collection of the application makes it late.

```python
import hapscene
from hapscene.device.omni import Omni
from hapscene.servo import Servo

if __name__ == "__main__":  # the process is new, and reads this file too
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
