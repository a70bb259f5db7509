"""The twin: a hand, a device and the tick in one closed loop, so that contact forces move the tool.

from hapscene.device.omni import Omni
from hapscene.twin import Intent, Twin
twin = Twin(scene, Omni())
feel = twin.run(Intent.hold((0.0, 0.0, -0.01), count=1000, grip="light"))
"""

from hapscene.twin.feel import Feel
from hapscene.twin.intent import Intent
from hapscene.twin.twin import Twin

__all__ = ["Feel", "Intent", "Twin"]
