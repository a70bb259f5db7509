"""The renderer: computes the force and acceleration of each haptic tick for a scene and a device position."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import zip_longest
from threading import Lock
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.compiled.entry import call_entry
from hapscene.compiled.native import Native, compiling
from hapscene.constants import ACCELERATION_RATE_HZ, REACH_MAX_M, TICK_S
from hapscene.contact.deformation import Deformation, room_for, shape_of
from hapscene.contact.moving import place_bodies
from hapscene.contact.proxy import place_proxy
from hapscene.contact.world import Extension, World, build_world
from hapscene.device.model import IDEAL, DeviceLike, DeviceWarning, Limits, limits_of
from hapscene.errors import EffectError, HapsceneError, PathError, SceneError, UsageWarning, no_such, warn
from hapscene.flags import Flag, flag_of
from hapscene.geometry import numbers, positions, rigid
from hapscene.records import ROW, Records, block_of, records
from hapscene.render.contact_info import Contact, Impulse
from hapscene.render.moving_bodies import MovingBodies
from hapscene.render.tick import run_ticks, tick, use_fading, use_moving_bodies, use_tick
from hapscene.surface.device_clipping import Clip, ClippedSwatches, Numbers, clip_to_device, clips, share_of
from hapscene.surface.effect import Effect, FieldSetting, check_range, field_setting, load_effect
from hapscene.surface.surface_arrays import SWITCHED_OFF, Surface, build_surface, clear_states, put_numbers
from hapscene.surface.swatch import tip_radius_of

if TYPE_CHECKING:
    from hapscene.render.recording import Recording
    from hapscene.scene.body import Body
    from hapscene.scene.scene import Scene

__all__ = ["EFFECTS", "OTHER_BODIES", "Command", "Renderer", "warn_of_far"]

EFFECTS: Final = ("wall", "friction", "lpc_texture", "tap", "adhesion")
"""Default effects of a renderer."""

OTHER_BODIES: Final = (
    "the bodies differ from those that the renderer was made with: repaint the same bodies, or make a new renderer"
)

_POSE_REFUSED: Final = int(Flag.POSE_REFUSED)
_TOOL_FAR: Final = int(Flag.TOOL_FAR)
_REPORTED: Final = _POSE_REFUSED | _TOOL_FAR

TIP_RADIUS_MAX_M: Final = 1.0
"""Largest radius of a tip [m]; a larger number is usually in a wrong unit."""

TIP_TOLERANCE: Final = 0.1
"""Largest difference to the tip with which a swatch was recorded that is not reported [1]."""

POSE_SLOTS_MAX: Final = 64
"""Most combinations of names in `step(p, {name: X_WB})` that are remembered [count]."""

_NO_BODIES: Final = (np.zeros(0, np.int64), np.zeros((1, 0, 4, 4)), np.zeros(0, np.int64))
"""Indices, poses and teleports for a tick without moving bodies."""


class Command(NamedTuple):
    """Output of one haptic tick.

    Attributes:
        f_W_N: (3,) force on the hand in W [N].
        a_m_s2: (block,) acceleration samples along the handle [m/s²].
        flags: errors and limits that were reached.
        contact: contact of this tick; None without contact.
    """

    f_W_N: NDArray[np.float64]
    a_m_s2: NDArray[np.float64]
    flags: Flag
    contact: Contact | None = None

    def __repr__(self) -> str:
        force = ", ".join(f"{v:.3g}" for v in self.f_W_N)
        return (
            f"<Command: force ({force}) N; {len(self.a_m_s2)} samples of acceleration; {self.flags.name or 'no flag'}>"
        )


class PreparedPainting(NamedTuple):
    """Swatches and painted faces of a scene, compiled for `Renderer.apply_painting`."""

    surface: Surface
    fit: ClippedSwatches
    swatch_names: tuple[str, ...]
    extension: Extension | None  # of the world by new bodies, if there are any
    bodies: "tuple[Body, ...]"
    scene: "Scene"


class Renderer:
    """Renders touch. `run` computes a recorded path, `step` one tick of a loop of your own; both give the same bits.

    Args:
        scene: the scene. Its swatches are read once, here. After `Scene.pose`, a body appears at its new pose.
        effects: names of effect plugins, or `Effect` objects, in the order in which they are summed. Effects of the
            scene come after effects of contact.
        settings: settings of the effects of the scene, by name: `{"weight": {"mass_kg": 0.2}}`. They can hold
            parameters, arrays that the effect declares, and `bodies` whose poses the effect reads.
        seed: seed of all random numbers of effects; the same seed gives the same bits.
        tick_s: period of the haptic tick [s].
        a_rate_Hz: sample rate of the acceleration channel; a tick must hold an integer number of samples, at most 256.
        limits: limits of the device; None for an ideal device.
        device: name from `hapscene.device.DEVICES`, or a device, whose limits at this period apply. Replaces `limits`.
        crease_rad: edges at which the surface turns by less than this angle are smoothed (force shading, see
            `hapscene.contact.shading`; it generates energy). 0 disables shading.
        tip_radius_m: radius of the tip of the tool [m]. With 0 the tool is a point; otherwise it is a ball, device
            position and proxy are its centre, and both sides of all faces are solid (see `hapscene.contact.ball`).

    Attributes:
        tick_s, a_rate_Hz, seed, tip_radius_m: see the arguments.
        limits: limits of the device.
        block: number of acceleration samples in a tick.
        world, surface: arrays that the compiled tick reads and writes, for code that runs the tick itself.

    Raises:
        SceneError: the scene has no bodies.
        EffectError: an effect is unknown or does not compile.
        HapsceneError: the rates are not multiples, the device is unknown, or both `device` and `limits` are given.

    Warns:
        DeviceWarning: a swatch exceeds the limits of the device, or was recorded with another tip. One warning reports
            the first painted swatch.
    """

    def __init__(
        self,
        scene: "Scene",
        effects: Sequence[str | Effect] = EFFECTS,
        *,
        seed: int = 0,
        tick_s: float = TICK_S,
        a_rate_Hz: float = ACCELERATION_RATE_HZ,
        limits: Limits | None = None,
        device: "DeviceLike | None" = None,
        crease_rad: float = 0.0,
        settings: Mapping[str, Mapping[str, object]] | None = None,
        tip_radius_m: float = 0.0,
    ) -> None:
        if not scene.bodies:
            raise SceneError("the scene has no bodies: add one with scene.add(mesh, name=…)")
        self.tick_s = float(tick_s)
        self.a_rate_Hz = float(a_rate_Hz)
        self.block = block_of(self.tick_s, self.a_rate_Hz)
        self.seed = seed
        if device is not None and limits is not None:
            raise HapsceneError(f"both limits and device {device!r} are given: give one, since a device has limits")
        _check_arguments(effects, seed, crease_rad, tip_radius_m)
        self.tip_radius_m = float(tip_radius_m)
        self.limits = limits_of(device, self.tick_s) if device is not None else limits or IDEAL
        loaded = [load_effect(e) if isinstance(e, str) else e for e in effects]
        self._contact_effects = [e for e in loaded if e.scope == "contact"]
        self._effects = self._contact_effects + [e for e in loaded if e.scope == "scene"]
        self._body_names = tuple(body.name for body in scene.bodies)
        self._index_of = {name: index for index, name in enumerate(self._body_names)}  # removed bodies are not in it
        self._swatch_names = tuple(swatch.name for swatch in scene.swatches)
        self._bodies = tuple(scene.bodies)
        self._fields = self._read_field_settings(settings or {})
        self._pose_slots: dict[tuple[str, ...], MovingBodies] = {}
        self._last_slots: MovingBodies | None = None
        self._scene, self._seen, self._seen_X_WB = scene, scene.pose_count, [body.X_WB for body in scene.bodies]
        self._crease_rad = crease_rad
        self._deformations: dict[int, Deformation] = {}
        self._deforming = Lock()  # held by threads that set shapes; no tick acquires it
        self._row = records(1, ROW)
        self._samples = np.zeros((1, self.block))
        self._p_WT = np.zeros((1, 3))
        self._compile(scene)
        self._row_bytes = self._row.view(np.ndarray).view(np.uint8)
        row = self._row.view(np.ndarray)
        # views, because a look-up by name takes a microsecond
        self._out = row["f_W_N"][0], row["flags"], row["touching"]
        self._started = self._first = False
        self._ticks = 0

    def _compile(self, scene: "Scene") -> None:
        """Build the arrays of the tick and compile it; warn of what the device does not allow."""
        with compiling(tick, run_ticks, place_proxy, *(effect.render for effect in self._effects)):
            self.world = build_world(scene.bodies, self._crease_rad, self.tip_radius_m)
            self._fit, self.surface, messages = self._build_surface(scene)
            use_tick(self.world, self.surface, self._row, self._samples)
            self._play = _compile_run(self.world, self.surface, self._row, self._samples)
        _warn(messages + [str(clip) for clip in self._field_clips() if clip.reported])

    def __repr__(self) -> str:
        names = ", ".join(effect.name for effect in self._effects) or "no effects"
        count = len(self._index_of)
        return (
            f"<Renderer: {count} {'body' if count == 1 else 'bodies'}; {names}; ticks of {1e3 * self.tick_s:g} ms, "
            f"a_rate_Hz={self.a_rate_Hz:g}; device {self.limits.device!r}>"
        )

    def reset(self, p_WT: ArrayLike) -> None:
        """Restart with the device and the proxy at `p_WT` (3,) [m], without contact.

        States of effects are cleared, and random numbers start from the seed again. Bodies keep their poses.

        Raises:
            PathError: `p_WT` is not three finite numbers.

        Warns:
            UsageWarning: all bodies are far away. The first tick warns if the tool is inside a body that can be touched
                from outside only.
        """
        p = positions(numbers(p_WT).reshape(1, -1))[0]
        surface = self.surface
        clear_states(surface, self._effects, self.seed)
        memory, touch = surface.memory, surface.touch
        for record, stays in ((touch, ("tick_s", "rate_Hz", "block", "R_WT")), (memory, ("smoothing",))):
            keep = {name: record[name].copy() for name in stays}
            record.view(np.uint8)[:] = 0
            for name, value in keep.items():
                record[name] = value
        touch["body"] = touch["face"] = touch["swatch"] = touch["other"] = touch["left_body"] = -1
        touch["nhat_W"] = (0.0, 0.0, 1.0)
        memory["p_WT_m"] = memory["tool_W_m"] = p
        memory["fresh"] = 1
        bodies = self.world.bodies
        bodies["moved"] = bodies["punctured"] = 0
        bodies["last_R_WB"], bodies["last_p_WB_m"] = bodies["R_WB"], bodies["p_WB_m"]
        self.world.moved[0] = self.world.proxy[0].puncture_count = 0
        self.world.impulse[:] = 0.0
        place_proxy(self.world, (p[0], p[1], p[2]))
        self._far_warned = False
        self._warn_of_far(self.world.proxy.near_flags, p[None])
        self._started = self._first = True
        self._ticks = 0

    def _warn_of_far(self, flags: NDArray[np.int64], p_WT: NDArray[np.float64]) -> None:
        """Warn once after a reset if ticks with `flags` (n,) at `p_WT` (n, 3) were far from all bodies."""
        far = flags & _TOOL_FAR != 0
        if far.any() and not self._far_warned:
            self._far_warned = True
            warn_of_far(p_WT[far.argmax()])

    def warn_if_inside(self) -> None:
        """Warn if the tool started inside a body; loops call this after the first tick, which sets poses of bodies."""
        if not self._first:
            return
        self._first = False
        if inside := int(self.world.proxy[0].enclosing):
            what = "cannot leave it, since both sides of its faces are solid for a tip with a radius: start outside"
            if self.tip_radius_m == 0.0:
                what = (
                    "has no contact with it before it has been outside: start outside, or add the body with "
                    "two_sided=True"
                )
            warn(f"the tool starts inside body {self._body_names[inside - 1]!r}, and {what}", UsageWarning)

    def tune(self, swatch: str, **numbers: float) -> None:
        """Change parameters of a swatch from the next tick on, for example `tune("oak", stiffness_N_m=300.0)`.

        Args:
            swatch: name of the swatch.
            numbers: `stiffness_N_m`, and parameters of effects by name.

        Raises:
            SceneError: the scene has no such swatch.
            EffectError: no effect has such a parameter, or the value is out of range.
        """
        if swatch not in self._swatch_names:
            raise SceneError(no_such("swatch", swatch, self._swatch_names))
        index = self._swatch_names.index(swatch)
        self._fit.tune(index, numbers)
        put_numbers(self.surface, self._effects, index, self._fit.given[index])
        _warn([str(clip) for clip in self._fit.clips(index) if clip.reported and clip.number in numbers])

    def tune_field(self, effect: str, **numbers: float) -> None:
        """Change parameters of an effect of the scene from the next tick on: `tune_field("weight", mass_kg=0.3)`.

        Raises:
            EffectError: the effect or parameter does not exist, or the value is out of range.
        """
        first = len(self._contact_effects)
        names = [e.name for e in self._effects[first:]]
        if effect not in names:
            raise EffectError(self._no_field(effect))
        k = names.index(effect)
        params = {param.name: param for param in self._effects[first + k].params}
        if unknown := sorted(numbers.keys() - params.keys()):
            raise EffectError(no_such("parameter", unknown[0], params))
        checked = {name: check_range(self._effects[first + k], params[name], v) for name, v in numbers.items()}
        self._fields[k].numbers.update(checked)
        taken, clipped = self._clipped_field(k)
        put_numbers(self.surface, self._effects, len(self._swatch_names), taken)
        _warn([str(clip) for clip in clipped if clip.reported and clip.number in numbers])

    def mute(self, effect: str, muted: bool = True) -> None:
        """Exclude an effect from the sum from the next tick on, or include it again. A reset does not change this.

        Raises:
            EffectError: the renderer has no such effect.
        """
        names = [one.name for one in self._effects]
        if effect not in names:
            raise EffectError(no_such("effect", effect, names))
        self.surface.muted[names.index(effect)] = SWITCHED_OFF if muted else 0

    def _read_field_settings(self, settings: Mapping[str, Mapping[str, object]]) -> list[FieldSetting]:
        """Return the checked settings of the effects of the scene, one for each effect."""
        of_scene = self._effects[len(self._contact_effects) :]
        names = [effect.name for effect in of_scene]
        for name in names:
            if names.count(name) > 1:
                raise EffectError(f"effect {name!r} of the scene is listed twice; list it once")
        if not isinstance(settings, Mapping):
            raise EffectError(
                f"settings must map effects to settings, as {{'weight': {{'mass_kg': 0.2}}}}, not {settings!r:.40}"
            )
        for name in settings:
            if name not in names:
                raise EffectError(self._no_field(name))
        return [field_setting(e, settings.get(e.name, {}), self._body_names, self.a_rate_Hz) for e in of_scene]

    def _no_field(self, name: str) -> str:
        """Return the message about an effect that is not one of the scene."""
        if name in (effect.name for effect in self._contact_effects):
            return (
                f"effect {name!r} acts at contacts and is set by swatches: use "
                f"Swatch(…, effects={{{name!r}: {{…}}}}), or Renderer.tune"
            )
        names = [effect.name for effect in self._effects[len(self._contact_effects) :]]
        if not names:
            return f"no effect of the scene {name!r} is in use; add it to the effects of the renderer"
        return no_such("effect of the scene", name, names)

    def _clipped_field(self, k: int) -> tuple[Numbers, list[Clip]]:
        """Return the parameters of effect `k` of the scene within the limits of the device, and which were clipped."""
        e = len(self._contact_effects) + k
        asked = {(e, name): value for name, value in self._fields[k].numbers.items()}
        taken = clip_to_device(self.limits, self._effects, asked)
        return taken, clips(self._effects[e].name, asked, taken, self.limits, self.tick_s, "effect")

    @property
    def clips(self) -> tuple[Clip, ...]:
        """Parameters of swatches and of effects of the scene that exceed the limits of the device at present."""
        of_swatches = [clip for index in range(len(self._swatch_names)) for clip in self._fit.clips(index)]
        return tuple(of_swatches + self._field_clips())

    def _field_clips(self) -> list[Clip]:
        """Return the parameters of effects of the scene that exceed the limits of the device."""
        return [clip for k in range(len(self._fields)) for clip in self._clipped_field(k)[1]]

    def _build_surface(self, scene: "Scene") -> tuple[ClippedSwatches, Surface, list[str]]:
        """Return the clipped swatches of a scene, their arrays, and warnings about those that are painted."""
        fit = ClippedSwatches(scene, self._contact_effects, self.limits, self.tick_s)
        surface = build_surface(scene, self._effects, self.tick_s, self.a_rate_Hz, self.limits, self._fields)
        for k in range(len(self._fields)):
            put_numbers(surface, self._effects, len(scene.swatches), self._clipped_field(k)[0])
        from hapscene.scene.fine_paint import swatches_of

        painted = {k for body in scene.bodies for k in swatches_of(body).tolist()}
        messages: list[str] = []
        for index, swatch in enumerate(scene.swatches):
            put_numbers(surface, self._effects, index, fit.given[index])
            found = [str(clip) for clip in fit.clips(index) if clip.reported]
            for effect in self._contact_effects:
                known = [param.name for param in effect.params]
                # update_ticks is no parameter of the tick: the table of lpc_texture has it
                for name in sorted({*swatch.effects.get(effect.name, ())} - {*known, "update_ticks"}):
                    wrong = no_such("parameter", name, known)
                    found.append(f"swatch {swatch.name!r}: effect {effect.name!r} has {wrong}")
            if swatch.texture is not None:
                fold_kg, own_Ns_m = self.limits.fold_mass_kg, self.limits.own_damping_Ns_m
                share = share_of(swatch.texture, fold_kg, own_Ns_m, self.tick_s)
                surface.fold_mass_kg[index] = fold_kg * share.share
                if share.share < 1.0:
                    found.append(share.message(swatch.name, self.limits.device))
            known_m = tip_radius_of(swatch) if self.tip_radius_m > 0.0 else None
            if known_m is not None and abs(self.tip_radius_m / known_m - 1.0) > TIP_TOLERANCE:
                found.append(
                    f"swatch {swatch.name!r} was recorded with a tip of {1e3 * known_m:g} mm radius; the tool has one "
                    f"of {1e3 * self.tip_radius_m:g} mm, and texture depends on it: set tip_radius_m={known_m:g}"
                )
            messages += found if index in painted else []
        return fit, surface, messages

    def repaint(self, scene: "Scene") -> None:
        """Change the swatches and painted faces of the same bodies. Contact continues.

        Bodies that the scene lists after those of the renderer are added. From then on the renderer follows
        `Scene.pose` of the new scene.

        Raises:
            SceneError: the bodies differ from those of the renderer, or a new body is too large or too small.
            EffectError: an effect rejects a swatch. Nothing is changed.
        """
        self.apply_painting(self.prepare_painting(scene))

    def prepare_painting(self, scene: "Scene") -> PreparedPainting:
        """Do the slow part of `repaint`. Ticks may run in another thread meanwhile."""
        known = len(self._bodies)
        for ours, theirs in zip_longest(self._bodies, scene.bodies[:known]):
            if theirs is None or (ours.name, len(ours.mesh.faces)) != (theirs.name, len(theirs.mesh.faces)):
                raise SceneError(OTHER_BODIES)
        more = tuple(scene.bodies[known:])
        fit, surface, _ = self._build_surface(scene)
        extension = Extension(self.world, self._bodies, more, self._crease_rad) if more else None
        names = tuple(swatch.name for swatch in scene.swatches)
        return PreparedPainting(surface, fit, names, extension, more, scene)

    def apply_painting(self, painting: PreparedPainting) -> None:
        """Do the fast part of `repaint`, between two ticks."""
        surface, old = painting.surface, self.surface
        for name in ("touch", "memory", "states", "muted"):
            getattr(surface, name)[:] = getattr(old, name)
        surface.touch["swatch"] = surface.touch["other"] = -1  # the swatch changed, or has a new index
        surface.entries[:] = old.entries
        self.surface, self._fit = surface, painting.fit
        self._swatch_names = painting.swatch_names
        if painting.extension is not None:
            with self._deforming:
                self.world = painting.extension.apply(self.world)
            self._bodies += painting.bodies
            for body in painting.bodies:
                self._index_of[body.name] = len(self._body_names)
                self._body_names += (body.name,)
            self._scene, self._seen = painting.scene, painting.scene.pose_count
            self._seen_X_WB = [body.X_WB for body in painting.scene.bodies]

    def remove(self, body: str) -> None:
        """Remove a body from contact; the force of a touched body fades out in 5 ms (`Flag.BODY_REMOVED`).

        Its index and memory stay reserved, and the scene keeps it.

        Raises:
            SceneError: the renderer has no such body.
        """
        index = self._index(body)
        row, proxy = self.world.bodies[index], self.world.proxy[0]
        touched = row.punctured != 0 or (proxy.touching == 1 and index in proxy.body[: proxy.count])
        pulls = self.surface.touch[0].left_body == index and self.surface.memory["f_body_W_N"].any()
        use_fading(self.surface, bool(touched or pulls))
        row.radius_m, row.shape_posted = -REACH_MAX_M, row.shape_used  # never near the device
        slots = self.moving_bodies([body])
        slots.teleported[:] = 1
        self._place(slots)
        proxy.near_margin_m = 0.0  # forces a new list of nearby bodies
        del self._index_of[body]
        self._pose_slots.clear()  # they may contain the body
        self._last_slots = None

    def deform(self, body: str, vertices_m: ArrayLike) -> None:
        """Set a new shape of a body from the next tick on, for example 60 times a second. Contact continues.

        At the contact point the surface moves linearly from shape to shape. This method may run in another thread than
        `step`, which never waits for it. The first call builds the search structures and allocates three times the
        memory of the body and once that of all corners (72 bytes per face). The scene does not change.

        Args:
            body: name of the body.
            vertices_m: (N, 3) positions of the vertices of its mesh in the frame of the body; the faces stay the same.

        Raises:
            PathError: `vertices_m` is not numeric.
            SceneError: the body is unknown, the number of vertices differs from the mesh, or a vertex is not finite.

        Warns:
            UsageWarning: the body oscillates: eight shapes in a row took back most of the change before.
        """
        index = self._index(body)
        use_moving_bodies(self.world, self.surface)
        mesh = self._bodies[index].mesh
        vertices = shape_of(vertices_m, len(mesh.vertices_m), body)
        with self._deforming:
            if index not in self._deformations:
                self.world, first = room_for(self.world, mesh, index)
                made = Deformation(self.world, index, body, mesh, first=first, crease_rad=self._crease_rad)
                self._deformations[index] = made
            self._deformations[index].post(self.world, vertices)

    def moving_bodies(self, names: Sequence[str]) -> MovingBodies:
        """Select bodies whose poses you write in place. Faster than a mapping of poses in `step`.

        Raises:
            SceneError: a body is unknown or listed twice.
        """
        if isinstance(names, str) or not isinstance(names, Iterable):
            raise SceneError(f"bodies must be a list of names, as ['crate'], not {names!r:.40}")
        use_moving_bodies(self.world, self.surface)
        self._apply_scene_poses()
        bodies = self.world.bodies
        X_WB = np.tile(np.eye(4), (len(bodies), 1, 1))
        X_WB[:, :3, :3], X_WB[:, :3, 3] = bodies["R_WB"], bodies["p_WB_m"] - bodies["shift_W_m"]
        return MovingBodies(names, self._index_of, X_WB, self.world.proxy)

    def step(self, p_WT: ArrayLike, poses: Mapping[str, ArrayLike] | MovingBodies | None = None) -> Command:
        """Compute one tick with the device at `p_WT` (3,) [m].

        The first step starts the renderer at that position. A position or pose that is not finite sets
        `Flag.TOOL_NOT_FINITE`. A pose of a body that is not finite or not rigid sets `Flag.POSE_REFUSED`, and the body
        stays at the last valid pose. Rounding errors of rotations are corrected.

        Args:
            p_WT: (3,) device position [m]; or (4, 4) pose of the tool, whose orientation effects read as `touch.R_WT`
                until the next pose.
            poses: poses of the bodies that move, {body: X_WB (4, 4)} or the result of `moving_bodies`, which is two to
                three times as fast with many bodies.

        Returns:
            Command, whose arrays are copies.

        Raises:
            PathError: neither a position nor a pose.
            SceneError: a body is unknown, a pose is not (4, 4), that of the tool is not rigid, or `poses` belongs to
                another renderer.

        Warns:
            UsageWarning: a pose was refused; once for the same bodies. The tool is far from all bodies
                (`Flag.TOOL_FAR`); once after each reset.
        """
        p = self._p_WT
        try:  # a general conversion takes longer than the tick
            if len(p_WT) != 3:  # type: ignore[arg-type]  # a number raises TypeError
                raise ValueError
            p[0] = p_WT
        except (TypeError, ValueError, OverflowError):
            p[0] = self._read_position(numbers(p_WT))
        if not self._started:
            if not np.isfinite(p).all():
                return Command(np.zeros(3), np.zeros(self.block), Flag.TOOL_NOT_FINITE)
            self.reset(p[0])
        if self._scene.pose_count != self._seen:
            self._apply_scene_poses()
        slots = _NO_BODIES
        if poses:
            if not isinstance(poses, MovingBodies | Mapping):
                raise SceneError(
                    "poses must be {body: X_WB (4, 4)} or the result of `moving_bodies`, not " + type(poses).__name__
                )
            bodies = poses if isinstance(poses, MovingBodies) else self._slots(poses)
            if bodies.owner is not self.world.proxy:  # the array that stays the same when bodies are added
                raise SceneError("poses belong to another renderer: call `moving_bodies` of this one")
            slots = bodies.index, bodies.poses, bodies.teleported
        self._play(self.world, self.surface, p, *slots, self._row, self._samples)
        self._ticks += 1
        self.warn_if_inside()
        f_W_N, flags, touching = self._out
        if flags.item() & _REPORTED:
            self._warn_of_far(flags, p)
            if flags.item() & _POSE_REFUSED and poses:
                bodies.warn_of_refused()
        contact = None
        if touching.item():
            contact = Contact(self._row_bytes.tobytes(), self._body_names, self._swatch_names)
        return Command._make((f_W_N.copy(), self._samples[0].copy(), flag_of(flags.item()), contact))

    def _read_position(self, given: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the position (3,) from a position, or from a pose (4, 4), which sets the orientation of the tool."""
        if given.shape == (4, 4):
            return self._orient(given)
        if given.size == 3:
            return given.ravel()
        what = f"expected a position of three numbers [m] or a pose (4, 4); it has {given.size} numbers"
        raise PathError(what) from None

    def _orient(self, X_WT: NDArray[np.float64]) -> NDArray[np.float64]:
        """Set the orientation of the tool from its pose (4, 4); return its position, NaN if the pose is not finite."""
        if not np.isfinite(X_WT).all():
            return np.full(3, np.nan)
        X_WT = rigid(X_WT, "pose of the tool")
        self.surface.touch["R_WT"] = X_WT[:3, :3]
        return X_WT[:3, 3]

    def impulse(self, body: str) -> Impulse:
        """Return the impulse of the tool on a body since the last reset.

        Raises:
            SceneError: the renderer has no such body.
        """
        total = self.world.impulse[self._index(body)]
        return Impulse(total[:3].copy(), total[3:].copy())

    def _index(self, body: str) -> int:
        if body not in self._index_of:
            raise SceneError(no_such("body", body, self._index_of))
        return self._index_of[body]

    def _slots(self, poses: Mapping[str, ArrayLike]) -> MovingBodies:
        """Return slots that hold poses given by name, reused for the same names."""
        names, slots = tuple(poses), self._last_slots
        if slots is None or slots.names != names:  # to compare is faster than to look up
            if names not in self._pose_slots:
                if len(self._pose_slots) == POSE_SLOTS_MAX:
                    self._pose_slots.clear()
                self._pose_slots[names] = self.moving_bodies(names)
            slots = self._last_slots = self._pose_slots[names]
        slots.set_poses(poses)
        return slots

    def run(self, p_WT: ArrayLike, poses: Mapping[str, ArrayLike] | None = None) -> "Recording":
        """Compute ticks along a path.

        The first run starts at the first position of the path; later runs continue from the state of the last tick.

        Args:
            p_WT: (n, 3) device positions, one for each tick [m]; or (n, 4, 4) poses of the tool.
            poses: poses of the bodies that move, {body: X_WB (n, 4, 4)}, one for each tick.

        Raises:
            PathError: the path is empty, not (n, 3), or not finite.
            SceneError: a body is unknown, or poses of bodies or of the tool have another length or are not rigid.
        """
        given = numbers(p_WT)
        X_WT = rigid(given, "poses of the tool", len(given)) if given.ndim == 3 and len(given) > 0 else None
        path = positions(np.ascontiguousarray(given if X_WT is None else X_WT[:, :3, 3]))
        n = len(path)
        moving, X_WB, teleported = self._poses(poses or {}, n)
        if not self._started:
            self.reset(path[0])
        self._apply_scene_poses()
        rows = records(n, ROW)
        a_m_s2 = np.zeros((n, self.block))
        for k in [slice(None)] if X_WT is None else [slice(k, k + 1) for k in range(n)]:
            if X_WT is not None:
                self.surface.touch["R_WT"] = X_WT[k, :3, :3]
            self._play(self.world, self.surface, path[k], moving, X_WB[k], teleported, rows[k], a_m_s2[k])
        self.warn_if_inside()
        self._warn_of_far(rows["flags"], path)
        return self.recording(rows, a_m_s2, R_WT=None if X_WT is None else X_WT[:, :3, :3])

    def recording(
        self, rows: Records, a_m_s2: NDArray[np.float64], R_WT: NDArray[np.float64] | None = None
    ) -> "Recording":
        """Return a recording of ticks that other code ran, from their rows (n,) ROW and samples (n, block), and the
        orientations (n, 3, 3) of the tool if they were measured."""
        from hapscene.render.recording import Recording

        n = len(rows)
        t_s = np.asarray((self._ticks + np.arange(n)) * self.tick_s, np.float64)
        self._ticks += n
        return Recording.of_rows(
            rows,
            a_m_s2,
            t_s,
            a_rate_Hz=self.a_rate_Hz,
            body_names=self._body_names,
            swatch_names=self._swatch_names,
            seed=self.seed,
            effects=tuple(effect.name for effect in self._effects),
            R_WT=R_WT,
        )

    def _apply_scene_poses(self) -> None:
        """Teleport the bodies whose pose in the scene has changed since the last call."""
        if self._scene.pose_count == self._seen:
            return
        X_WB = [body.X_WB for body in self._scene.bodies]
        seen = zip(self._body_names, X_WB, self._seen_X_WB, strict=False)
        changed = [name for name, X, was in seen if name in self._index_of and X is not was]
        slots = MovingBodies(changed, self._index_of, np.array(X_WB))
        slots.teleported[:] = 1
        self._place(slots)
        self._seen, self._seen_X_WB = self._scene.pose_count, X_WB

    def _place(self, slots: MovingBodies) -> None:
        """Set the poses of bodies now, between two ticks."""
        use_moving_bodies(self.world, self.surface)
        call_entry(
            place_bodies, self.world, self.surface, slots.index, slots.poses, slots.teleported, len(slots.index), 0
        )

    def _poses(
        self, poses: Mapping[str, ArrayLike], count: int
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
        """Return indices of moving bodies (m,), their poses (count, m, 4, 4), and which of them teleport (m,): none."""
        if poses:
            use_moving_bodies(self.world, self.surface)
        moving = np.zeros(len(poses), np.int64)
        X_WB = np.zeros((count, len(poses), 4, 4))
        for m, (name, X) in enumerate(poses.items()):
            moving[m] = self._index(name)
            X_WB[:, m] = rigid(X, f"poses of body {name!r}", count)
        return moving, X_WB, np.zeros(len(poses), np.int64)


def _check_arguments(effects: object, seed: object, crease_rad: float, tip_radius_m: float) -> None:
    if isinstance(effects, str):
        raise EffectError(f"effects must be a list of names, not the text {effects!r}: write [{effects!r}]")
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise HapsceneError(f"seed must be an integer of at least 0, is {seed!r}")
    if not 0.0 <= crease_rad <= np.pi:
        raise HapsceneError(f"crease_rad must be from 0 to π, is {crease_rad}")
    if not 0.0 <= tip_radius_m <= TIP_RADIUS_MAX_M:
        raise HapsceneError(f"tip_radius_m must be from 0 to {TIP_RADIUS_MAX_M} m, is {tip_radius_m} (is it in mm?)")


def _warn(messages: list[str]) -> None:
    """Issue one warning for all messages."""
    if messages:
        more = f"; and {len(messages) - 1} more, see Renderer.clips" if len(messages) > 1 else ""
        warn(messages[0] + more, DeviceWarning)


def warn_of_far(p_WT_m: ArrayLike) -> None:
    """Warn of a tool that is so far from all bodies that its position (3,) is probably in another unit."""
    place = ", ".join(f"{v:g}" for v in np.asarray(p_WT_m).tolist())
    warn(
        f"the tool is at ({place}) m, far from all bodies; expected a position near them, in metres: is it in mm?",
        UsageWarning,
    )


def _compile_run(world: World, surface: Surface, rows: Records, blocks: NDArray[np.float64]) -> Callable[..., None]:
    """Return `run_ticks` compiled for these records. Its entry point skips numba's type look-up (3 µs per call)."""
    if not isinstance(run_ticks, Native):  # interpreted
        return run_ticks
    compiled = run_ticks.compile(world, surface, np.zeros((0, 3)), *_NO_BODIES, rows, blocks)
    entry: Callable[..., None] = compiled.entry_point
    return entry
