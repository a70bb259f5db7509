"""The main job: touch a scene along a path; write what was felt as numbers, plots, a picture and sound."""

import json
import platform
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from copy import copy
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import ACCELERATION_RATE_HZ, TICK_S
from hapscene.errors import PathError, SceneError, ViewError
from hapscene.flags import Flag
from hapscene.io.files import whole_folder
from hapscene.memory import memory_left_B
from hapscene.render.recording import Recording

if TYPE_CHECKING:
    from hapscene.bridge import MuJoCo
    from hapscene.fidelity.fidelity import Fidelity
    from hapscene.loop import ReferenceTrajectory, Twin
    from hapscene.scene.scene import Scene

__all__ = [
    "MADE",
    "cautions",
    "is_model",
    "open_model",
    "open_scene",
    "speak",
    "step",
    "summarise",
    "touch",
    "touch_by_hand",
    "why_nothing",
]


# What a touch is kept in: numbers, plots, a picture and sound, and a summary of them.


MADE: Final = ("touch.npz", "touch.csv", "summary.json", "plots.png", "scene.png", "feel.wav")
"""What is written of every touch, in the order it is named."""

SUMMARY_VERSION: Final = 1

_PACKAGES: Final = ("hapscene", "embreex", "numba", "numpy", "scipy", "trimesh", "matplotlib", "pyrender2")


def summarise(recording: Recording, title: str, **more: Any) -> dict[str, Any]:
    """The content of summary.json: how long, how much contact, how fast, what went wrong, which versions."""
    touching = recording.touching
    body, swatch = (recording.body, recording.body_names), (recording.swatch, recording.swatch_names)
    return {
        "format_version": SUMMARY_VERSION,
        "scene": title,
        "ticks": len(recording),
        "ticks_in_contact": int(np.count_nonzero(touching)),
        **{
            f"ticks_on_{what}": {name: int(np.count_nonzero(touching & (index == i))) for i, name in enumerate(known)}
            for what, (index, known) in (("bodies", body), ("swatches", swatch))
        },
        "a_rate_Hz": recording.a_rate_Hz,
        "a_samples_per_tick": recording.a_m_s2.shape[1],
        "effects": list(recording.effects),
        "seed": recording.seed,
        "time_per_tick_us": {"whole": _spread_us(recording.tick_ns), "contact": _spread_us(recording.contact_ns)},
        "flags": {str(flag.name): int(np.count_nonzero(recording.flags & flag)) for flag in Flag},
        "depth_max_m": float(recording.depth_m.max(initial=0.0)),
        "force_max_N": float(np.linalg.norm(recording.f_W_N, axis=1).max(initial=0.0)),
        "acceleration_max_m_s2": float(np.abs(recording.a_m_s2).max(initial=0.0)),
        **more,
        "versions": {"python": platform.python_version(), **{name: _version(name) for name in _PACKAGES}},
        "machine": f"{platform.system()} {platform.machine()}",
    }


