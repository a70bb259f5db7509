"""hapscene: haptic rendering with a 3-D scene.

```python
import hapscene

scene = hapscene.Scene()
scene.add(hapscene.assets.path("toad"), name="toad", unit="m", swatch="wood")
renderer = hapscene.Renderer(scene)
recording = renderer.run([(0.0, 0.0, 0.05), (0.0, 0.0, 0.04)])  # device positions, one row per millisecond
```

Modules: `render/tick.py` contains one haptic tick and is a good start for reading; `records.py` the data of a tick;
`scene/` bodies and meshes; `contact/` the proxy; `surface/` swatches and effects; `swatches/` the swatch library;
`capture/` fits swatches to recordings; `device/` devices, simulations and limits; `handle/` the haptography handle;
`loop/` the servo and the simulated closed loop; `stability/` stability analysis; `teleoperation/` leader and follower;
`paint/` the painter; `play/` interactive sessions; `view/` pictures, plots and sound; `exchange/` painted scenes for
other programs; `motion/` tool paths; `dsp/` signal processing. See `docs/explanation/architecture.md`.
"""

import lazy_loader

__version__ = "0.2.0"

__getattr__, _, __all__ = lazy_loader.attach_stub(__name__, __file__)
__all__ += ["__version__"]


def __dir__() -> list[str]:  # adds the version to the names of lazy_loader
    return sorted(__all__)
