"""The session log (black box): the last seconds of a servo, kept in shared memory, written to a folder, and replayed.

The output of a tick follows from its input and its state. Ring buffers hold the inputs. The loop copies the state to a
checkpoint every `CHECKPOINT_TICKS`, and after every order that changes the scene or its parameters. `replay` restores a
checkpoint, runs the recorded inputs through the same tick, and reports whether the output is the same to the bit.
"""

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from itertools import count
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.device.model import Limits
from hapscene.errors import FormatError, HapsceneError, PathError
from hapscene.io.confined import confined
from hapscene.io.files import Json, parse_format, read_bytes, refusing, whole_folder
from hapscene.io.number_files import open_npz
from hapscene.loop.checkpoint import restore_checkpoint
from hapscene.loop.result import LOOP_ROW
from hapscene.loop.shared_memory import Channel
from hapscene.records import ROW, Records, records
from hapscene.render.renderer import EFFECTS, Renderer
from hapscene.render.tick import run_ticks
from hapscene.scene.scene import Scene, load_scene

__all__ = ["Replay", "SessionLog", "log_of", "note_order", "replay_log", "settings_of", "write_log"]

FORMAT: Final = "hapscene flight"
VERSION: Final = 1

SCENE_FILE: Final = "flown.scene.json"
NUMBERS_FILE: Final = "flight.npz"
STORY_FILE: Final = "flight.json"

ORDERS: Final = ("tune", "tune_field", "mute")
"""Orders that change parameters and are kept in a log."""

BYTES_MAX: Final = 1 << 30
"""Largest uncompressed size of a log [bytes]: 20 minutes of one tool."""


@dataclass(frozen=True, eq=False)
class SessionLog:
    """n recorded ticks, and what is needed to replay them.

    Attributes:
        reason: why the log was written.
        first: number of the first tick.
        rows: (tools, n) ROW.
        loop_rows: (tools, n) LOOP_ROW: input of the tick and force sent to the device.
        a_m_s2: (tools, n, block) acceleration samples.
        memory: checkpoint before tick `memory_tick`; empty if there is no checkpoint since the scene last changed.
        memory_tick: number of that tick.
        made: arguments of the renderer.
        tuned: orders since the start: (order, swatch or effect, parameters).
        scene: the scene.
    """

    reason: str
    first: int
    rows: Records
    loop_rows: Records
    a_m_s2: NDArray[np.float64]
    memory: NDArray[np.uint8]
    memory_tick: int
    made: Mapping[str, Json]
    tuned: Sequence[Sequence[Json]]
    scene: Scene

    def __repr__(self) -> str:
        return f"<SessionLog: ticks {self.first:,} to {self.first + self.rows.shape[1] - 1:,}; {self.reason}>"

    def save(self, folder: str | Path) -> None:
        """Write the scene, the arrays and the reason to a folder, atomically.

        Raises:
            OSError, HapsceneError: the folder cannot be written.
        """
        story = {
            "format": FORMAT,
            "version": VERSION,
            "reason": self.reason,
            "first": self.first,
            "memory_tick": self.memory_tick,
            "made": dict(self.made),
            "tuned": [list(one) for one in self.tuned],
        }
        with whole_folder(folder) as part:
            self.scene.save(part / SCENE_FILE)
            columns: dict[str, Any] = {f"row_{name}": self.rows[name] for name in ROW.names or ()}
            columns |= {f"felt_{name}": self.loop_rows[name] for name in LOOP_ROW.names or ()}
            np.savez(part / NUMBERS_FILE, a_m_s2=self.a_m_s2, memory=self.memory, **columns)
            # settings may hold numbers of NumPy
            text = json.dumps(story, indent=2, default=lambda value: value.tolist())
            (part / STORY_FILE).write_text(text, encoding="utf-8")

    @classmethod
    def load(cls, folder: str | Path) -> "SessionLog":
        """Read a log that `save` wrote. Safe for folders from untrusted sources.

        Raises:
            HapsceneError: the folder is not a log, is damaged, or has a later version.
        """
        folder = Path(folder)
        _require_log(folder)
        with refusing(PathError, folder):
            story = parse_format(
                read_bytes(folder / STORY_FILE, 1 << 24, "a session log"), "a session log", FORMAT, VERSION
            )
            with open_npz(folder / NUMBERS_FILE, BYTES_MAX, "expected a shorter log") as archive:
                a_m_s2, memory = archive.read("a_m_s2"), archive.read("memory")
                shape = a_m_s2.shape[:2]
                rows, loop_rows = records(shape, ROW), records(shape, LOOP_ROW)  # type: ignore[arg-type]
                for into, dtype, prefix in ((rows, ROW, "row"), (loop_rows, LOOP_ROW, "felt")):
                    for name in dtype.names or ():
                        stored = f"{prefix}_{name}"
                        if name == "p_WC_m" and stored not in archive.names:  # an older log, of a point
                            stored = "row_p_WP_m"
                        if name == "R_WT" and stored not in archive.names:  # an older log
                            continue
                        length = archive.header(stored)[0][:2]
                        if length != shape:
                            raise FormatError(f"array {stored} has shape {length}, expected {shape}")
                        into[name] = archive.read(stored)
            tuned, made = story.get("tuned"), story.get("made")
            first, tick = story.get("first"), story.get("memory_tick")
            if not isinstance(tuned, list) or not isinstance(made, dict) or memory.dtype != np.uint8:
                raise FormatError(f"{STORY_FILE}: 'tuned' must be a list, 'made' a mapping, memory an array of bytes")
            if not (isinstance(first, int) and isinstance(tick, int)):
                raise FormatError(f"{STORY_FILE}: 'first' and 'memory_tick' must be integers, numbers of ticks")
            if len(memory) and not 0 <= tick - first < shape[1]:
                raise FormatError(f"{STORY_FILE}: 'memory_tick' is {tick}, outside the ticks of the log")
        scene = load_scene(folder / SCENE_FILE, accept_changed=False)
        return cls(str(story.get("reason")), first, rows, loop_rows, a_m_s2, memory, tick, made, tuned, scene)

    def replay(self) -> "Replay":
        """Run the recorded inputs through the tick again, each tool separately.

        Raises:
            HapsceneError: the log has no checkpoint to replay from.
        """
        if not len(self.memory):
            raise HapsceneError(
                "this log can be read but not replayed: it has no checkpoint since the scene last changed, or bodies "
                "were added, removed or moved"
            )
        start = self.memory_tick - self.first
        length = self.rows.shape[1] - start
        share = len(self.memory) // len(self.rows)
        differs = np.zeros(length, np.bool_)
        none = np.zeros(0, np.int64)
        for tool, rows in enumerate(self.rows):
            renderer = _renderer(self.scene, self.made, tool)
            for order, name, numbers in self.tuned:
                getattr(renderer, order if order in ORDERS else "tune")(name, **numbers)
            restore_checkpoint(renderer.world, renderer.surface, self.memory[tool * share : (tool + 1) * share])
            again, a_m_s2 = records(length, ROW), np.zeros((length, renderer.block))
            given = self.loop_rows[tool][start:]
            path, R_WT, still = np.ascontiguousarray(given["read_W_m"]), given["R_WT"], np.zeros((length, 0, 4, 4))
            parts = [slice(k, k + 1) for k in range(length)] if R_WT.any() else [slice(None)]
            for k in parts:
                if R_WT.any():
                    renderer.surface.touch["R_WT"] = R_WT[k]
                rows_k = again[k].view(np.recarray)
                run_ticks(renderer.world, renderer.surface, path[k], none, still[k], none, rows_k, a_m_s2[k])
            for name in _OUTPUTS:
                same = again[name] == rows[name][start:]
                differs |= ~same.reshape(length, -1).all(axis=1)
            differs |= (a_m_s2 != self.a_m_s2[tool, start:]).any(axis=1)
        return Replay(self.memory_tick, length, np.flatnonzero(differs) + self.memory_tick, self.reason)