def write_touch(
    scene: "Scene",
    recording: Recording,
    folder: Path,
    title: str,
    with_picture: bool,
    say: Callable[[str], None],
    a_heard_m_s2: NDArray[np.float64] | None = None,
    dark: bool = False,
    **more: Any,
) -> dict[str, str]:
    """Write `MADE` into `folder`, `more` into its summary; return what is missing, and why.

    feel.wav has the accelerations `a_heard_m_s2` (n, block), where they are not those that the recording asks for. With
    `dark`, pictures are on dark ground.
    """
    from hapscene.view.palette import DARK, LIGHT, albedo_colours
    from hapscene.view.picture import write_picture
    from hapscene.view.plot import write_plot
    from hapscene.view.sound import write_sound

    missing: dict[str, str] = {}
    with ThreadPoolExecutor(1) as beside:  # the picture is drawn by another process meanwhile
        picture = None
        if with_picture:
            theme = DARK if dark else LIGHT
            picture = beside.submit(write_picture, scene, recording, folder / "scene.png", size=None, theme=theme)
        with step(say, "writing touch.npz, touch.csv, feel.wav"):
            recording.save(folder / "touch.npz")
            recording.save_csv(folder / "touch.csv")
            heard = recording if a_heard_m_s2 is None else replace(recording, a_m_s2=a_heard_m_s2)
            full_scale_m_s2 = write_sound(heard, folder / "feel.wav")
        with step(say, "plotting plots.png"):
            heading = f"{title}: {len(recording):,} ticks, {np.count_nonzero(recording.touching):,} in contact"
            write_plot(recording, folder / "plots.png", heading, colours=albedo_colours(scene.swatches), dark=dark)
        if picture is not None:
            with step(say, "drawing scene.png"):
                try:
                    picture.result()
                except ViewError as error:
                    missing["scene.png"] = str(error)
    summary = summarise(recording, title, feel_wav_full_scale_m_s2=full_scale_m_s2, missing=missing, **more)
    text = json.dumps(summary, indent=2, ensure_ascii=False, allow_nan=False)
    (folder / "summary.json").write_text(text + "\n", encoding="utf-8")
    return missing


@contextmanager
def step(say: Callable[[str], None], what: str) -> Iterator[None]:
    """Say what is being done, and how long it took."""
    say(f"{what} … ")
    start_s = time.perf_counter()
    try:
        yield
    except BaseException:
        say("\n")
        raise
    say(f"{time.perf_counter() - start_s:.2f} s\n")


def _spread_us(time_ns: NDArray[np.int64]) -> dict[str, float]:
    """Median, p99, p99.9 and maximum of times [µs]."""
    points = np.percentile(time_ns, (50, 99, 99.9, 100)) / 1e3
    return {name: round(float(us), 3) for name, us in zip(("median", "p99", "p99_9", "max"), points, strict=True)}


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


MADE_BY_HAND: Final = (*MADE, "hand.npz", "hand.png")
"""What a touch in closed loop writes."""


LARGE_B: Final = 10_000_000
"""Size of a mesh file from which its loading is told stage by stage [bytes]: it takes a second or more."""


def open_scene(
    path: str | Path,
    unit: str | None = None,
    swatch: str | None = None,
    two_sided: bool = False,
    say: Callable[[str], None] = lambda text: None,
    *,
    accept_damaged: bool = False,
    up: str | None = None,
    scale: float = 1.0,
) -> "Scene":
    """A scene from its file, from one that `hapscene.exchange` wrote, or around one mesh.

    Args:
        path: a scene file (.scene.json), a mesh file of any known format, or a model of MuJoCo (.xml), as it starts.
        unit: of the mesh, where its file carries none.
        swatch: for the whole mesh, whatever else its file says: a name, or a .swatch file.
        two_sided: whether the mesh's inner side is felt as well.
        say: is given the stages of a large mesh file: "reading 66 MB … ", "checking 1,310,720 faces … ".
        accept_damaged: take what can be read of a damaged mesh: see `hapscene.load_mesh`.
        up, scale: the axis that is up in the mesh's file, and how much larger to make it: see `hapscene.load_mesh`.

    Raises:
        HapsceneError: a file that cannot be loaded, or an option that a scene file answers itself.

    Warns:
        ExchangeWarning: what the file of a painted scene does not keep.
    """
    turned = ("--up", up), ("--scale", scale != 1.0)
    if str(path).endswith((".scene.json", ".scene.zip")):
        from hapscene.scene.scene import load_scene

        for option, value in (("--unit", unit), *turned, ("--swatch", swatch), ("--two-sided", two_sided)):
            if value:
                raise SceneError(f"{path}: is a scene file, which says this itself; leave {option} out")
        return load_scene(path)
    if is_model(path):
        for option, value in turned:
            if value:
                raise SceneError(f"{path}: is a model of MuJoCo, in metres and z up; leave {option} out")
        return open_model(path, unit, swatch, two_sided).scene
    from hapscene.exchange import painted_scene
    from hapscene.scene.scene import Scene

    size_B = Path(path).stat().st_size if Path(path).is_file() else 0
    if size_B >= LARGE_B:
        say(f"reading {size_B / 1e6:.0f} MB … ")
    scene = None if swatch or two_sided else painted_scene(path, unit, up=up, scale=scale)
    if scene is None:
        scene = Scene()
        mesh = scene.mesh_of(path, unit, accept_damaged, up=up, scale=scale)
        if size_B >= LARGE_B:
            say(f"checking {len(mesh.faces):,} faces … ")
        scene.add(mesh, swatch=swatch, two_sided=two_sided)
    return scene


