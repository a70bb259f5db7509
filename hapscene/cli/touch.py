"""`hapscene touch` and `hapscene demo`."""

import json
from collections.abc import Iterable, Sequence
from contextlib import nullcontext, suppress
from copy import copy
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from hapscene.cli.console import print_files, print_progress, print_warning
from hapscene.cli.inputs import base_name, check_scene, find_asset, load_input, loading
from hapscene.cli.options import (
    Compensator,
    Count,
    Dark,
    Device,
    Grip,
    Help,
    InFile,
    MeshOptions,
    Names,
    OutFolder,
    Positive,
    Seed,
    TipRadius,
)
from hapscene.constants import ACCELERATION_RATE_HZ, DEFAULT_GRIP, TICK_S
from hapscene.errors import EffectError, PathError, no_such

if TYPE_CHECKING:
    from hapscene.bridge import MuJoCo
    from hapscene.loop import Twin
    from hapscene.scene.scene import Scene

__all__ = ["demo", "touch"]


def demo(*, out: OutFolder = Path("out/demo"), dark: Dark = False) -> None:
    """Simulate a hand that taps, presses and strokes the demo scene; write forces, plots and audio.

    The scene has three bodies with four surfaces whose textures were fitted to
    recordings. To touch it yourself, run `hapscene play`.

    examples:
      hapscene demo
      hapscene demo --out out/first --dark
    """
    touch("demo", out=out, dark=dark)


@Parameter(name="*", group="Closed loop: a simulated hand holds a simulated device")
@dataclass(frozen=True)
class HandOptions:
    """Options of a simulated hand and the simulated device that it holds."""

    hand: Annotated[str | None, Help("Gesture: tap, press, stroke, explore, …; or follow, along --path")] = None
    grip: Grip = DEFAULT_GRIP
    device: Device = "omni"
    compensator: Compensator = "adaptive"
    delay: Annotated[Count, Help("Delay of the force [ticks]")] = 0

    def check(self, path: Path | None) -> None:
        """Check the names and the combination of options.

        Raises:
            HapsceneError: an unknown name, or an option that needs another one.
        """
        if self.hand is None:
            for option, value in asdict(HandOptions()).items():
                if getattr(self, option) != value:
                    raise PathError(f"--{option} needs --hand, the gesture of the closed loop, as in --hand stroke")
            return
        from hapscene.device.model import device_named
        from hapscene.device.sim.hand import grip_named
        from hapscene.handle.compensator import find_compensator
        from hapscene.motion.gestures import GESTURES

        if self.hand not in (*GESTURES, "follow"):
            raise PathError(no_such("gesture", self.hand, [*GESTURES, "follow"]))
        if (self.hand == "follow") != (path is not None):
            raise PathError(f"--hand {self.hand}: --path is required for --hand follow, and invalid for other gestures")
        grip_named(self.grip)
        find_compensator(self.compensator)
        if device_named(self.device).point is None:
            raise PathError("--device ideal has no mass to simulate; choose omni, phantom-1.0 or premium-1.5")


def _parse_settings(texts: Sequence[str]) -> dict[str, dict[str, object]]:
    """Parse settings such as "weight.mass_kg=0.2" and "guide.points_m=[[0, 0, 0.1]]" into values by effect and name."""
    settings: dict[str, dict[str, object]] = {}
    for text in texts:
        where, _, value = text.partition("=")
        effect, _, name = where.strip().partition(".")
        if not (effect and name and value.strip()):
            raise EffectError(f"--set {text[:40]}: expected EFFECT.NAME=VALUE, as in weight.mass_kg=0.2")
        settings.setdefault(effect, {})[name] = value.strip()  # the name of a body, if it is not valid JSON
        with suppress(ValueError, RecursionError):
            settings[effect][name] = json.loads(value)
    return settings


