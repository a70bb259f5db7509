"""The renderer: a scene, effects and a tool that touches it, tick by tick or along a whole path."""

import os
from collections.abc import Iterable, Mapping, Sequence
from itertools import zip_longest
from threading import Lock
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.compiled.entry import call_entry
from hapscene.compiled.native import INTERPRETED, compiling
from hapscene.constants import ACCELERATION_RATE_HZ, NEAR_MAX, REACH_MAX_M, TICK_S
from hapscene.contact.deformation import Deformation, room_for, shape_of
from hapscene.contact.moving import place_bodies
from hapscene.contact.proxy import put
from hapscene.contact.world import Growth, build_world, crowd
from hapscene.device.model import IDEAL, DeviceLike, DeviceWarning, Limits, limits_of
from hapscene.errors import EffectError, HapsceneError, PathError, SceneError, no_such, warn
from hapscene.flags import Flag, flag_of
from hapscene.geometry import numbers, positions, rigid
from hapscene.records import ROW, block_of, records
from hapscene.render.contact_info import Contact, Impulse
from hapscene.render.moving_bodies import MovingBodies
from hapscene.render.tick import run_ticks, tick, use_moving_bodies, use_tick
from hapscene.surface.device_clipping import Clip, Fit, Numbers, clip_to_device, clips, share_of
from hapscene.surface.effect import Effect, check_range
from hapscene.surface.effect_registry import load_effect
from hapscene.surface.field_settings import FieldSetting, field_setting
from hapscene.surface.surface_arrays import SWITCHED_OFF, Surface, build_surface, clear_states, put_numbers

if TYPE_CHECKING:
    from hapscene.fidelity.fidelity import Fidelity
    from hapscene.render.recording import Recording
    from hapscene.scene.body import Body
    from hapscene.scene.scene import Scene

__all__ = ["EFFECTS", "OTHER_BODIES", "Command", "Renderer"]
EFFECTS: Final = ("wall", "friction", "lpc_texture", "tap", "adhesion")
"""The effects a renderer has unless told otherwise."""

OTHER_BODIES: Final = "to repaint, give the bodies that the renderer was made with; for others make a new one"

_STILL: Final = (np.zeros(0, np.int64), np.zeros((1, 0, 4, 4)), np.zeros(0, np.int64))


