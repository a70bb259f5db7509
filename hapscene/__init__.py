"""hapscene: haptic rendering with a 3-D scene.

```python
import hapscene

scene = hapscene.Scene()
scene.add(hapscene.assets.path("toad"), name="toad", unit="m", swatch="wood")
renderer = hapscene.Renderer(scene)
recording = renderer.run([(0.0, 0.0, 0.05), (0.0, 0.0, 0.04)])  # where the tool is, a row per millisecond
```

A map of the package: `tick.py` is one haptic tick, in order, read it first; `records.py` what passes between the
rooms; `scene/` what is there; `contact/` where the tool touches; `surface/` how it feels; `capture/` from recordings
to swatches; `device/` devices, simulated, and their limits; `handle/` the haptography handle; `twin/` hand, device and
tick in a closed loop; `servo/` the same in a process of its own; `stability/` what holds and where it fails;
`teleoperation/` leader and follower; `paint/` the painter; `view/` pictures, plots, sound; `exchange/` painted scenes
for other programs; `motion/` where a tool goes; `dsp/` signals. `docs/architecture.md` has the lives of a tick, a
recording, a stroke of the brush and a sample of the handle.
"""

import lazy_loader

__version__ = "0.2.0"

__getattr__, _, __all__ = lazy_loader.attach_stub(__name__, __file__)
__all__ += ["__version__"]


def __dir__() -> list[str]:  # as lazy_loader's, and the version
    return sorted(__all__)
