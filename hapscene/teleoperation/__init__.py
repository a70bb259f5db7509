"""Teleoperation: a follower touches a real surface, a leader with the haptography handle feels it; all simulated.

```python
import numpy as np
import hapscene
from hapscene.teleoperation import Impairment, Operation
from hapscene.loop import ReferenceTrajectory

scene = hapscene.Scene()
scene.add("assets/meshes/plate.obj", name="plate", unit="mm", swatch="wood")
path = np.linspace([0.0, 0.0, 0.01], [0.01, 0.0, -0.01], 1000)  # where the leader's hand means its tool to be
operated = Operation(scene, path[0], line=Impairment(delay_s=0.05)).run(ReferenceTrajectory.along(path, grip="medium"))
```

| module | does |
|---|---|
| `leader_follower` | a tick of each end: device, hand, handle, accelerometer |
| `body_follower` | a follower that is a body of a simulation: a robot of MuJoCo, or of whatever has three methods |
| `endpoint` | how they are tied together; the position–position controller; the timeout |
| `wave`, `jitter_buffer` | wave variables, passive over any line; messages that wait for their turn |
| `datagram`, `link` | what they tell each other, and how it is sent; a line that delays, loses and reorders |
| `bilateral_loop`, `operation` | a tick of both; both in one compiled loop: `Operation` |
| `udp_session` | each a process of its own, over UDP |
| `test_plate` | a plate to be touched, and a hand that explores it |
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
