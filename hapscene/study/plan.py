"""The plan of a study: a TOML file that lists the stimuli, the questions and their repetitions.

The annotations are the schema; for numbers they state the range, for texts and lists the length.
"""

import hashlib
import tomllib
from importlib.resources import as_file
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import msgspec
import numpy as np
from msgspec import Meta
from msgspec.structs import replace

from hapscene.errors import HapsceneError, StudyError, no_such
from hapscene.io.files import naming, read_bytes, refusing

__all__ = [
    "Block",
    "ChoiceBlock",
    "Plan",
    "RatingBlock",
    "StaircaseBlock",
    "Stimulus",
    "check_name",
    "load_plan",
    "parse_plan",
    "stimuli_sha256",
]

PLAN_MAX_B: Final = 1 << 20
"""Largest plan file [bytes]."""

TRIALS_MAX: Final = 10_000
"""Most trials per participant [count]."""

_NAME_PATTERN: Final = "^(?!(?i:na|nan|null|none|t|f|true|false|inf|infinity)$)[A-Za-z][A-Za-z0-9_-]{0,63}$"
"""A letter, then letters, digits, - and _; no word that pandas or R reads as missing, logical or a number."""

_Name = Annotated[str, Meta(pattern=_NAME_PATTERN)]
_Question = Annotated[str, Meta(min_length=1, max_length=500)]
_Text = Annotated[str, Meta(max_length=20_000)]
_Repeats = Annotated[int, Meta(ge=1, le=1000)]


