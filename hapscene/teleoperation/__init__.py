"""Teleoperation: a follower touches a surface, and a leader with a haptography handle renders what it feels.

Both devices and the link between them are simulated.

```python
import numpy as np
import hapscene
from hapscene.teleoperation import Impairment, Operation
from hapscene.loop import ReferenceTrajectory

scene = hapscene.Scene()
scene.add("assets/meshes/plate.obj", name="plate", unit="mm", swatch="wood")
path = np.linspace([0.0, 0.0, 0.01], [0.01, 0.0, -0.01], 1000)  # reference trajectory of the leader's hand
result = Operation(scene, path[0], line=Impairment(delay_s=0.05)).run(ReferenceTrajectory.along(path, grip="medium"))
```

| module | content |
|---|---|
| `leader_follower` | one tick of each device: arm, hand, handle, accelerometer |
| `endpoint` | state of one end, the position–position controller |
| `wave` | wave variables, passive over any link |
| `jitter_buffer` | what each end sends in a tick; the queue that reorders and delays messages |
| `operation` | both devices and a simulated link with delay, jitter and loss in one compiled loop: `Operation` |
| `plate` | a plate to touch, and a hand that explores it |
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
