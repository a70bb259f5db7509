"""hapscene: haptic rendering with a 3-D scene.

    import hapscene
    scene = hapscene.Scene()
    scene.add("bunny.ply", name="bunny", unit="m", swatch="wood")
    renderer = hapscene.Renderer(scene)
    recording = renderer.run(p_WT)

A map of the package: `tick.py` is one haptic tick, in order, read it first; `records.py` what passes between the
rooms; `scene/` what is there; `contact/` where the tool touches; `surface/` how it feels; `capture/` from recordings
to swatches; `device/` devices, simulated, and their limits; `handle/` the haptography handle; `twin/` hand, device and
tick in a closed loop; `servo/` the same in a process of its own; `stability/` what holds and where it fails;
`teleoperation/` leader and follower; `paint/` the painter; `view/` pictures, plots, sound; `exchange/` painted scenes
for other programs; `bench/` timings.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from hapscene.errors import HapsceneError as HapsceneError
    from hapscene.recording import Recording as Recording
    from hapscene.records import Flag as Flag
    from hapscene.renderer import Command as Command
    from hapscene.renderer import Renderer as Renderer
    from hapscene.scene.body import Body as Body
    from hapscene.scene.file import load_scene as load_scene
    from hapscene.scene.mesh import Mesh as Mesh
    from hapscene.scene.mesh import load_mesh as load_mesh
    from hapscene.scene.scene import Scene as Scene
    from hapscene.surface.effect import Effect as Effect
    from hapscene.surface.effect import Param as Param
    from hapscene.surface.effect import State as State
    from hapscene.surface.swatch import Swatch as Swatch
    from hapscene.surface.swatch_file import load_swatch as load_swatch
    from hapscene.surface.swatch_file import save_swatch as save_swatch

_HOME = {
    "Body": "hapscene.scene.body",
    "Command": "hapscene.renderer",
    "Effect": "hapscene.surface.effect",
    "Flag": "hapscene.records",
    "HapsceneError": "hapscene.errors",
    "Mesh": "hapscene.scene.mesh",
    "Param": "hapscene.surface.effect",
    "Recording": "hapscene.recording",
    "Renderer": "hapscene.renderer",
    "Scene": "hapscene.scene.scene",
    "State": "hapscene.surface.effect",
    "Swatch": "hapscene.surface.swatch",
    "load_mesh": "hapscene.scene.mesh",
    "load_scene": "hapscene.scene.file",
    "load_swatch": "hapscene.surface.swatch_file",
    "save_swatch": "hapscene.surface.swatch_file",
}
__all__ = ["__version__", *sorted(_HOME)]


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used: `import hapscene` stays fast."""
    if name in _HOME:
        value = getattr(import_module(_HOME[name]), name)
        globals()[name] = value
        return value
    if name in {"capture", "handle", "stability"}:  # rooms with functions of their own
        return import_module(f"hapscene.{name}")
    raise AttributeError(f"module 'hapscene' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