class Stimulus(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The content of an interval: a swatch, a recording, or a swatch at the force and speed of a recording."""

    name: str = ""
    swatch: str = ""
    recording: str = ""
    rate_Hz: Annotated[float, Meta(ge=0.0, le=1e6)] = 0.0
    """Sample rate of the recording; 0 if the file stores it."""
    units: dict[str, str] = {}
    columns: dict[str, str] = {}
    """Unit and column of each quantity of the recording that its file does not store."""
    force_N: Annotated[float, Meta(ge=0.0, le=100.0)] = 1.0
    speed_m_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.1
    seconds: Annotated[float, Meta(ge=0.05, le=60.0)] = 1.5
    life: bool = True
    """Whether the amplitude modulation of the texture is played."""
    gain_dB: Annotated[float, Meta(ge=-120.0, le=40.0)] = 0.0
    compensator: str = ""


class Block(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="block"):
    """A sequence of trials of one kind."""

    name: _Name
    question: _Question = "Which of the two is stronger?"

    @property
    def kind(self) -> str:
        """rating, 2ifc or staircase."""
        return str(self.__struct_config__.tag)

    @property
    def trial_count(self) -> int:
        """Number of trials of the block."""
        raise NotImplementedError

    @property
    def used(self) -> tuple[str, ...]:
        """Names of the stimuli that the block plays."""
        raise NotImplementedError


class RatingBlock(Block, frozen=True, kw_only=True, tag="rating"):
    """Rating of each stimulus on a scale."""

    question: _Question = "How real does it feel?"
    stimuli: Annotated[tuple[_Name, ...], Meta(min_length=1, max_length=100)]
    repeats: _Repeats = 1
    scale: tuple[Annotated[int, Meta(ge=-100, le=100)], Annotated[int, Meta(ge=-100, le=100)]] = (1, 7)
    """Lowest and highest value."""
    labels: tuple[str, str] | None = None
    """Meaning of the ends of the scale."""
    margin: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.0
    """Largest difference of ratings that counts as equivalent; 0 disables the test."""

    trial_count = property(lambda self: self.repeats * len(self.stimuli))
    used = property(lambda self: self.stimuli)


class ChoiceBlock(Block, frozen=True, kw_only=True, tag="2ifc"):
    """Two-interval forced choice between the stimuli of a pair."""

    pairs: Annotated[tuple[tuple[_Name, _Name], ...], Meta(min_length=1, max_length=100)]
    """Pairs to compare; the first of the two is the correct answer."""
    repeats: _Repeats = 1
    margin: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.0
    """Largest d′ that counts as equivalent; 0 disables the test."""

    trial_count = property(lambda self: self.repeats * len(self.pairs))
    used = property(lambda self: tuple(name for pair in self.pairs for name in pair))


class StaircaseBlock(Block, frozen=True, kw_only=True, tag="staircase"):
    """Adaptive threshold of one parameter of a stimulus, by forced choice between a level and the reference."""

    stimulus: _Name
    parameter: Literal["force_N", "speed_m_s", "seconds", "gain_dB"]
    reference: float = 0.0
    """Value of the parameter in the other interval."""
    levels: tuple[float, float, Annotated[int, Meta(ge=2, le=200)]]
    """Smallest and largest distance above the reference, and the number of levels."""
    trials: Annotated[int, Meta(ge=5, le=1000)] = 40

    trial_count = property(lambda self: self.trials)
    used = property(lambda self: (self.stimulus,))

    @property
    def distances(self) -> tuple[float, ...]:
        """The levels as distances from the reference, ascending in equal ratios."""
        return tuple(np.geomspace(*self.levels).tolist())

    def varied(self, stimulus: Stimulus, distance: float) -> Stimulus:
        """The stimulus at a distance from the reference."""
        changed: dict[str, Any] = {self.parameter: self.reference + distance}
        return replace(stimulus, **changed)


class Plan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The checked content of a plan file."""

    title: Annotated[str, Meta(min_length=1, max_length=200)]
    channel: Literal["headphones", "handle"] = "headphones"
    seed: Annotated[int, Meta(ge=0, lt=2**31)] = 0
    people: Annotated[int, Meta(ge=1, le=10_000)]
    """Planned number of participants."""
    consent: _Text = ""
    """Text that a participant agrees to before the first trial."""
    instructions: _Text = ""
    """Text shown before the first trial."""
    stimuli: Annotated[dict[_Name, Stimulus], Meta(min_length=1, max_length=1000)]
    blocks: Annotated[tuple[RatingBlock | ChoiceBlock | StaircaseBlock, ...], Meta(min_length=1, max_length=100)]
    content: bytes = b""
    """Content of the file."""
    folder: str = "."
    """Folder of the file; paths in the plan are relative to it."""

    @property
    def sha256(self) -> str:
        """SHA-256 of the file, hexadecimal."""
        return hashlib.sha256(self.content).hexdigest()

    @property
    def trial_count(self) -> int:
        """Number of trials per participant."""
        return sum(block.trial_count for block in self.blocks)


def load_plan(path: str | Path) -> Plan:
    """Read a plan from a TOML file; docs/how-to/run-a-study.md describes the keys.

    Raises:
        StudyError: the file is missing or invalid TOML, or a key is unknown, missing or out of range.
    """
    path = Path(path)
    with refusing(StudyError), naming(path):
        return parse_plan(read_bytes(path, PLAN_MAX_B, "plan of a study"), folder=path.absolute().parent)


def parse_plan(content: str | bytes, *, folder: str | Path = ".") -> Plan:
    """Read a plan from TOML text.

    Args:
        content: the text.
        folder: folder to which paths in the plan are relative.

    Raises:
        StudyError: as for `load_plan`.
    """
    content = content.encode() if isinstance(content, str) else content
    try:
        plan = msgspec.convert(tomllib.loads(content.decode("utf-8-sig")), Plan)
    except msgspec.ValidationError as error:
        raise StudyError(f"invalid plan: {error}") from None
    except (ValueError, RecursionError) as error:  # ValueError: also for a number of more than 4300 digits
        raise StudyError(f"invalid TOML: {str(error).partition('; use sys.')[0]}") from None
    stimuli = {name: replace(stimulus, name=name) for name, stimulus in plan.stimuli.items()}
    for stimulus in stimuli.values():
        if not (stimulus.swatch or stimulus.recording):
            raise StudyError(f'stimuli.{stimulus.name}: expected swatch = "NAME", recording = "FILE", or both')
    for number, block in enumerate(plan.blocks):
        _check_block(f"blocks[{number}]", block, stimuli)
    names = [block.name for block in plan.blocks]
    if double := next((name for name in names if names.count(name) > 1), None):
        raise StudyError(f"blocks: the name {double!r} is used twice; expected unique names")
    if plan.trial_count > TRIALS_MAX:
        raise StudyError(f"blocks: {plan.trial_count} trials per participant; expected at most {TRIALS_MAX}")
    return replace(plan, stimuli=stimuli, content=content, folder=str(folder))


def _check_block(where: str, block: Block, stimuli: dict[str, Stimulus]) -> None:
    """Check what the schema cannot express."""
    for name in block.used:
        if name not in stimuli:
            raise StudyError(f"{where}: {no_such('stimulus', name, stimuli)}")
    if isinstance(block, RatingBlock):
        if len(set(block.stimuli)) < len(block.stimuli):
            raise StudyError(f"{where}.stimuli has a name twice; to present each stimulus twice, use repeats = 2")
        if not block.scale[0] < block.scale[1] <= block.scale[0] + 20:
            raise StudyError(f"{where}.scale is {list(block.scale)}; expected [lowest, highest] with 2 to 21 steps")
    if isinstance(block, ChoiceBlock) and (same := next((a for a, b in block.pairs if a == b), None)):
        raise StudyError(f"{where}.pairs has a pair of {same!r} and {same!r}; expected two different stimuli")
    if isinstance(block, StaircaseBlock):
        stimulus = stimuli[block.stimulus]
        if not 1e-12 <= block.levels[0] < block.levels[1] <= 1e6:
            raise StudyError(f"{where}.levels is {list(block.levels)}; expected [lowest, highest, count], 0 < lowest")
        if block.parameter in ("force_N", "speed_m_s") and stimulus.recording:
            raise StudyError(f"{where}.parameter: {block.parameter} has no effect on a stimulus with a recording")
        for level in (0.0, block.levels[1]):
            try:
                msgspec.convert(msgspec.to_builtins(block.varied(stimulus, level)), Stimulus)
            except msgspec.ValidationError as error:
                raise StudyError(f"{where}: level {level:g}: {error}") from None


def check_name(where: str, value: str) -> str:
    """Check a name that is written to the results file, and return it. Raises StudyError: an invalid name."""
    try:
        return msgspec.convert(value, _Name)
    except msgspec.ValidationError:
        expected = "a letter, then up to 63 letters, digits, - and _"
        raise StudyError(f"{where}: invalid name {value[:60]!r}; expected {expected}") from None


def stimuli_sha256(plan: Plan) -> str | None:
    """SHA-256 over the files of the stimuli, in the order of the plan; None if one cannot be read."""
    from hapscene.swatches.library import swatch_place

    digest, folder = hashlib.sha256(), Path(plan.folder)
    for stimulus in plan.stimuli.values():
        places: list[Any] = [folder / stimulus.recording] if stimulus.recording else []
        try:
            if swatch := stimulus.swatch:
                places.append(folder / swatch if swatch.endswith(".swatch") else swatch_place(swatch))
            for place in places:
                with as_file(place) as path:
                    digest.update(hashlib.sha256(path.read_bytes()).digest())
        except (OSError, ValueError, HapsceneError):
            return None
    return digest.hexdigest()
