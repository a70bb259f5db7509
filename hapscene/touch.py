"""Touch a scene along a path, in open or closed loop; write numbers, plots, a picture and sound to a folder."""

import json
import platform
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

from hapscene.constants import ACCELERATION_RATE_HZ, SCENE_SUFFIXES, TICK_S
from hapscene.errors import SceneError, ViewError
from hapscene.flags import Flag
from hapscene.io.files import Json, whole_folder
from hapscene.render.recording import Recording

if TYPE_CHECKING:
    from hapscene.bridge import MuJoCo
    from hapscene.loop import ReferenceTrajectory, Twin
    from hapscene.scene.scene import Scene

__all__ = [
    "MADE",
    "cautions",
    "is_model",
    "open_model",
    "open_scene",
    "step",
    "summarise",
    "touch",
    "touch_by_hand",
    "why_nothing",
]


# --- output files ---


MADE: Final = ("touch.npz", "touch.csv", "summary.json", "plots.png", "scene.png", "feel.wav")
"""Files that `touch` writes."""

SUMMARY_VERSION: Final = 1

_PACKAGES: Final = ("hapscene", "embreex", "numba", "numpy", "scipy", "trimesh", "matplotlib", "pyrender2")


def summarise(recording: Recording, title: str, **more: Json) -> dict[str, Json]:
    """The content of summary.json: duration, contact, timing, flags and versions."""
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
    a_handle_m_s2: NDArray[np.float64] | None = None,
    dark: bool = False,
    **more: Json,
) -> dict[str, str]:
    """Write the files `MADE` to a folder; returns the missing files and the reasons.

    Args:
        scene, recording: touched scene, and recording of the touch.
        folder: existing folder.
        title: title of plots and summary.
        with_picture: draw scene.png.
        say: called with progress messages.
        a_handle_m_s2: (n, block) accelerations for feel.wav; None for the commanded ones.
        dark: use a dark background.
        more: further entries of the summary.
    """
    from hapscene.view.chart import save_chart
    from hapscene.view.palette import DARK, LIGHT, albedo_colours
    from hapscene.view.picture import write_picture
    from hapscene.view.plot import draw_plot
    from hapscene.view.sound import write_wave

    missing: dict[str, str] = {}
    with ThreadPoolExecutor(1) as executor:  # another process draws the picture meanwhile
        picture = None
        if with_picture:
            theme = DARK if dark else LIGHT
            picture = executor.submit(write_picture, scene, recording, folder / "scene.png", size=None, theme=theme)
        with step(say, "writing touch.npz, touch.csv, feel.wav"):
            recording.save(folder / "touch.npz")
            recording.save_csv(folder / "touch.csv")
            audible_m_s2 = recording.a_m_s2 if a_handle_m_s2 is None else a_handle_m_s2
            full_scale_m_s2 = write_wave(audible_m_s2.ravel(), recording.a_rate_Hz, folder / "feel.wav")
        with step(say, "plotting plots.png"):
            heading = f"{title}: {len(recording):,} ticks, {np.count_nonzero(recording.touching):,} in contact"
            figure = draw_plot(recording, heading, albedo_colours(scene.swatches))
            save_chart(figure, folder / "plots.png", dark=dark)
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
    """Print what is being done, and how long it took."""
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
"""Files that `touch_by_hand` writes."""


