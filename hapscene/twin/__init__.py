"""The twin: a hand, a device and the tick in one closed loop, so that contact forces move the tool.

```python
import numpy as np
import hapscene
from hapscene.device.omni import Omni
from hapscene.twin import Intent, Twin

scene = hapscene.Scene()
scene.add("assets/meshes/plate.obj", name="plate", unit="mm", swatch="wood")
path = np.linspace([0.0, 0.0, 0.01], [0.01, 0.0, -0.01], 1000)  # where the hand means the tool to be, a second long
feel = Twin(scene, Omni()).run(Intent.along(path, grip="light"))
print(feel.recording.f_W_N[-1])
```
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
