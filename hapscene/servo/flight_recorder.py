"""The flight recorder: the servo's last minute, kept in its shared memory, written to a folder, and flown again.

What a tick gives follows from what it is given and from what it remembers. The ring holds the one; of the other the
loop keeps a copy every `CHECKPOINT_TICKS`, and after every order that changes what is felt. From such a copy on, the
recorded inputs run through the same tick: `replay` says whether it gives the same, to the bit.
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

from hapscene.confined import confined
from hapscene.device.model import Limits
from hapscene.errors import FormatError, HapsceneError, PathError
from hapscene.files import parse_format, read_bytes, refusing, whole_folder
from hapscene.number_files import open_npz
from hapscene.records import ROW, records
from hapscene.renderer import EFFECTS, Renderer
from hapscene.scene.scene import Scene, load_scene
from hapscene.servo.shared_memory import Channel
from hapscene.servo.tick_memory import remember
from hapscene.tick import run_ticks
from hapscene.twin.twin_recording import FELT

FORMAT: Final = "hapscene flight"
VERSION: Final = 1

SCENE_FILE: Final = "flown.scene.json"
NUMBERS_FILE: Final = "flight.npz"
STORY_FILE: Final = "flight.json"

ORDERS: Final = ("tune", "tune_field", "mute")
"""Orders that change what is felt and are kept."""

BYTES_MAX: Final = 1 << 30
"""Most that a flight may unpack to [bytes]: 20 minutes of one tool."""


@dataclass(frozen=True, eq=False)
class Flight:
    """What was felt over n ticks, and what is needed to feel it again.

    Attributes:
        reason: why it was written.
        first: number of the first tick.
        rows: (tools, n) ROW.
        felt: (tools, n) FELT: what the tick was given, and what was sent to the device.
        a_m_s2: (tools, n, block).
        memory: what the tick remembered at `memory_tick`; empty where no copy was kept since the scene last changed.
        memory_tick: number of the tick before which.
        made: how the renderer was made.
        tuned: what was tuned since the start: (order, swatch or effect, numbers).
        scene: what was touched.
    """

    reason: str
    first: int
    rows: Any
    felt: Any
    a_m_s2: NDArray[np.float64]
    memory: NDArray[np.uint8]
    memory_tick: int
    made: Mapping[str, Any]
    tuned: Sequence[Sequence[Any]]
    scene: Scene

    def __repr__(self) -> str:
        return f"<Flight: ticks {self.first:,} to {self.first + self.rows.shape[1] - 1:,}; {self.reason}>"

    def save(self, folder: str | Path) -> None:
        """Write it, whole or not at all: a scene, the numbers, and what happened.

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
            columns = {f"row_{name}": self.rows[name] for name in ROW.names or ()}
            columns |= {f"felt_{name}": self.felt[name] for name in FELT.names or ()}
            np.savez(part / NUMBERS_FILE, a_m_s2=self.a_m_s2, memory=self.memory, **columns)
            text = json.dumps(
                story, indent=2, default=lambda value: value.tolist()
            )  # settings may hold NumPy's numbers
            (part / STORY_FILE).write_text(text, encoding="utf-8")

    @classmethod
    def load(cls, folder: str | Path) -> "Flight":
        """Read what `save` wrote. Safe to call on a folder from anybody.

        Raises:
            HapsceneError: it is none, is broken, or of a later version.
        """
        folder = Path(folder)
        if not (folder / STORY_FILE).is_file():
            raise PathError(f"{folder}: no flight: expected a folder with {STORY_FILE}, as `hapscene play` writes it")
        with refusing(PathError, folder):
            story = parse_format(read_bytes(folder / STORY_FILE, 1 << 24, "a flight"), "a flight", FORMAT, VERSION)
            with open_npz(folder / NUMBERS_FILE, BYTES_MAX, "expected a shorter flight") as archive:
                a_m_s2, memory = archive.read("a_m_s2"), archive.read("memory")
                shape = a_m_s2.shape[:2]
                rows, felt = records(shape, ROW), records(shape, FELT)  # type: ignore[arg-type]
                for into, dtype, word in ((rows, ROW, "row"), (felt, FELT, "felt")):
                    for name in dtype.names or ():
                        if archive.header(f"{word}_{name}")[0][:2] != shape:
                            raise FormatError(f"array {word}_{name} is of another length")
                        into[name] = archive.read(f"{word}_{name}")
            tuned, made = story.get("tuned"), story.get("made")
            first, tick = story.get("first"), story.get("memory_tick")
            if not isinstance(tuned, list) or not isinstance(made, dict) or memory.dtype != np.uint8:
                raise FormatError(f"{STORY_FILE} is damaged")
            if not (isinstance(first, int) and isinstance(tick, int)):
                raise FormatError(f"{STORY_FILE}: 'first' and 'memory_tick' are numbers of ticks")
            if len(memory) and not 0 <= tick - first < shape[1]:
                raise FormatError(f"{STORY_FILE}: 'memory_tick' is none of these ticks")
        scene = load_scene(folder / SCENE_FILE, accept_changed=False)
        return cls(str(story.get("reason")), first, rows, felt, a_m_s2, memory, tick, made, tuned, scene)

    def replay(self) -> "Replay":
        """Run the recorded inputs through the tick again, each tool for itself.

        Raises:
            HapsceneError: nothing of it can be flown again.
        """
        if not len(self.memory):
            raise HapsceneError(
                "this flight holds no copy of what the tick remembered since the scene last changed, or bodies came, "
                "went, or moved: it can be looked at, not flown again"
            )
        start = self.memory_tick - self.first
        length = self.rows.shape[1] - start
        share = len(self.memory) // len(self.rows)
        unlike = np.zeros(length, np.bool_)
        none = np.zeros(0, np.int64)
        for tool, rows in enumerate(self.rows):
            renderer = _renderer(self.scene, self.made, tool)
            for order, name, numbers in self.tuned:
                getattr(renderer, order if order in ORDERS else "tune")(name, **numbers)
            remember(renderer.world, renderer.surface, self.memory[tool * share : (tool + 1) * share])
            again, a_m_s2 = records(length, ROW), np.zeros((length, renderer.block))
            path = np.ascontiguousarray(self.felt[tool]["read_W_m"][start:])
            run_ticks(renderer.world, renderer.surface, path, none, np.zeros((length, 0, 4, 4)), none, again, a_m_s2)
            for name in _GIVEN:
                same = again[name] == rows[name][start:]
                unlike |= ~same.reshape(length, -1).all(axis=1)
            unlike |= (a_m_s2 != self.a_m_s2[tool, start:]).any(axis=1)
        return Replay(self.memory_tick, length, np.flatnonzero(unlike) + self.memory_tick, self.reason)


