"""`hapscene touch` and `hapscene demo`."""

import argparse
from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from pathlib import Path
from typing import Any, Final

from hapscene.command.console import caution, name_made, say
from hapscene.command.live import add_page_options, play_on_page
from hapscene.command.options import (
    add_command,
    add_mesh_options,
    add_out_folder,
    base_name,
    check_out_folder,
    check_scene,
    check_there,
    find_asset,
    load_input,
    loading,
    rate,
    reading,
    seed,
    setting,
    whole,
)
from hapscene.constants import ACCELERATION_RATE_HZ, DEFAULT_GRIP, TICK_S
from hapscene.errors import EffectError, HapsceneError, PathError, no_such

HAND_DEFAULTS: Final = {"grip": DEFAULT_GRIP, "device": "omni", "compensator": "adaptive", "delay": 0}
"""Options of a touch in closed loop."""


def add_touch(commands: Any) -> None:
    command = add_command(commands, "touch", _touch)
    command.add_argument(
        "scene",
        metavar="SCENE",
        help="a scene (.scene.json), a file that export wrote, a mesh, or a model of MuJoCo (.xml); or an asset: demo, "
        "bracket, plate, toad",
    )
    command.add_argument(
        "--path", metavar="CSV", help="path of the tool: columns t,x,y,z in s and m; else a hand feels it from above"
    )
    add_out_folder(command, None, "out/NAME, as out/bunny")
    add_mesh_options(command)
    command.add_argument("--effects", metavar="A,B,…", help="effects to sum; `hapscene plugins` lists them")
    command.add_argument(
        "--set", type=setting, action="append", default=[], metavar="EFFECT.NAME=VALUE", dest="settings",
        help="of an effect of the scene: weight.mass_kg=0.2, guide.points_m=[[0,0,0.1]]; may stand several times",
    )  # fmt: skip
    command.add_argument("--seed", type=seed, default=0, help="of what effects draw at random (default 0)")
    command.add_argument(
        "--rate",
        type=rate,
        default=ACCELERATION_RATE_HZ,
        metavar="HZ",
        help=f"of the acceleration channel (default {ACCELERATION_RATE_HZ:g})",
    )
    command.add_argument(
        "--fidelity", metavar="FILE", help="render no more than it needs, by what `hapscene tune` wrote"
    )
    closed = command.add_argument_group(
        "in closed loop", "a hand that holds a simulated device, so that contact forces move the tool"
    )
    closed.add_argument(
        "--hand",
        metavar="GESTURE",
        help="tap, press, stroke, circle, scrub, hesitate, let-go, grip-firmly, explore; or follow, along --path",
    )
    closed.add_argument("--grip", help=f"light, medium or firm (default {DEFAULT_GRIP})")
    closed.add_argument("--device", help="what the hand holds: omni (default), phantom-1.0 or premium-1.5")
    closed.add_argument(
        "--compensator",
        metavar="NAME",
        help="what drives the voice coil in the handle: adaptive (default), flat, inverse, naive, none",
    )
    closed.add_argument("--delay", type=whole("a delay in ticks", 0), metavar="TICKS", help="of the force (default 0)")
    command.add_argument("--no-picture", action="store_true", help="leave scene.png out")
    _add_dark(command)
    command.add_argument("--view", action="store_true", help="then play it in a window, at its own speed")


def _touch(options: argparse.Namespace) -> int:
    """Touch a scene or a mesh along a path, and write what was felt.

    for example:
      hapscene touch demo                  # an asset by name: demo, bracket, plate, toad
      hapscene touch bunny.ply --unit m --swatch wood
      hapscene touch demo.scene.json --path hand.csv --out out/hand
      hapscene touch demo.scene.json --effects wall,weight --set weight.mass_kg=0.2
      hapscene touch demo.scene.json --hand stroke --grip light --device omni --out out/stroke
      hapscene touch table.xml --path push.csv   # a model of MuJoCo, whose bodies are pushed
    """
    options.scene, options.unit = find_asset(options.scene, options.unit)
    check_scene(options.scene, options.unit)
    check_there(options.path, PathError)
    check_there(options.fidelity, prefix="--fidelity ")
    options.out = options.out or f"out/{base_name(options.scene)}"
    check_out_folder(options.out)
    from hapscene.view.offscreen import started_ahead

    with started_ahead(not options.no_picture):
        return _touch_scene(options)