def touch(
    scene: Annotated[str, Help("Scene, mesh, MuJoCo model (.xml), or name of an asset")],
    /,
    *,
    path: Annotated[
        InFile | None, Help("Path of the tool: CSV with columns t,x,y,z in s and m (default: explores the scene)")
    ] = None,
    out: Annotated[OutFolder | None, Help("Folder for the results (default: out/NAME, as out/bunny)")] = None,
    effects: Annotated[
        Names | None,
        Help("Effects, listed by `hapscene lab effects` (default: wall,friction,lpc_texture,tap,adhesion)"),
    ] = None,
    settings: Annotated[
        list[str] | None,
        Parameter(name="--set", metavar="EFFECT.NAME=VALUE"),
        Help("Setting of an effect; repeat the option for several"),
    ] = None,
    rate: Annotated[Positive, Help("Sample rate of the acceleration channel [Hz]")] = ACCELERATION_RATE_HZ,
    seed: Seed = 0,
    tip_radius: TipRadius = 0.0,
    no_picture: Annotated[bool, Help("Skip the picture scene.png")] = False,
    dark: Dark = False,
    hand: HandOptions = HandOptions(),
    mesh: MeshOptions = MeshOptions(),
) -> None:
    """Simulate a tool that touches a scene or mesh; write forces and vibrations.

    By default, a tool explores the scene from above. --path moves it along a
    recorded path. --hand closes the loop: a simulated hand holds a simulated
    device, which contact forces move. The results are touch.npz and touch.csv
    (every tick), summary.json, plots.png, scene.png and feel.wav (vibration).

    examples:
      hapscene touch demo               # an asset: demo, bracket, plate, toad
      hapscene touch bunny.ply --unit m --swatch wood
      hapscene touch demo.scene.json --path hand.csv --out out/hand
    """
    scene, mesh = find_asset(scene, mesh)
    check_scene(scene, mesh)
    out = out or Path("out", base_name(scene))
    hand.check(path)
    from hapscene.view.offscreen import started_ahead

    with nullcontext() if no_picture else started_ahead():
        of_effects = _parse_settings(settings or ())
        _check_effects(effects or (), of_effects)
        loaded, bridge = _opened(scene, mesh, hand.device)
        render = {"settings": of_effects, "seed": seed, "a_rate_Hz": rate}
        render |= {"tip_radius_m": tip_radius} | ({} if effects is None else {"effects": effects})
        write = {"title": Path(scene).name, "with_picture": not no_picture, "dark": dark, "bridge": bridge}
        if hand.hand is None:
            print_files(_touch_along(loaded, path, out, render | write))
        else:
            print_files(_touch_by_hand(loaded, path, out, hand, render, write))


def _check_effects(effects: Sequence[str], settings: Iterable[str]) -> None:
    """Check the names of effects before a mesh is loaded. Raises EffectError."""
    from hapscene.surface.effect import load_effect

    for name in effects:
        load_effect(name)
    for name in settings:
        if load_effect(name).scope != "scene":
            raise EffectError(f"--set {name}: an effect of contact, which swatches set: write it into the .swatch file")
        if name not in effects:
            raise EffectError(f"--set {name}: --effects does not list it; add it, as in --effects wall,{name}")


def _opened(scene: str, mesh: MeshOptions, device: str) -> "tuple[Scene, MuJoCo | None]":
    """Load a scene and, for a MuJoCo model, its physics."""
    from hapscene.touch import is_model, open_model, step

    if not is_model(scene):
        return load_input(scene, mesh, device), None
    with step(print_progress, loading(scene)):
        bridge = open_model(scene, mesh.unit, mesh.swatch, mesh.two_sided)
    return bridge.scene, bridge


def _touch_along(scene: "Scene", path: Path | None, out: Path, how: dict[str, Any]) -> Sequence[Path]:
    """Render a touch along a path from a file, or along one that explores the scene."""
    from hapscene.motion.hand_path import explore
    from hapscene.motion.path_file import load_path
    from hapscene.touch import step
    from hapscene.touch import touch as run

    if path is not None:
        t_s, p_WT = load_path(path, TICK_S)
        return run(scene, out, p_WT, t_s=t_s, say=print_progress, caution=print_warning, **how)
    with step(print_progress, "no --path: exploring the scene from above"):
        p_WT = explore(_aim(scene, how["bridge"]), TICK_S)
    return run(scene, out, p_WT, say=print_progress, caution=print_warning, **how)


def _touch_by_hand(
    scene: "Scene", path: Path | None, out: Path, hand: HandOptions, render: dict[str, Any], write: dict[str, Any]
) -> Sequence[Path]:
    """Simulate a touch in closed loop."""
    from hapscene.device.model import device_named, limits_of
    from hapscene.device.sim.omni import Omni
    from hapscene.handle import Plant
    from hapscene.loop import ReferenceTrajectory, Twin
    from hapscene.motion.gestures import act
    from hapscene.motion.path_file import load_path
    from hapscene.touch import step, touch_by_hand

    assert hand.hand is not None
    with step(print_progress, f"gesture of the hand: {hand.hand}"):
        if path is None:
            intent = act(hand.hand, _aim(scene, write["bridge"]), TICK_S, grip=hand.grip)
        else:
            intent = ReferenceTrajectory.along(load_path(path, TICK_S)[1], hand.grip)
    device = device_named(hand.device)
    held = Omni() if device.name == "omni" else device.point
    assert held is not None  # checked by HandOptions.check
    render = render | {"limits": limits_of(device, TICK_S, hand.delay)}

    def ready() -> "Twin":
        return Twin(scene, held, delay_ticks=hand.delay, handle=Plant(), compensator=hand.compensator, **render)

    write = write | {"title": f"{write['title']}: {hand.hand}, {hand.grip} grip, {hand.device}"}
    return touch_by_hand(scene, out, intent, ready, say=print_progress, caution=print_warning, **asdict(hand), **write)


def _aim(scene: "Scene", bridge: "MuJoCo | None") -> "Scene":
    """The scene that a hand explores: of a MuJoCo model only the moving bodies, if there are any."""
    if bridge is None or not bridge.names:
        return scene
    moving = copy(scene)
    moving.bodies = [body for body in scene.bodies if body.name in bridge.names]
    return moving