MODELS: Final = (".xml", ".mjcf", ".urdf")
"""Ends of the names of models of MuJoCo."""


def is_model(path: str | Path) -> bool:
    """Whether a file is a model of MuJoCo, by its name."""
    return str(path).lower().endswith(MODELS)


def open_model(
    path: str | Path, unit: str | None = None, swatch: str | None = None, two_sided: bool = False
) -> "MuJoCo":
    """A model of MuJoCo, to be touched; all of it of one swatch, where one is given.

    Raises:
        SceneError: MuJoCo is missing or does not take it, or an option that a model answers itself.
    """
    from hapscene.bridge import load_mujoco

    for option, value in (("--unit", unit), ("--two-sided", two_sided)):
        if value:
            raise SceneError(f"{path}: is a model of MuJoCo, in metres and felt from outside; leave {option} out")
    return load_mujoco(path, swatch)


_TICK_B: Final = 500
"""What is felt in a tick takes this much memory until it is written and plotted [bytes], as measured."""

_SAMPLE_B: Final = 50
"""And each of its samples of acceleration [bytes]."""

_FEEL_B: Final = 800
"""And what a hand felt of it [bytes]."""


def _check_memory(count: int, tick_s: float, a_rate_Hz: float, more_B: int = 0) -> None:
    """Refuse a path of so many ticks, before it is felt, if what is felt does not fit into the memory that is left."""
    left_B = memory_left_B()
    each_B = _TICK_B + _SAMPLE_B * tick_s * a_rate_Hz + more_B
    if count * each_B > left_B:
        needed_MB = np.rint(count * each_B / 1e6)
        raise PathError(
            f"the path lasts {count * tick_s:,.0f} s: what is felt takes {needed_MB:,.9g} MB of memory, and "
            f"{left_B / 1e6:,.0f} are left, enough for {left_B / each_B * tick_s:,.0f} s: cut it into shorter ones"
        )