def _touch_scene(options: argparse.Namespace) -> int:
    check_scene(options.scene, options.unit, options.swatch)
    effects = None if options.effects is None else [name for name in options.effects.split(",") if name]
    if effects == []:
        raise EffectError("--effects names none; `hapscene plugins` lists them")
    settings: dict[str, dict[str, Any]] = {}
    for effect, name, value in options.settings:
        settings.setdefault(effect, {})[name] = value
    _check_hand(options)
    if options.view:
        from hapscene.view.window import check_display

        check_display()  # before minutes are spent
    _check_names(options, effects or ())
    _check_settings(settings, effects or ())
    from hapscene.motion.path_file import load_path
    from hapscene.touch import is_model, open_model, step, touch

    t_s, p_WT = (None, None) if options.path is None else load_path(options.path, TICK_S)
    bridge = None
    if is_model(options.scene):
        with step(say, loading(options.scene)):
            bridge = open_model(options.scene, options.unit, options.swatch, options.two_sided)
        scene = bridge.scene
    else:
        words = options.unit, options.swatch, options.two_sided, options.device or "omni"
        scene = load_input(options.scene, *words, **reading(options))
    if options.hand is not None:
        return _touch_by_hand(options, scene, effects, settings, p_WT, bridge)
    if p_WT is None:
        from hapscene.motion.hand_path import explore

        with step(say, "no --path: a hand feels it from above"):
            p_WT = explore(_aimed_at(scene, bridge), TICK_S)
    made = touch(
        scene,
        options.out,
        p_WT,
        t_s=t_s,
        effects=effects,
        settings=settings,
        seed=options.seed,
        a_rate_Hz=options.rate,
        title=Path(options.scene).name,
        with_picture=not options.no_picture,
        dark=options.dark,
        say=say,
        caution=caution,
        bridge=bridge,
        fidelity=options.fidelity,
    )
    name_made(made)
    _show(options, scene)
    return 0


def _show(options: argparse.Namespace, scene: Any) -> None:
    """Play what was felt in a window, if it is asked for, until the window is closed."""
    if not options.view:
        return
    from hapscene.recording import Recording
    from hapscene.view.palette import DARK, LIGHT
    from hapscene.view.window import felt, play_in_window

    out = Path(options.out)
    recording = Recording.load(out / "touch.npz")
    if options.hand is not None:
        recording = felt(recording, out / "hand.npz")
    print("playing it in a window; close the window, or press Ctrl-C, to end", flush=True)
    play_in_window(scene, recording, f"hapscene: {Path(options.scene).name}", theme=DARK if options.dark else LIGHT)


def _check_hand(options: argparse.Namespace) -> None:
    """Options of a hand go with --hand, and a path with the hand that follows it."""
    if options.hand is None:
        for option in HAND_DEFAULTS:
            if getattr(options, option) is not None:
                raise PathError(f"--{option} is for a touch in closed loop; add --hand, as in --hand stroke")
    elif options.hand == "follow" and options.path is None:
        raise PathError("--hand follow needs the path to follow: --path hand.csv")
    elif options.hand != "follow" and options.path is not None:
        raise PathError(f"--hand {options.hand} makes its own path; leave --path out, or say --hand follow")
    for option, value in HAND_DEFAULTS.items():
        if getattr(options, option) is None:
            setattr(options, option, value)


def _check_names(options: argparse.Namespace, effects: Iterable[str]) -> None:
    """Look them up before a mesh is loaded, which may take a while."""
    from hapscene.surface.effect_registry import load_effect

    for name in effects:
        load_effect(name)
    if options.hand is not None:
        from hapscene.device.hand import grip_named
        from hapscene.device.model import device_named
        from hapscene.handle.compensator import find_compensator
        from hapscene.motion.gestures import GESTURES

        if options.hand != "follow" and options.hand not in GESTURES:
            raise PathError(no_such("gesture", options.hand, [*GESTURES, "follow"]))
        grip_named(options.grip)
        find_compensator(options.compensator)
        if device_named(options.device).point is None:
            raise PathError("an ideal device has no mass to move; choose --device omni, phantom-1.0 or premium-1.5")