def open_scene(
    path: str | Path,
    unit: str | None = None,
    swatch: str | None = None,
    two_sided: bool = False,
    *,
    up: str | None = None,
    scale: float = 1.0,
) -> "Scene":
    """Load a scene file, a painted scene of another format, or a scene of one mesh.

    Args:
        path: scene file (.scene.json, .scene.zip), mesh file of any supported format, or MuJoCo model (.xml).
        unit: unit of the mesh, if its file has none.
        swatch: swatch for the whole mesh, which overrides the file: a name, or a .swatch file.
        two_sided: render contact from both sides of the faces.
        up, scale: up axis of the mesh file, and scale factor: see `hapscene.load_mesh`.

    Raises:
        HapsceneError: the file cannot be loaded, or an option does not apply to this type of file.
    """
    turned = ("--up", up), ("--scale", scale != 1.0)
    if str(path).endswith(SCENE_SUFFIXES):
        from hapscene.scene.scene import load_scene

        for option, value in (("--unit", unit), *turned, ("--swatch", swatch), ("--two-sided", two_sided)):
            if value:
                raise SceneError(
                    f"{path}: {option} does not apply to a scene file, which contains this setting: omit it"
                )
        return load_scene(path)
    if is_model(path):
        for option, value in turned:
            if value:
                raise SceneError(
                    f"{path}: {option} does not apply to a MuJoCo model, which is in metres and z up: omit it"
                )
        return open_model(path, unit, swatch, two_sided).scene
    from hapscene.exchange import painted_scene
    from hapscene.scene.scene import Scene

    scene = None if swatch or two_sided else painted_scene(path, unit, up=up, scale=scale)
    if scene is None:
        scene = Scene()
        mesh = scene.mesh_of(path, unit, up=up, scale=scale)
        scene.add(mesh, swatch=swatch, two_sided=two_sided)
    return scene


MODELS: Final = (".xml", ".mjcf", ".urdf")
"""Suffixes of MuJoCo models."""


def is_model(path: str | Path) -> bool:
    """Whether a file is a MuJoCo model, by its suffix."""
    return str(path).lower().endswith(MODELS)


def open_model(
    path: str | Path, unit: str | None = None, swatch: str | None = None, two_sided: bool = False
) -> "MuJoCo":
    """Load a MuJoCo model, with one swatch for all bodies if given.

    Raises:
        SceneError: MuJoCo is missing or rejects the model, or an option does not apply to a model.
    """
    from hapscene.bridge import load_mujoco

    for option, value in (("--unit", unit), ("--two-sided", two_sided)):
        if value:
            raise SceneError(
                f"{path}: {option} does not apply to a MuJoCo model, which is in metres and one-sided: omit it"
            )
    return load_mujoco(path, swatch)


def touch(
    scene: "Scene",
    out: str | Path,
    p_WT: NDArray[np.float64],
    *,
    t_s: NDArray[np.float64] | None = None,
    tick_s: float = TICK_S,
    a_rate_Hz: float = ACCELERATION_RATE_HZ,
    title: str = "",
    with_picture: bool = True,
    dark: bool = False,
    say: Callable[[str], None] = lambda text: None,
    caution: Callable[[str], None] | None = None,
    bridge: "MuJoCo | None" = None,
    **how: Any,
) -> list[Path]:
    """Touch a scene along a path and write the files `MADE` to a folder; if it fails, nothing is written.

    Args:
        scene: scene to touch.
        out: output folder; other files in it are kept.
        p_WT: (n, 3) path of the tool, one row per tick [m].
        t_s: (n,) times of the ticks [s]; None to start at 0.
        tick_s: period of a tick [s].
        a_rate_Hz: sample rate of the acceleration channel [Hz].
        title: name of the scene in plots and summary.
        with_picture: draw scene.png. If it cannot be drawn, `say` is called with the reason.
        dark: use a dark background in pictures.
        say: called with progress messages.
        caution: called with each of `cautions`; None for `say`.
        bridge: MuJoCo model of the scene, which is simulated meanwhile; pictures show its initial state.
        how: further arguments of `Renderer`.

    Returns:
        The files written.

    Raises:
        HapsceneError: an effect is unknown, a rate is invalid, or the path is not finite.
        OSError: the folder cannot be written.
    """
    from hapscene.render.renderer import Renderer

    with whole_folder(out, ours=MADE) as folder:
        with step(say, f"preparing {_describe_size(scene)}"):
            renderer = Renderer(scene, tick_s=tick_s, a_rate_Hz=a_rate_Hz, **how)
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
    **more: Json,
) -> list[Path]:
    """Touch a scene in closed loop with a simulated hand and device; write the files `MADE_BY_HAND`, or nothing.

    Args:
        scene, out, title, with_picture, dark, say, caution, bridge: see `touch`.
        intent: reference trajectory of the hand.
        ready: makes the simulated twin.
        more: further entries of `hand` in the summary.

    Returns:
        The files written.

    Raises:
        HapsceneError: the twin cannot be made or run.
        OSError: the folder cannot be written.
    """
    from hapscene.loop.result import summarise_result
    from hapscene.view.chart import save_chart
    from hapscene.view.plot import draw_hand_plot

    with whole_folder(out, ours=MADE_BY_HAND) as folder:
        with step(say, f"preparing {_describe_size(scene)}"):
            twin = ready()
        with step(say, f"simulating {len(intent) * twin.renderer.tick_s:.1f} s"):
            result = twin.run(intent) if bridge is None else bridge.run_twin(twin, intent)
        _give_cautions(scene, result.recording, say, caution)
        hand = {**more, **summarise_result(result)}
        missing = write_touch(
            scene, result.recording, folder, title, with_picture, say, result.a_handle_m_s2, dark, hand=hand
        )
        with step(say, "writing hand.npz, hand.png"):
            result.save(folder / "hand.npz")
            save_chart(draw_hand_plot(result, title), folder / "hand.png", dark=dark)
    return _made(out, MADE_BY_HAND, missing, say)


