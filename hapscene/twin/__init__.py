"""The twin: a hand, a device and the tick in one closed loop, so that contact forces move the tool.

from hapscene.device.omni import Omni
from hapscene.twin import Intent, Twin
twin = Twin(scene, Omni())
feel = twin.run(Intent.hold((0.0, 0.0, -0.01), count=1000, grip="light"))
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