def _check_settings(settings: Mapping[str, Mapping[str, Any]], effects: Sequence[str]) -> None:
    """Refuse, as early, what can be judged without the scene."""
    from hapscene.surface.effect_registry import load_effect
    from hapscene.surface.field_settings import field_setting

    for name, given in settings.items():
        effect = load_effect(name)
        if name not in effects or effect.scope != "scene":
            raise EffectError(f"--set {name}: give it to an effect of the scene that --effects names")
        field_setting(effect, {key: value for key, value in given.items() if key != "bodies"}, (), ACCELERATION_RATE_HZ)


def _touch_by_hand(options: argparse.Namespace, scene: Any, effects: Any, settings: Any, p_WT: Any, bridge: Any) -> int:
    from hapscene.device.model import device_named, limits_of
    from hapscene.device.omni import Omni
    from hapscene.handle import Plant
    from hapscene.motion.gestures import act
    from hapscene.renderer import EFFECTS
    from hapscene.touch import step, touch_by_hand
    from hapscene.twin import Intent, Twin

    device = device_named(options.device)
    held = Omni() if device.name == "omni" else device.point
    assert held is not None  # as was checked
    with step(say, f"the hand: {options.hand}"):
        intent = (
            act(options.hand, _aimed_at(scene, bridge), TICK_S, grip=options.grip)
            if p_WT is None
            else Intent.along(p_WT, options.grip)
        )

    def ready() -> Twin:
        return Twin(
            scene,
            held,
            effects=effects or EFFECTS,
            settings=settings,
            seed=options.seed,
            a_rate_Hz=options.rate,
            limits=limits_of(device, TICK_S, options.delay),
            delay_ticks=options.delay,
            handle=Plant(),
            compensator=options.compensator,
            fidelity=options.fidelity,
        )

    made = touch_by_hand(
        scene,
        options.out,
        intent,
        ready,
        title=f"{Path(options.scene).name}: {options.hand}, {options.grip} grip, {options.device}",
        with_picture=not options.no_picture,
        dark=options.dark,
        say=say,
        caution=caution,
        bridge=bridge,
        **{option: getattr(options, option) for option in ("hand", *HAND_DEFAULTS)},
    )
    name_made(made)
    _show(options, scene)
    return 0


def _aimed_at(scene: Any, bridge: Any) -> Any:
    """What a hand goes for: of a model the bodies that move, if any do."""
    if bridge is None or not bridge.names:
        return scene
    moving = copy(scene)
    moving.bodies = [body for body in scene.bodies if body.name in bridge.names]
    return moving


def add_demo(commands: Any) -> None:
    command = add_command(commands, "demo", _demo)
    add_out_folder(command, "out/demo")
    _add_dark(command)
    live = command.add_argument_group("live", "on a page in the browser, with mouse, pen or fingers")
    live.add_argument("--live", action="store_true", help="touch it yourself; nothing is written")
    add_page_options(live)


def _add_dark(command: argparse.ArgumentParser) -> None:
    command.add_argument("--dark", action="store_true", help="pictures, and the window, on dark ground")


def _demo(options: argparse.Namespace) -> int:
    """Touch the shipped scene: three bodies, four real surfaces, a hand that taps, presses and strokes.

    for example:
      hapscene demo
      hapscene demo --live                 # with the mouse, or with what the screen takes
      hapscene demo --live --kiosk --host 0.0.0.0   # for visitors, also on their phones
    """
    from hapscene.view.offscreen import started_ahead

    if options.kiosk and not options.live:
        raise HapsceneError("--kiosk is for the page; say --live as well")
    with started_ahead(not options.live):
        return _touch_demo(options)


def _touch_demo(options: argparse.Namespace) -> int:
    from hapscene import assets
    from hapscene.motion.hand_path import explore
    from hapscene.touch import open_scene, step, touch

    with step(say, "loading the demo scene"):
        scene = open_scene(assets.path("demo"))
    if options.live:
        play_on_page(scene, "demo", options)
        return 0
    path = explore(scene, TICK_S)
    name_made(touch(scene, options.out, path, title="demo.scene.json", dark=options.dark, say=say, caution=caution))
    return 0
