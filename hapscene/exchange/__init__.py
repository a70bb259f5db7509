"""Painted scenes for other programs, and back: what may be written and read.

```python
import hapscene
from hapscene.exchange import export_scene, import_scene

scene = hapscene.load_scene("assets/demo.scene.json")
export_scene(scene, "painted.glb")
scene = import_scene("painted.glb")
```

What each format keeps and loses is in docs/exchange.md, as measured by round trip.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