_GIVEN: Final = ("p_WP_m", "nhat_W", "depth_m", "touching", "body", "face", "swatch", "slip_m_s", "f_W_N", "f_body_W_N")
"""What a tick gives that must come out the same."""


@dataclass(frozen=True, eq=False)
class Replay:
    """How a flight went when it was flown again.

    Attributes:
        first, count: the ticks that were.
        unlike: (m,) numbers of those that gave something else, in any bit.
        reason: why the flight was written.
    """

    first: int
    count: int
    unlike: NDArray[np.int64]
    reason: str = ""

    def __str__(self) -> str:
        told = f"{self.count:,} ticks, {self.first:,} to {self.first + self.count - 1:,}, flown again"
        if len(self.unlike) == 0:
            return f"{told}: the same to the bit"
        return f"{told}: {len(self.unlike):,} differ, the first of them {self.unlike[0]:,}"


def _renderer(scene: Scene, made: Mapping[str, Any], tool: int) -> Renderer:
    limits, known = made.get("limits"), {field.name for field in fields(Limits)}
    limits = limits[tool] if isinstance(limits, list) and tool < len(limits) else None
    if not (isinstance(limits, dict) and limits.keys() <= known):
        raise PathError(f"{STORY_FILE}: 'limits' are damaged")
    return Renderer(
        scene,
        made.get("effects") or EFFECTS,
        seed=made.get("seed", 0),
        tick_s=made["tick_s"],
        a_rate_Hz=made["a_rate_Hz"],
        limits=Limits(**limits),
        settings=made.get("settings"),
    )


def told_of(renderers: Sequence[Renderer], settings: Mapping[str, Any] | None) -> dict[str, Any]:
    """How the tools' renderers were made, as JSON has it, which has no infinite numbers: those are the defaults."""
    renderer = renderers[0]
    limits = [{name: value for name, value in asdict(one.limits).items() if value != float("inf")} for one in renderers]
    return {
        "effects": [effect.name for effect in renderer._effects],
        "seed": int(renderer.seed),
        "tick_s": renderer.tick_s,
        "a_rate_Hz": renderer.a_rate_Hz,
        "limits": limits,
        "settings": settings,
    }