def _made(out: str | Path, names: Sequence[str], missing: Mapping[str, str], say: Callable[[str], None]) -> list[Path]:
    """The files that were written; prints the reasons for missing ones."""
    for name, reason in missing.items():
        say(f"without {name}: {reason}\n")
    return [file for name in names if (file := Path(out) / name).exists()]


LIMITED_SHARE: Final = 0.05
"""Fraction of the ticks in contact with limited force above which a caution is given [1]."""


def cautions(scene: "Scene", recording: Recording) -> list[str]:
    """Reasons why a touch may not be as intended: no contact, no sound, or a limited force."""
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
            f"the force was limited to the device's maximum in {limited:,} of {count:,} ticks in contact "
            f"({100 * limited / count:.0f} %), where surfaces feel too soft: reduce the depth, or choose a stronger "
            "device (--device)"
        )
    return found


def _why_silent(scene: "Scene", recording: Recording) -> str:
    touched = {recording.swatch_names[i] for i in np.unique(recording.swatch[recording.touching])}
    swatches = [swatch for swatch in scene.swatches if swatch.name in touched]
    if any(swatch.texture is not None or swatch.taps is not None for swatch in swatches):
        effects = ", ".join(recording.effects)
        return f"the effects {effects} produce no vibration: add lpc_texture or tap (--effects)"
    return (
        f"no touched swatch ({', '.join(sorted(touched))}) has a texture or taps: paint another swatch onto the scene, "
        "or choose one for the whole mesh, such as --swatch wood (`hapscene swatch list`)"
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
    """Why a path (n, 3) [m] has no contact with a scene, and what to do."""
    from hapscene.render.renderer import Renderer
    from hapscene.scene.mesh_doctor import length

    both_sides = copy(scene)
    both_sides.bodies = [replace(body, two_sided=True) for body in scene.bodies]
    met = Renderer(both_sides, effects=[]).run(p_WT)
    if met.touching.any():
        name = met.body_names[int(met.body[met.touching][0])]
        return (
            f"the path crosses {name!r} from behind its faces, which have contact from outside only: make the body "
            'two-sided (--two-sided, or "two_sided": true in the scene file), or run `hapscene check`'
        )
    gaps_m = {}
    for body in scene.bodies:
        p_BT = (p_WT - body.X_WB[:3, 3]) @ body.X_WB[:3, :3]
        low_m, high_m = body.mesh.bounds_m
        gaps_m[body.name] = float(np.linalg.norm(np.maximum(np.maximum(low_m - p_BT, p_BT - high_m), 0), axis=1).min())
    name = min(gaps_m, key=gaps_m.__getitem__)
    size = length(scene.body(name).mesh.diagonal_m)
    distance = (
        f"stays {length(gaps_m[name])} away from the bounding box of" if gaps_m[name] > 0 else "misses all faces of"
    )
    return (
        f"the path {distance} the nearest body {name!r} of size {size}: check the position and unit (m) of the "
        "path, and the unit of the mesh (--unit)"
    )


def _describe_size(scene: "Scene") -> str:
    body_count = len(scene.bodies)
    face_count = sum(len(body.mesh.faces) for body in scene.bodies)
    return f"{body_count} {'body' if body_count == 1 else 'bodies'} of {face_count:,} faces"
