"""Compile all features in advance, by using each once with a small scene, so that the first use is not delayed."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, Final

import numpy as np
import trimesh

from hapscene.clock import VIRTUAL, new_clock
from hapscene.compiled.native import compiling
from hapscene.constants import ACCELERATION_RATE_HZ
from hapscene.contact.ball import move_ball
from hapscene.contact.moving import place_bodies
from hapscene.contact.proxy import place_proxy
from hapscene.device.driver_registry import DeviceChoice
from hapscene.device.model import IDEAL
from hapscene.device.sim.omni import Omni
from hapscene.device.sim.point import PointMass
from hapscene.device.stabilisers import control_passivity, couple
from hapscene.loop import ReferenceTrajectory, Twin
from hapscene.loop.driver import drive
from hapscene.render.describe import shade
from hapscene.render.renderer import EFFECTS, Renderer
from hapscene.render.tick import run_ticks, tick
from hapscene.scene.region import Sphere
from hapscene.scene.scene import Scene
from hapscene.surface.effect import load_effect
from hapscene.surface.mixer import render_fields
from hapscene.surface.swatch import Swatch
from hapscene.teleoperation.operation import operate

__all__ = ["warm_up"]

SWATCH: Final = "wood"
ABOVE_M: Final = (0.0, 0.0, 0.06)
"""A position above the box [m], whose top is at 0.05 m."""

SKIN: Final = Swatch("skin", effects={"puncture": {"puncture_force_N": 1.0}})

ALL_EFFECTS: Final = (*EFFECTS, "puncture", "guide", "magnet", "viscosity", "weight")
_SETTINGS: Final = {"guide": {"points_m": [[0.0, 0.0, 1.0]]}, "magnet": {"points_m": [[0.0, 0.0, 1.0]]}}

_FIRST: Final = (tick, run_ticks, place_proxy)
_CONTACT: Final = (place_bodies, move_ball, couple, control_passivity, shade, render_fields)
_LATER: Final = (*_CONTACT, drive, operate)
"""Large functions, declared in advance so that the progress line shows their total number."""


def warm_up() -> None:
    """Compile all features that are not cached yet.

    Raises:
        HapsceneError: a feature does not compile or cannot be set up, such as shared memory for the servo.
    """
    effects = [load_effect(name).render for name in ALL_EFFECTS]
    with compiling(*_FIRST, *effects, *_LATER):
        _touch(_scene())
        _touch_with_everything(_scene())
        _close_the_loop(_scene())
        _serve(_scene())
        _teleoperate()
        _play_on_handle()
        _paint(_scene())


def _scene() -> Scene:
    scene = Scene()
    for name, x_m in (("box", 0.0), ("other", 0.2)):
        pose = np.eye(4)
        pose[0, 3] = x_m
        scene.add(trimesh.creation.box((0.1, 0.1, 0.1)), name=name, unit="m", swatch=SWATCH, pose=pose)
    return scene


def _touch(scene: Scene) -> None:
    renderer = Renderer(scene)
    renderer.step(ABOVE_M)
    renderer.run(np.tile(ABOVE_M, (2, 1)))


def _touch_with_everything(scene: Scene) -> None:
    """All effects, coupling, passivity controller, creases, moving, deformed and removed bodies, and a tip radius."""
    scene.add(scene.body("other").mesh, name="skin", swatch=SKIN)
    limits = replace(IDEAL, coupling_N_m=1000.0, passivity_Ns_m=1.0)
    renderer = Renderer(scene, ALL_EFFECTS, limits=limits, crease_rad=0.5, settings=_SETTINGS)
    renderer.step(ABOVE_M, {"other": scene.body("other").X_WB})
    renderer.deform("box", scene.body("box").mesh.vertices_m)
    renderer.remove("other")
    renderer.step(ABOVE_M)
    Renderer(scene, tip_radius_m=0.001).step(ABOVE_M)


def _close_the_loop(scene: Scene) -> None:
    from hapscene.handle import Plant

    for device, handle in ((PointMass(0.045, 0.1, 0.26, 5.5e-5), None), (Omni(), Plant())):
        Twin(scene, device, handle=handle).run(ReferenceTrajectory.hold(ABOVE_M, 2))


def _serve(scene: Scene) -> None:
    """The loops of a servo's process, for simulated devices and for those that Python or a vendor's library drives."""
    from hapscene.device.safety import resume_safety, simulated_safety
    from hapscene.loop.heartbeat import _beat
    from hapscene.loop.servo_process import OrderHandler
    from hapscene.loop.shared_memory import open_channel

    clock = new_clock()
    _beat(np.zeros(1, np.int64), np.zeros(1, np.int64), np.ones(1, np.int64), clock, 0)  # returns at once
    virtual = new_clock()
    virtual[VIRTUAL] = 1  # a virtual clock: ticks run only on request
    mass = PointMass(0.045, 0.1, 0.26, 5.5e-5)
    for devices in ((mass,), (mass, mass), (DeviceChoice("simulated").open(),)):
        twins = [Twin(scene, device) for device in devices]
        for twin in twins:
            twin.safety = simulated_safety()
        channel = open_channel(16, twins[0].renderer.block, bodies=len(scene.bodies), tools=len(twins))
        try:
            handler = OrderHandler(scene, twins, channel, clock=virtual)
            handler.start([ABOVE_M] * len(twins), np.zeros(3))
            handler.pause()
            resume_safety(twin.tool.safety[0])
            handler.end()
        finally:
            del twin, twins, handler  # they look at the memory that is given back
            channel.close(unlink=True)


def _teleoperate() -> None:
    from hapscene.teleoperation.operation import Operation
    from hapscene.teleoperation.plate import START_M, plate

    Operation(plate(SWATCH), START_M).run(ReferenceTrajectory.hold(START_M, 2))


def _play_on_handle() -> None:
    """Playback of a recording and a live stream, a simulated handle for identification, and texture synthesis."""
    from hapscene.capture.fit.synthesis import synthesize
    from hapscene.handle import Plant
    from hapscene.handle.force_source import SimulatedSource
    from hapscene.handle.handle_loop import play
    from hapscene.handle.live_stream import LiveStream

    play(np.zeros(100), ACCELERATION_RATE_HZ)
    SimulatedSource(Plant()).play(np.zeros(100))
    output: Any = SimpleNamespace(rate_Hz=48_000.0, gain=1.0, ceiling=1.0, highpass_Hz=0.0, lag_s=0.005)
    LiveStream(np.zeros, ACCELERATION_RATE_HZ, output, steered=True)
    synthesize(SWATCH, np.ones(100), np.full(100, 0.1))


def _paint(scene: Scene) -> None:
    from hapscene.paint.model.display import Display
    from hapscene.paint.model.painting import Painting
    from hapscene.paint.model.regions import Outline

    scene.add(trimesh.creation.icosphere(3, 0.05), name="ball", unit="m")
    scene.paint("box", "leather", Sphere((0.0, 0.0, 0.05), 0.02), falloff_m=0.01, resolution_m=0.005)
    painting = Painting(scene)
    painting.pick(ABOVE_M, (0.0, 0.0, -1.0))
    painting.begin_step("warm up", SWATCH)
    corners = np.array([[-0.1, -0.1], [0.1, -0.1], [0.0, 0.1]])
    painting.paint_region(0, Outline(np.eye(4), corners), eye_W_m=(0.0, 0.0, 0.5))
    painting.end_step()
    Display(painting, shown_max=400)
