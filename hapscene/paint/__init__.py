"""The painter: paint swatches onto a scene, from a program (`model`) or in the browser (`web`).

```python
import hapscene
session = hapscene.paint.Session(hapscene.load_scene(hapscene.assets.path("demo")))
session.begin_stroke("wood", radius_m=0.004)
session.drag_to(origin_W_m=(0.0, 0.0, 0.1), direction_W=(0.0, 0.0, -1.0))  # once for each pointer move
session.end_stroke()
session.save("cup.scene.json")
```

Start with `model.session`. Only the modules of `web` import viser.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