_OUTPUTS: Final = (
    "p_WP_m",
    "nhat_W",
    "depth_m",
    "touching",
    "body",
    "face",
    "swatch",
    "slip_m_s",
    "f_W_N",
    "f_body_W_N",
)
"""Outputs of a tick that a replay compares."""


@dataclass(frozen=True, eq=False)
class Replay:
    """Result of a replay.

    Attributes:
        first, count: the replayed ticks.
        unlike: (m,) numbers of the ticks whose output differs in any bit.
        reason: why the log was written.
    """

    first: int
    count: int
    unlike: NDArray[np.int64]
    reason: str = ""

    def __str__(self) -> str:
        ticks = f"{self.count:,} ticks, {self.first:,} to {self.first + self.count - 1:,}, replayed"
        if len(self.unlike) == 0:
            return f"{ticks}: the same to the bit"
        return f"{ticks}: {len(self.unlike):,} differ, the first at tick {self.unlike[0]:,}"


def _require_log(folder: Path) -> None:
    """Raise `PathError` if a folder is not a session log."""
    if not (folder / STORY_FILE).is_file():
        raise PathError(f"{folder}: not a session log; expected a folder with {STORY_FILE}, written by `hapscene play`")


def _renderer(scene: Scene, made: Mapping[str, Json], tool: int) -> Renderer:
    limits, known = made.get("limits"), {field.name for field in fields(Limits)}
    limits = limits[tool] if isinstance(limits, list) and tool < len(limits) else None
    if not (isinstance(limits, dict) and limits.keys() <= known):
        raise PathError(f"{STORY_FILE}: 'limits' must list the limits of each tool")
    return Renderer(
        scene,
        made.get("effects") or EFFECTS,
        seed=made.get("seed", 0),
        tick_s=made["tick_s"],
        a_rate_Hz=made["a_rate_Hz"],
        limits=Limits(**limits),
        settings=made.get("settings"),
        tip_radius_m=made.get("tip_radius_m", 0.0),
    )