def note_order(tuned: list[tuple[str, str, dict[str, Any]]], order: str, name: str, numbers: Mapping[str, Any]) -> None:
    """Note one of `ORDERS`; a slider that moves replaces what it said before, so that hours of it are one line."""
    if tuned and tuned[-1][:2] == (order, name) and tuned[-1][2].keys() == numbers.keys():
        tuned.pop()
    tuned.append((order, name, dict(numbers)))


def replay_flight(folder: str | Path) -> Replay:
    """Fly anybody's flight again: in a process of its own, since compiled code takes its memory as it is.

    Raises:
        HapsceneError: it is none, is damaged, or nothing of it can be flown again.
    """
    folder = Path(folder)
    if not (folder / STORY_FILE).is_file():
        raise PathError(f"{folder}: no flight: expected a folder with {STORY_FILE}, as `hapscene play` writes it")
    limits: Any = {"memory_B": MEMORY_MAX_B, "output_B": BYTES_MAX, "time_s": 600.0, "imports": [__name__]}
    with refusing(PathError, folder), (folder / STORY_FILE).open("rb") as file:
        told = confined(_fly_again, file, str(folder), by="The tick on a flight's memory", **limits).arrays
    first, length = told["ticks"].tolist()
    return Replay(first, length, told["unlike"], told["reason"].tobytes().decode(errors="replace"))


MEMORY_MAX_B: Final = 4_000_000_000
"""Most memory that flying again may take [bytes]: a large mesh, and what compiles."""

REASON_MAX: Final = 500
"""How much is told of why a stranger's flight was written [bytes]."""


def _fly_again(file: BinaryIO, folder: str) -> Mapping[str, NDArray[Any]]:
    """In the process."""
    try:
        replay = Flight.load(folder).replay()
    except FormatError:
        raise
    except HapsceneError as error:
        raise FormatError(str(error)) from None
    except (TypeError, ValueError, KeyError, AttributeError, IndexError) as error:
        raise FormatError(f"{STORY_FILE} is damaged: {type(error).__name__}: {error}"[:200]) from None
    reason = np.frombuffer(replay.reason.encode()[:REASON_MAX], np.uint8)
    return {"ticks": np.array([replay.first, replay.count]), "unlike": replay.unlike, "reason": reason}


def write_flight(flight: Flight, folder: str | Path) -> str:
    """Write a flight into a folder of its own in `folder`, named after the time; says where, or why not."""
    start = Path(folder) / time.strftime("%Y-%m-%d-%H%M%S")
    place = next(one for k in count(1) if not (one := start if k == 1 else Path(f"{start}-{k}")).exists())
    try:
        flight.save(place)
    except (OSError, HapsceneError) as error:  # a full disk must not end what goes on
        return f"the last minute could not be written: {error}"
    return f"the last minute is in {place}; `hapscene play --replay {place}` flies it again"


def flight_of(
    channel: Channel, scene: Scene, made: Mapping[str, Any], tuned: Sequence[Sequence[Any]], reason: str
) -> Flight:
    """What the shared memory holds of the last minute. The servo may go on meanwhile, or be dead."""
    row, length = channel.channel[0], channel.rows.shape[1]
    done = int(row.done)
    first = max(done - length, 0)
    slots = np.arange(first, done) % length
    taken = [ring[:, slots] for ring in (channel.rows, channel.felt, channel.a_m_s2)]
    over = max(int(row.done) + 1 - length - first, 0)  # written over meanwhile
    rows, felt, a_m_s2 = (part[:, over:].copy() for part in taken)
    first += over
    kept = [(int(tick), slot) for slot, tick in enumerate(channel.checkpoint_ticks)]
    good = [pair for pair in kept if max(first, int(row.changed)) <= pair[0] < done]
    tick, memory = -1, np.zeros(0, np.uint8)
    if good and row.moving_count == 0:
        tick, slot = min(good)
        memory = channel.checkpoints[slot, : int(row.checkpoint_size)].copy()
        if channel.checkpoint_ticks[slot] != tick:  # likewise
            tick, memory = -1, np.zeros(0, np.uint8)
    return Flight(reason, first, rows, felt, a_m_s2, memory, tick, made, tuned, scene)