def touch(
    scene: "Scene",
    out: str | Path,
    p_WT: NDArray[np.float64],
    *,
    t_s: NDArray[np.float64] | None = None,
    effects: Sequence[str] | None = None,
    settings: Mapping[str, Mapping[str, Any]] | None = None,
    seed: int = 0,
    tick_s: float = TICK_S,
    a_rate_Hz: float = ACCELERATION_RATE_HZ,
    title: str = "",
    with_picture: bool = True,
    dark: bool = False,
    say: Callable[[str], None] = lambda text: None,
    caution: Callable[[str], None] | None = None,
    bridge: "MuJoCo | None" = None,
    fidelity: "Fidelity | str | Path | None" = None,
) -> list[Path]:
    """Touch a scene along a path and write `MADE` into a folder: all of it, or, where it fails, nothing.

    Args:
        scene: what to touch.
        out: the folder; files in it that bear other names stay.
        p_WT: (n, 3) the tool's path, a row per tick [m].
        t_s: (n,) times of the ticks on the path's own clock [s]; else from 0.
        effects: names of effect plugins; else the renderer's own choice.
        settings: of the scene's effects, as `Renderer` has them.
        seed: of what effects draw at random.
        tick_s: period of a tick [s].
        a_rate_Hz: rate of the acceleration channel [Hz].
        title: what the plots and the summary call the scene.
        with_picture: whether to draw scene.png. Where it cannot be drawn, `say` gets one line why.
        dark: whether pictures are on dark ground.
        say: is given the progress, piece by piece.
        caution: is given each of `cautions`, a sentence; else `say` is.
        bridge: whose scene it is, and which goes on meanwhile; pictures show it as it was at first.
        fidelity: how finely it is felt, or the file that says it; a touched face is then one of the coarser mesh.

    Returns:
        The files written.

    Raises:
        HapsceneError: a fidelity of another scene, an unknown effect, a rate that does not fit, a path that is not
            finite, or too long for the memory that is left.
        OSError: the folder cannot be written.
    """
    from hapscene.render.renderer import EFFECTS, Renderer

    _check_memory(len(p_WT), tick_s, a_rate_Hz)
    with whole_folder(out, ours=MADE) as folder:
        with step(say, f"readying {_counted(scene)}"):
            names = EFFECTS if effects is None else effects
            renderer = Renderer(
                scene, names, seed=seed, tick_s=tick_s, a_rate_Hz=a_rate_Hz, settings=settings, fidelity=fidelity
            )
        with step(say, f"rendering {len(p_WT) * tick_s:.1f} s of path"):
            recording = renderer.run(p_WT) if bridge is None else bridge.run(renderer, p_WT)
        _give_cautions(scene, recording, say, caution)
        if t_s is not None:
            recording = replace(recording, t_s=t_s)
        missing = write_touch(scene, recording, folder, title, with_picture, say, dark=dark)
    return _made(out, MADE, missing, say)


def touch_by_hand(
    scene: "Scene",
    out: str | Path,
    intent: "ReferenceTrajectory",
    ready: Callable[[], "Twin"],
    *,
    title: str = "",
    with_picture: bool = True,
    dark: bool = False,
    say: Callable[[str], None] = lambda text: None,
    caution: Callable[[str], None] | None = None,
    bridge: "MuJoCo | None" = None,
    **told: Any,
) -> list[Path]:
    """Touch a scene in closed loop, contact forces moving the tool; write `MADE_BY_HAND` into a folder, or nothing.

    Args:
        scene, out, title, with_picture, dark, say, caution, bridge: as `touch` has them.
        intent: what the hand means to do.
        ready: makes the twin.
        told: goes into the summary's `hand`.

    Returns:
        The files written.

    Raises:
        HapsceneError: what the twin refuses.
        OSError: the folder cannot be written.
    """
    from hapscene.loop.result import summarise_result
    from hapscene.view.plot import write_hand_plot

    _check_memory(len(intent), TICK_S, ACCELERATION_RATE_HZ, _FEEL_B)

    with whole_folder(out, ours=MADE_BY_HAND) as folder:
        with step(say, f"readying {_counted(scene)}"):
            twin = ready()
        with step(say, f"living through {len(intent) * twin.renderer.tick_s:.1f} s"):
            feel = twin.run(intent) if bridge is None else bridge.run_twin(twin, intent)
        _give_cautions(scene, feel.recording, say, caution)
        hand = {**told, **summarise_result(feel)}
        missing = write_touch(
            scene, feel.recording, folder, title, with_picture, say, feel.a_handle_m_s2, dark, hand=hand
        )
        with step(say, "writing hand.npz, hand.png"):
            feel.save(folder / "hand.npz")
            write_hand_plot(feel, folder / "hand.png", title, dark)
    return _made(out, MADE_BY_HAND, missing, say)


def _made(out: str | Path, names: Sequence[str], missing: Mapping[str, str], say: Callable[[str], None]) -> list[Path]:
    """The files that were written; why the others were not is said."""
    for name, reason in missing.items():
        say(f"without {name}: {reason}\n")
    return [file for name in names if (file := Path(out) / name).exists()]