def settings_of(renderers: Sequence[Renderer], settings: Mapping[str, Json] | None) -> dict[str, Json]:
    """Return the arguments of the renderers for JSON. Infinite limits, which JSON lacks, are defaults and omitted."""
    renderer = renderers[0]
    limits = [{name: value for name, value in asdict(one.limits).items() if value != float("inf")} for one in renderers]
    return {
        "effects": [effect.name for effect in renderer._effects],
        "seed": int(renderer.seed),
        "tick_s": renderer.tick_s,
        "a_rate_Hz": renderer.a_rate_Hz,
        "limits": limits,
        "settings": settings,
        "tip_radius_m": renderer.tip_radius_m,
    }


def note_order(tuned: list[tuple[str, str, dict[str, float]]], order: str, name: str, given: dict[str, float]) -> None:
    """Append one of `ORDERS`. Repeated changes of the same parameters, as by a slider, replace the last entry."""
    if tuned and tuned[-1][:2] == (order, name) and tuned[-1][2].keys() == given.keys():
        tuned.pop()
    tuned.append((order, name, dict(given)))


def replay_log(folder: str | Path) -> Replay:
    """Replay a log from an untrusted source in a separate process, because compiled code does not check its memory.

    Raises:
        HapsceneError: the folder is not a log, is damaged, or has no checkpoint.
    """
    folder = Path(folder)
    _require_log(folder)
    limits: Any = {"memory_B": MEMORY_MAX_B, "output_B": BYTES_MAX, "time_s": 600.0, "imports": [__name__]}
    with refusing(PathError, folder), (folder / STORY_FILE).open("rb") as file:
        found = confined(_replay_in_process, file, str(folder), by="The replay of the log", **limits).arrays
    first, length = found["ticks"].tolist()
    return Replay(first, length, found["unlike"].astype(np.int64), found["reason"].tobytes().decode(errors="replace"))


MEMORY_MAX_B: Final = 4_000_000_000
"""Most memory that a replay may use [bytes]: a large mesh and the compiler."""

REASON_MAX: Final = 500
"""Longest reason that is read from a log of an untrusted source [bytes]."""


def _replay_in_process(file: BinaryIO, folder: str) -> Mapping[str, NDArray[np.generic]]:
    """Replay a log in the separate process."""
    try:
        replay = SessionLog.load(folder).replay()
    except FormatError:
        raise
    except HapsceneError as error:
        raise FormatError(str(error)) from None
    except (TypeError, ValueError, KeyError, AttributeError, IndexError) as error:
        raise FormatError(f"{STORY_FILE} cannot be used: {type(error).__name__}: {error}"[:200]) from None
    reason = np.frombuffer(replay.reason.encode()[:REASON_MAX], np.uint8)
    return {"ticks": np.array([replay.first, replay.count]), "unlike": replay.unlike, "reason": reason}


def write_log(log: SessionLog, folder: str | Path) -> str:
    """Write a log to a new folder in `folder`, named after the time; return a message with its path or the error."""
    start = Path(folder) / time.strftime("%Y-%m-%d-%H%M%S")
    place = next(one for k in count(1) if not (one := start if k == 1 else Path(f"{start}-{k}")).exists())
    try:
        log.save(place)
    except (OSError, HapsceneError) as error:  # a full disk must not end the servo
        return f"the session log could not be written: {error}"
    return f"session log written to {place}; replay it with `hapscene play --replay {place}`"


def log_of(
    channel: Channel, scene: Scene, made: Mapping[str, Json], tuned: Sequence[Sequence[Json]], reason: str
) -> SessionLog:
    """Return the log of the ticks in shared memory. The servo may be running, or have ended."""
    row, length = channel.channel[0], channel.rows.shape[1]
    done = int(row.done)
    first = max(done - length, 0)
    slots = np.arange(first, done) % length
    taken: list[Any] = [ring[:, slots] for ring in (channel.rows, channel.loop_rows, channel.a_m_s2)]
    over = max(int(row.done) + 1 - length - first, 0)  # ticks that the servo has overwritten meanwhile
    rows, loop_rows, a_m_s2 = (part[:, over:].copy() for part in taken)
    first += over
    kept = [(int(tick), slot) for slot, tick in enumerate(channel.checkpoint_ticks)]
    good = [pair for pair in kept if max(first, int(row.changed)) <= pair[0] < done]
    tick, memory = -1, np.zeros(0, np.uint8)
    if good and row.moving_count == 0:
        tick, slot = min(good)
        memory = channel.checkpoints[slot, : int(row.checkpoint_size)].copy()
        if channel.checkpoint_ticks[slot] != tick:  # overwritten meanwhile
            tick, memory = -1, np.zeros(0, np.uint8)
    return SessionLog(reason, first, rows, loop_rows, a_m_s2, memory, tick, made, tuned, scene)
