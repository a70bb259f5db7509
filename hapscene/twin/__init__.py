"""The twin: a hand, a device and the tick in one closed loop, so that contact forces move the tool.

from hapscene.twin import Intent, Twin
twin = Twin(scene, device="omni")
felt = twin.run(Intent.hold((0, 0, -0.01), tick_s=1e-3, duration_s=1.0, grip="light"))
"""

from hapscene.twin.feel import Feel
from hapscene.twin.intent import Intent
from hapscene.twin.twin import Twin

__all__ = ["Feel", "Intent", "Twin"]