LIMITED_SHARE: Final = 0.05
"""Share of the ticks in contact from which a force that is cut to the device's limit is warned about [1]."""


def cautions(scene: "Scene", recording: Recording) -> list[str]:
    """Why a touch may not be what was meant, a sentence each: nothing touched, no sound, a force that was cut."""
    touching = recording.touching
    count = int(np.count_nonzero(touching))
    if count == 0:
        return [f"nothing was touched: {why_nothing(scene, recording.p_WT_m)}"]
    found = []
    if not recording.a_m_s2.any():
        found.append(f"feel.wav is silent: {_why_silent(scene, recording)}")
    limited = int(np.count_nonzero(touching & (recording.flags & Flag.FORCE_LIMITED != 0)))
    if limited > LIMITED_SHARE * count:
        found.append(
            f"the force was cut to the device's limit in {limited:,} of {count:,} ticks in contact "
            f"({100 * limited / count:.0f} %): walls feel softer there than they are; press less deep, or choose a "
            "stronger device (--device)"
        )
    return found


def _why_silent(scene: "Scene", recording: Recording) -> str:
    touched = {recording.swatch_names[i] for i in np.unique(recording.swatch[recording.touching])}
    swatches = [swatch for swatch in scene.swatches if swatch.name in touched]
    if any(swatch.texture is not None or swatch.taps is not None for swatch in swatches):
        return f"the effects {', '.join(recording.effects)} make no vibration; lpc_texture and tap do (--effects)"
    return (
        f"no swatch that was touched ({', '.join(sorted(touched))}) has a texture or taps; paint one onto the scene, "
        "or choose one for the whole mesh, as --swatch wood; `hapscene swatch list` names them"
    )


def _give_cautions(
    scene: "Scene", recording: Recording, say: Callable[[str], None], caution: Callable[[str], None] | None
) -> None:
    for text in cautions(scene, recording):
        if caution is None:
            say(f"{text}\n")
        else:
            caution(text)


def why_nothing(scene: "Scene", p_WT: NDArray[np.float64]) -> str:
    """Why a path (n, 3) [m] touches nothing of a scene, and what to do: a sentence."""
    from hapscene.render.renderer import Renderer
    from hapscene.scene.mesh_report import length

    both_sides = copy(scene)
    both_sides.bodies = [replace(body, two_sided=True) for body in scene.bodies]
    met = Renderer(both_sides, effects=[]).run(p_WT)
    if met.touching.any():
        name = met.body_names[int(met.body[met.touching][0])]
        return (
            f"the path goes through {name!r} from behind its faces, which are felt from outside alone; feel both sides "
            '(--two-sided, or in a scene file "two_sided": true), or see what `hapscene check` says of the mesh'
        )
    gaps_m = {}
    for body in scene.bodies:
        p_BT = (p_WT - body.X_WB[:3, 3]) @ body.X_WB[:3, :3]
        low_m, high_m = body.mesh.bounds_m
        gaps_m[body.name] = float(np.linalg.norm(np.maximum(np.maximum(low_m - p_BT, p_BT - high_m), 0), axis=1).min())
    name = min(gaps_m, key=gaps_m.__getitem__)
    size = length(scene.body(name).mesh.diagonal_m)
    how_near = f"stays {length(gaps_m[name])} off the box around" if gaps_m[name] > 0 else "misses all faces of"
    return (
        f"the path {how_near} {name!r}, the nearest body, which is {size} across; are both in the same place, "
        "the path in m, the mesh in its right unit (--unit)?"
    )


def _counted(scene: "Scene") -> str:
    body_count = len(scene.bodies)
    face_count = sum(len(body.mesh.faces) for body in scene.bodies)
    return f"{body_count} {'body' if body_count == 1 else 'bodies'} of {face_count:,} faces"


def speak(text: str) -> None:
    """Progress to standard output at once, also through a pipe."""
    sys.stdout.write(text)
    sys.stdout.flush()