class Command(NamedTuple):
    """What one haptic tick asks of the device.

    Attributes:
        f_W_N: (3,) force on the hand in W [N].
        a_m_s2: (block,) acceleration samples along the handle [m/s²].
        flags: what went wrong or was limited.
        contact: the touched body, where and how; None in the air.
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
    """The swatches of a scene and which face wears which, ready to be felt; `Renderer.repaint` in two halves."""

    surface: Surface
    fit: Fit
    swatch_names: tuple[str, ...]
    growth: Growth | None
    bodies: "tuple[Body, ...]"
    scene: "Scene"


class Renderer:
    """Renders touch: the same tick drives `run` over a recorded path and `step` in a loop of your own.

    Args:
        scene: what is there. Its swatches are read once, here; after `Scene.pose` a body appears there.
        effects: names of effect plugins, or `Effect` objects, in the order they are summed; those of the scene last.
        settings: of the scene's effects, by name: `{"weight": {"mass_kg": 0.2}}`; their parameters, the arrays that
            they ask for, and `bodies` whose poses they read.
        seed: of all that effects draw at random; the same seed gives the same bits.
        tick_s: period of the force channel [s].
        a_rate_Hz: rate of the acceleration channel; a tick must hold a whole number of samples, at most 256.
        limits: of the device; None for an ideal one.
        device: in the place of limits, whose they are at this period: a name of `hapscene.device.DEVICES`, or itself.
        crease_rad: edges at which a surface turns by less are felt round (force shading, `hapscene.contact.shading`,
            which leaks energy); 0 for the mesh as it is.
        fidelity: how finely each part of the scene is rendered, or the path of its file (`hapscene tune`). None for
            the scene as it is.

    Attributes:
        tick_s, a_rate_Hz, seed: as given.
        limits: of the device.
        fidelity: as given, or read; None without one.
        block: acceleration samples in a tick.
        world, surface: what the compiled tick reads and writes; for those who drive it themselves.

    Raises:
        SceneError: a scene without bodies.
        EffectError: an effect that is unknown or does not compile.
        HapsceneError: rates that do not fit together, an unknown device, or a device beside limits.

    Warns:
        DeviceWarning: the device takes less of a swatch than it asks for, once, for the first one painted.
        MeshWarning: more bodies overlap in one place than a tick asks.
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
        settings: Mapping[str, Mapping[str, Any]] | None = None,
        fidelity: "Fidelity | str | os.PathLike[str] | None" = None,
    ) -> None:
        if not scene.bodies:
            raise SceneError("the scene has no bodies: add one with scene.add(mesh, name=…)")
        self.tick_s = float(tick_s)
        self.a_rate_Hz = float(a_rate_Hz)
        self.block = block_of(self.tick_s, self.a_rate_Hz)
        self.seed = seed
        if isinstance(effects, str):
            raise EffectError(f"effects are a list of names, as [{effects!r}]")
        if not isinstance(seed, int | np.integer) or seed < 0:
            raise HapsceneError(f"a seed is a whole number, 0 or more, not {seed!r}")
        if device is not None and limits is not None:
            raise HapsceneError(f"limits or a device, not both: device {device!r} has limits of its own")
        if not 0.0 <= crease_rad <= np.pi:
            raise HapsceneError(f"crease_rad must be 0 to π, is {crease_rad}")
        self.limits = limits_of(device, self.tick_s) if device is not None else limits or IDEAL
        loaded = [load_effect(e) if isinstance(e, str) else e for e in effects]
        self._contact_effects = [e for e in loaded if e.scope == "contact"]
        self._effects = self._contact_effects + [e for e in loaded if e.scope == "scene"]
        self._body_names = tuple(body.name for body in scene.bodies)
        self._index_of = {name: index for index, name in enumerate(self._body_names)}  # of those that are felt
        self._swatch_names = tuple(swatch.name for swatch in scene.swatches)
        self._bodies = tuple(scene.bodies)
        self._fields = self._read_field_settings(settings or {})
        self._mapped: MovingBodies | None = None
        self._scene, self._seen, self._seen_X_WB = scene, scene.pose_count, [body.X_WB for body in scene.bodies]
        self._crease_rad = crease_rad
        self._deformations: dict[int, Deformation] = {}
        self._deforming = Lock()  # of threads that give shapes; no tick asks for it
        self.fidelity = _fidelity_of(fidelity, scene)
        self._row = records(1, ROW)
        self._samples = np.zeros((1, self.block))
        with compiling(tick, run_ticks, put, *(effect.render for effect in self._effects)):
            rendered = self._at_fidelity(scene)
            self.world = build_world(rendered.bodies, crease_rad)
            self._fit, self.surface, messages = self._fitted(rendered)
            use_tick(self.world, self.surface, self._row, self._samples)
            self._play = _entry(self.world, self.surface, self._row, self._samples)
        _warn(messages + [str(clip) for k in range(len(self._fields)) for clip in self._field(k)[1] if clip.reported])
        _warn_of_crowd(scene, self.world)
        self._row_bytes = self._row.view(np.ndarray).view(np.uint8)
        row = self._row.view(np.ndarray)
        self._out = row["f_W_N"][0], row["flags"], row["touching"]  # views: a look-up by name costs a microsecond
        self._started = False
        self._ticks = 0

    def __repr__(self) -> str:
        names = ", ".join(effect.name for effect in self._effects) or "no effects"
        count = len(self._index_of)
        return (
            f"<Renderer: {count} {'body' if count == 1 else 'bodies'}; {names}; ticks of {1e3 * self.tick_s:g} ms, "
            f"a_rate_Hz={self.a_rate_Hz:g}; device {self.limits.device!r}>"
        )

    def reset(self, p_WT: ArrayLike) -> None:
        """Start anew with the tool and the proxy at `p_WT` (3,) [m]: no contact, no memory, random numbers as at first.

        Bodies stay at their last poses.

        Raises:
            PathError: a position that is not three finite numbers.
        """
        p = positions(numbers(p_WT).reshape(1, -1))[0]
        surface = self.surface
        clear_states(surface, self._effects, self.seed)
        memory, touch = surface.memory, surface.touch
        for record, stays in ((touch, ("tick_s", "rate_Hz", "block")), (memory, ("smoothing",))):
            keep = {name: record[name].copy() for name in stays}
            record.view(np.uint8)[:] = 0
            for name, value in keep.items():
                record[name] = value
        touch["body"] = touch["face"] = touch["swatch"] = touch["other"] = touch["left_body"] = -1
        touch["nhat_W"] = (0.0, 0.0, 1.0)
        memory["p_WT_m"] = memory["tool_W_m"] = p
        memory["fresh"] = 1
        bodies = self.world.bodies
        bodies["moved"] = bodies["passed"] = 0
        bodies["was_R_WB"], bodies["was_p_WB_m"] = bodies["R_WB"], bodies["p_WB_m"]
        self.world.moved[0] = self.world.proxy[0].passed_count = 0
        self.world.impulse[:] = 0.0
        put(self.world, (p[0], p[1], p[2]))
        self._started = True
        self._ticks = 0

    def tune(self, swatch: str, **numbers: float) -> None:
        """Change numbers of a swatch while it is felt, from the next tick on: `tune("oak", stiffness_N_m=300.0)`.

        Args:
            swatch: its name.
            numbers: `stiffness_N_m`, and parameters of the effects by name.

        Raises:
            SceneError: no such swatch in the scene.
            EffectError: no effect has such a parameter, or it may not have this value.
        """
        if swatch not in self._swatch_names:
            raise SceneError(no_such("swatch", swatch, self._swatch_names))
        index = self._swatch_names.index(swatch)
        self._fit.tune(index, numbers)
        put_numbers(self.surface, self._effects, index, self._fit.given[index])
        _warn([str(clip) for clip in self._fit.clips(index) if clip.reported and clip.number in numbers])

    def tune_field(self, effect: str, **numbers: float) -> None:
        """Change parameters of an effect of the scene, from the next tick on: `tune_field("weight", mass_kg=0.3)`.

        Raises:
            EffectError: no such effect of the scene, no such parameter, or it may not have this value.
        """
        first = len(self._contact_effects)
        names = [e.name for e in self._effects[first:]]
        if effect not in names:
            raise EffectError(no_such("effect of the scene", effect, names))
        k = names.index(effect)
        params = {param.name: param for param in self._effects[first + k].params}
        if unknown := sorted(numbers.keys() - params.keys()):
            raise EffectError(no_such("parameter", unknown[0], params))
        checked = {name: check_range(self._effects[first + k], params[name], v) for name, v in numbers.items()}
        self._fields[k].numbers.update(checked)
        taken, clipped = self._field(k)
        put_numbers(self.surface, self._effects, len(self._swatch_names), taken)
        _warn([str(clip) for clip in clipped if clip.reported and clip.number in numbers])

    def mute(self, effect: str, muted: bool = True) -> None:
        """Leave an effect out of the sum from the next tick on, or take it in again; a reset changes nothing of it.

        Raises:
            EffectError: the renderer has no such effect.
        """
        names = [one.name for one in self._effects]
        if effect not in names:
            raise EffectError(no_such("effect", effect, names))
        self.surface.muted[names.index(effect)] = SWITCHED_OFF if muted else 0

    def _at_fidelity(self, scene: "Scene") -> "Scene":
        """The scene as the fidelity has it; itself without one."""
        if self.fidelity is None:
            return scene
        from hapscene.fidelity.apply import apply_level

        return apply_level(scene, self.fidelity.level)

    def _refuse_fidelity(self, what: str) -> None:
        """Say what is not done with a fidelity."""
        if self.fidelity is not None:
            raise SceneError(f"{what} with a fidelity, which is of the scene as it was: make a renderer without one")

    def _read_field_settings(self, settings: Mapping[str, Mapping[str, Any]]) -> list[FieldSetting]:
        """Settings of the scene effects, checked, one per effect."""
        of_scene = self._effects[len(self._contact_effects) :]
        names = [effect.name for effect in of_scene]
        for name in names:
            if names.count(name) > 1:
                raise EffectError(f"effect {name!r} of the scene is named twice, and has one setting")
        if not isinstance(settings, Mapping):
            raise EffectError(
                f"settings go by the names of effects: {{'weight': {{'mass_kg': 0.2}}}}, not {settings!r:.40}"
            )
        for name in settings:
            if name not in names:
                raise EffectError(no_such("effect of the scene", name, names))
        return [field_setting(e, settings.get(e.name, {}), self._body_names, self.a_rate_Hz) for e in of_scene]

    def _field(self, k: int) -> tuple[Numbers, list[Clip]]:
        """What the device takes of the numbers of the k-th effect of the scene, and where that is not all."""
        e = len(self._contact_effects) + k
        asked = {(e, name): value for name, value in self._fields[k].numbers.items()}
        taken = clip_to_device(self.limits, self._effects, asked)
        return taken, clips(self._effects[e].name, asked, taken, self.limits, self.tick_s, "effect")

    @property
    def clips(self) -> tuple[Clip, ...]:
        """What the device does not take of the swatches' numbers, and of the scene's effects', as they are now."""
        of_swatches = [clip for index in range(len(self._swatch_names)) for clip in self._fit.clips(index)]
        return tuple(of_swatches + [clip for k in range(len(self._fields)) for clip in self._field(k)[1]])

    def _fitted(self, scene: "Scene") -> tuple[Fit, Surface, list[str]]:
        """A scene's swatches as the device takes them, and what of those painted is worth a warning."""
        fit = Fit(scene, self._contact_effects, self.limits, self.tick_s)
        surface = build_surface(scene, self._effects, self.tick_s, self.a_rate_Hz, self.limits, self._fields)
        for k in range(len(self._fields)):
            put_numbers(surface, self._effects, len(scene.swatches), self._field(k)[0])
        from hapscene.scene.fine_paint import swatches_of

        painted = {k for body in scene.bodies for k in swatches_of(body).tolist()}
        messages: list[str] = []
        for index, swatch in enumerate(scene.swatches):
            put_numbers(surface, self._effects, index, fit.given[index])
            found = [str(clip) for clip in fit.clips(index) if clip.reported]
            if swatch.texture is not None:
                fold_kg, own_Ns_m = self.limits.fold_mass_kg, self.limits.own_damping_Ns_m
                share = share_of(swatch.texture, fold_kg, own_Ns_m, self.tick_s)
                surface.fold_mass_kg[index] = fold_kg * share.share
                if share.share < 1.0:
                    found.append(share.message(swatch.name, self.limits.device))
            messages += found if index in painted else []
        return fit, surface, messages

    def repaint(self, scene: "Scene") -> None:
        """Feel another painting of the same bodies: their swatches, and face by face which. Contact goes on.

        Bodies that the scene has behind those of the renderer are felt as well from then on, and it is this scene whose
        `pose` is seen.

        Raises:
            SceneError: other bodies than the renderer was made with, or one far too large to be added to them.
            EffectError: a swatch that an effect refuses. Then nothing is changed.
        """
        self.take_painting(self.prepare_painting(scene))

    def prepare_painting(self, scene: "Scene") -> PreparedPainting:
        """The slow half of `repaint`: what `take_painting` takes, while ticks go on in another thread."""
        known = len(self._bodies)
        for ours, theirs in zip_longest(self._bodies, scene.bodies[:known]):
            if theirs is None or (ours.name, len(ours.mesh.faces)) != (theirs.name, len(theirs.mesh.faces)):
                raise SceneError(OTHER_BODIES)
        more = tuple(scene.bodies[known:])
        if more:
            self._refuse_fidelity("no body is added")
        fit, surface, _ = self._fitted(self._at_fidelity(scene))
        growth = Growth(self.world, self._bodies, more, self._crease_rad) if more else None
        names = tuple(swatch.name for swatch in scene.swatches)
        return PreparedPainting(surface, fit, names, growth, more, scene)

    def take_painting(self, painting: PreparedPainting) -> None:
        """The quick half of `repaint`, between two ticks."""
        surface, old = painting.surface, self.surface
        for name in ("touch", "memory", "states", "muted"):
            getattr(surface, name)[:] = getattr(old, name)
        surface.touch["swatch"] = surface.touch["other"] = -1  # another one, or the same by another number
        surface.entries[:] = old.entries
        self.surface, self._fit = surface, painting.fit
        self._swatch_names = painting.swatch_names
        if painting.growth is not None:
            with self._deforming:
                self.world = painting.growth.take(self.world)
            self._bodies += painting.bodies
            for body in painting.bodies:
                self._index_of[body.name] = len(self._body_names)
                self._body_names += (body.name,)
            self._scene, self._seen = painting.scene, painting.scene.pose_count
            self._seen_X_WB = [body.X_WB for body in painting.scene.bodies]

    def remove(self, body: str) -> None:
        """Take a body out of what is felt. Its number is not given to another, its memory stays, and so does the scene.

        Raises:
            SceneError: no such body.
        """
        index = self._index(body)
        row = self.world.bodies[index]
        row.radius_m, row.shape_posted = -REACH_MAX_M, row.shape_felt  # nothing comes near it any more
        slots = self.moving([body])
        slots.teleported[:] = 1
        self._place(slots)
        self.world.proxy[0].near_room_m = 0.0  # which are near is looked up anew
        del self._index_of[body]
        self._mapped = None  # it may hold the body

    def deform(self, body: str, vertices_m: ArrayLike) -> None:
        """Give a body another shape from the next tick on, some 60 times a second: contact and memory go on.

        Between two shapes its surface goes evenly from one to the other where it is touched. May be called in another
        thread than `step`, which does not wait for it. The first time takes as long as to build the search, three times
        the body's memory, and once that of all the renderer's corners (72 bytes a face). The scene stays as it is.

        Args:
            body: its name.
            vertices_m: (N, 3) where the vertices of its mesh are, in the body's frame; its faces are as ever.

        Raises:
            PathError: not numbers.
            SceneError: no such body, not as many places as the mesh has vertices, or not finite ones.
        """
        index = self._index(body)
        self._refuse_fidelity("no body is given another shape")
        use_moving_bodies(self.world, self.surface)
        mesh = self._bodies[index].mesh
        vertices = shape_of(vertices_m, len(mesh.vertices_m), body)
        with self._deforming:
            if index not in self._deformations:
                self.world, first = room_for(self.world, mesh)
                made = Deformation(self.world, index, mesh, first=first, crease_rad=self._crease_rad)
                self._deformations[index] = made
            self._deformations[index].post(self.world, vertices)

    def moving(self, names: Sequence[str]) -> MovingBodies:
        """Bind bodies to slots whose poses are written in place: what `step` then takes, at a fraction of the time.

        Raises:
            SceneError: an unknown body, or one that is named twice.
        """
        if isinstance(names, str) or not isinstance(names, Iterable):
            raise SceneError(f"bodies are a list of names, as ['crate'], not {names!r:.40}")
        use_moving_bodies(self.world, self.surface)
        self._see_poses()
        bodies = self.world.bodies
        X_WB = np.tile(np.eye(4), (len(bodies), 1, 1))
        X_WB[:, :3, :3], X_WB[:, :3, 3] = bodies["R_WB"], bodies["p_WB_m"] - bodies["lead_W_m"]
        return MovingBodies(names, self._index_of, X_WB, self.world.proxy)

    def step(self, p_WT: ArrayLike, poses: Mapping[str, ArrayLike] | MovingBodies | None = None) -> Command:
        """One tick with the tool at `p_WT` (3,) [m]; `poses` moves bodies there: {body: X_WB (4, 4)}, or `moving` ones.

        A position that is not finite is flagged (`Flag.TOOL_NOT_FINITE`), not raised; so is a pose that is not finite
        or not rigid (`Flag.POSE_REFUSED`), whose body stays at its last good one. What rounding does to a rotation is
        mended. The first step of a renderer starts it at that position.

        Returns:
            Command, whose arrays are the caller's to keep.

        Raises:
            PathError: a position that is not three numbers.
            SceneError: poses for an unknown body, or of another shape; bodies bound by another renderer.
        """
        p = numbers(p_WT).reshape(1, -1)
        if p.shape != (1, 3):
            raise PathError(f"a position is three numbers in metres; it has {p.size}")
        if not self._started:
            if not np.isfinite(p).all():
                return Command(np.zeros(3), np.zeros(self.block), Flag.TOOL_NOT_FINITE)
            self.reset(p[0])
        self._see_poses()
        slots = _STILL
        if poses:
            if not isinstance(poses, MovingBodies | Mapping):
                raise SceneError("poses are {body: X_WB (4, 4)}, or what `moving` gave, not " + type(poses).__name__)
            bodies = poses if isinstance(poses, MovingBodies) else self._slots(poses)
            if bodies.owner is not self.world.proxy:  # which stays whatever becomes of the bodies
                raise SceneError("these moving bodies are another renderer's: bind them by this one's `moving`")
            slots = bodies.index, bodies.poses, bodies.teleported
        self._play(self.world, self.surface, p, *slots, self._row, self._samples)
        self._ticks += 1
        f_W_N, flags, touching = self._out
        contact = None
        if touching.item():
            contact = Contact(self._row_bytes.tobytes(), self._body_names, self._swatch_names)
        return Command(f_W_N.copy(), self._samples[0].copy(), flag_of(flags.item()), contact)

    def impulse(self, body: str) -> Impulse:
        """What the tool has given a body since the last reset.

        Raises:
            SceneError: no such body.
        """
        total = self.world.impulse[self._index(body)]
        return Impulse(total[:3].copy(), total[3:].copy())

    def _index(self, body: str) -> int:
        if body not in self._index_of:
            raise SceneError(no_such("body", body, self._index_of))
        return self._index_of[body]

    def _slots(self, poses: Mapping[str, ArrayLike]) -> MovingBodies:
        """Slots for poses by name; the same as long as the names are."""
        if self._mapped is None or self._mapped.names != tuple(poses):
            self._mapped = self.moving(tuple(poses))
        self._mapped.take(poses)
        return self._mapped

    def run(self, p_WT: ArrayLike, poses: Mapping[str, ArrayLike] | None = None) -> "Recording":
        """Tick along a path: `p_WT` (n, 3) [m], a position per tick; `poses` {body: X_WB (n, 4, 4)}, a pose per tick.

        Goes on from where the last `run` or `step` ended; the first starts at the path's first position.

        Raises:
            PathError: a path that is empty, of another shape, or not finite.
            SceneError: poses for an unknown body, of another length, or not rigid.
        """
        path = positions(np.ascontiguousarray(numbers(p_WT)))
        n = len(path)
        slots = self._poses(poses or {}, n)
        if not self._started:
            self.reset(path[0])
        self._see_poses()
        rows = records(n, ROW)
        a_m_s2 = np.zeros((n, self.block))
        self._play(self.world, self.surface, path, *slots, rows, a_m_s2)
        return self.recording(rows, a_m_s2)

    def recording(self, rows: Any, a_m_s2: NDArray[np.float64]) -> "Recording":
        """The next ticks, from their rows (n,) ROW and samples (n, block): for those who drive the tick themselves."""
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
        )

    def _see_poses(self) -> None:
        """Have the bodies whose pose in the scene is another one since the last look appear there."""
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
        """Have bodies take their poses now, between two ticks."""
        use_moving_bodies(self.world, self.surface)
        call_entry(
            place_bodies, self.world, self.surface, slots.index, slots.poses, slots.teleported, len(slots.index), 0
        )

    def _poses(
        self, poses: Mapping[str, ArrayLike], count: int
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
        """Indices of the moving bodies (m,), their poses (count, m, 4, 4), and which of them jump (m,): none."""
        if poses:
            use_moving_bodies(self.world, self.surface)
        moving = np.zeros(len(poses), np.int64)
        X_WB = np.zeros((count, len(poses), 4, 4))
        for m, (name, X) in enumerate(poses.items()):
            moving[m] = self._index(name)
            X_WB[:, m] = rigid(X, f"poses of body {name!r}", count)
        return moving, X_WB, np.zeros(len(poses), np.int64)


def _warn(messages: list[str]) -> None:
    """One line for all of them."""
    if messages:
        more = f"; and {len(messages) - 1} more, see Renderer.clips" if len(messages) > 1 else ""
        warn(messages[0] + more, DeviceWarning)


def _warn_of_crowd(scene: "Scene", world: Any) -> None:
    """Say where more bodies overlap than a tick asks."""
    count, index = crowd(world) if len(scene.bodies) > NEAR_MAX else (0, 0)
    if count > NEAR_MAX:
        from hapscene.scene.mesh import MeshWarning

        place = ", ".join(f"{v:g}" for v in world.ball_W_m[index, :3])
        warn(
            f"{count:,} bodies overlap about ({place}) m, where body {scene.bodies[index].name!r} is; a tick asks "
            f"{NEAR_MAX} of them, the others are not felt there (Flag.CROWDED): move them apart, or make them one mesh",
            MeshWarning,
        )


def _fidelity_of(fidelity: "Fidelity | str | os.PathLike[str] | None", scene: "Scene") -> "Fidelity | None":
    """A fidelity by itself, or from its file."""
    if isinstance(fidelity, str | os.PathLike):
        from hapscene.fidelity.fidelity_file import load_fidelity

        return load_fidelity(fidelity, scene)
    return fidelity


def _entry(world: Any, surface: Any, rows: Any, blocks: NDArray[np.float64]) -> Any:
    """`run_ticks` compiled for these records, without numba's look-up of argument types (3 µs a call)."""
    play: Any = run_ticks
    if INTERPRETED:
        return play
    return play.compile(world, surface, np.zeros((0, 3)), *_STILL, rows, blocks).entry_point
