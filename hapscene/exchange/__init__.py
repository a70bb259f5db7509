"""Export of painted scenes to GLB, PLY, OBJ and HTML, and import from GLB and mesh files.

```python
import hapscene
from hapscene.exchange import export_scene, import_scene

scene = hapscene.load_scene("assets/demo.scene.json")
export_scene(scene, "painted.glb")
scene = import_scene("painted.glb")
```

docs/reference/file-formats.md has a table of what each format preserves.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
