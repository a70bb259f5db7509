"""The tick in a process of its own: no viewer, plot or garbage collection of the application makes it late.

from hapscene.servo import Servo
with Servo(scene, device) as servo:
    servo.aim((0.0, 0.0, -0.002))
    servo.state().f_W_N
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
