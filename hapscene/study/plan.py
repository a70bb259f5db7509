"""The plan of a study: a TOML file that lists the stimuli, the questions and how often each is asked.

The annotations are the schema: of a number they give its range, of a text or list its length.
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
"""Largest plan [bytes]."""

TRIALS_MAX: Final = 10_000
"""Most trials of a participant [count]."""

_NAME_PATTERN: Final = "^(?!(?i:na|nan|null|none|t|f|true|false|inf|infinity)$)[A-Za-z][A-Za-z0-9_-]{0,63}$"
"""A letter, then letters, digits, - and _; not what pandas or R would read as missing, logical or a number."""

_Name = Annotated[str, Meta(pattern=_NAME_PATTERN)]
_Question = Annotated[str, Meta(min_length=1, max_length=500)]
_Text = Annotated[str, Meta(max_length=20_000)]
_Repeats = Annotated[int, Meta(ge=1, le=1000)]


class Stimulus(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What an interval plays: a swatch, a recording, or a swatch along the force and speed of a recording."""

    name: str = ""
    swatch: str = ""
    recording: str = ""
    rate_Hz: Annotated[float, Meta(ge=0.0, le=1e6)] = 0.0
    """Sample rate of the recording; 0: its file has it."""
    units: dict[str, str] = {}
    columns: dict[str, str] = {}
    """Unit and column of each quantity of the recording, where its file does not have them."""
    force_N: Annotated[float, Meta(ge=0.0, le=100.0)] = 1.0
    speed_m_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.1
    seconds: Annotated[float, Meta(ge=0.05, le=60.0)] = 1.5
    life: bool = True
    """Whether the texture's amplitude modulation is played."""
    gain_dB: Annotated[float, Meta(ge=-120.0, le=40.0)] = 0.0
    compensator: str = ""


class Block(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="block"):
    """Trials of one kind, asked in a row."""

    name: _Name
    question: _Question = "Which of the two is stronger?"

    @property
    def kind(self) -> str:
        """rating, 2ifc or staircase."""
        return str(self.__struct_config__.tag)

    @property
    def trial_count(self) -> int:
        """Number of trials that it asks."""
        raise NotImplementedError

    @property
    def used(self) -> tuple[str, ...]:
        """Names of the stimuli that it plays."""
        raise NotImplementedError


class RatingBlock(Block, frozen=True, kw_only=True, tag="rating"):
    """Each stimulus is rated on a scale."""

    question: _Question = "How real does it feel?"
    stimuli: Annotated[tuple[_Name, ...], Meta(min_length=1, max_length=100)]
    repeats: _Repeats = 1
    scale: tuple[Annotated[int, Meta(ge=-100, le=100)], Annotated[int, Meta(ge=-100, le=100)]] = (1, 7)
    """Lowest and highest value."""
    labels: tuple[str, str] | None = None
    """What the ends of the scale mean."""
    margin: Annotated[float, Meta(ge=0.0, le=100.0)] = 0.0
    """Difference of ratings below which two stimuli count as equal; 0: never."""

    trial_count = property(lambda self: self.repeats * len(self.stimuli))
    used = property(lambda self: self.stimuli)


class ChoiceBlock(Block, frozen=True, kw_only=True, tag="2ifc"):
    """Two-interval forced choice: which stimulus of a pair?"""

    pairs: Annotated[tuple[tuple[_Name, _Name], ...], Meta(min_length=1, max_length=100)]
    """What is compared; the first of the two is the right answer."""
    repeats: _Repeats = 1
    margin: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.0
    """d′ below which two stimuli count as equal; 0: never."""

    trial_count = property(lambda self: self.repeats * len(self.pairs))
    used = property(lambda self: tuple(name for pair in self.pairs for name in pair))


class StaircaseBlock(Block, frozen=True, kw_only=True, tag="staircase"):
    """Adaptive threshold of one number of a stimulus, by forced choice between a level and the reference."""

    stimulus: _Name
    parameter: Literal["force_N", "speed_m_s", "seconds", "gain_dB"]
    reference: float = 0.0
    """Value of the parameter in the other interval."""
    below: bool = False
    """Whether the levels lie below the reference."""
    levels: tuple[float, float, Annotated[int, Meta(ge=2, le=200)]]
    """Least distance from the reference, greatest, and how many of them."""
    trials: Annotated[int, Meta(ge=5, le=1000)] = 40

    trial_count = property(lambda self: self.trials)
    used = property(lambda self: (self.stimulus,))

    @property
    def distances(self) -> tuple[float, ...]:
        """The levels: distances from the reference, ascending, in equal ratios."""
        return tuple(np.geomspace(*self.levels).tolist())

    def varied(self, stimulus: Stimulus, distance: float) -> Stimulus:
        """The stimulus at a distance from the reference."""
        changed: dict[str, Any] = {self.parameter: self.reference + (-distance if self.below else distance)}
        return replace(stimulus, **changed)


class Plan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The checked content of a plan file."""

    title: Annotated[str, Meta(min_length=1, max_length=200)]
    channel: Literal["headphones", "handle"] = "headphones"
    seed: Annotated[int, Meta(ge=0, lt=2**31)] = 0
    people: Annotated[int, Meta(ge=1, le=10_000)]
    """How many participants are planned."""
    consent: _Text = ""
    """What a participant agrees to before the first trial."""
    instructions: _Text = ""
    """Shown to a participant before the first trial."""
    practice: Annotated[int, Meta(ge=0, le=20)] = 0
    """Trials of each block that are asked first, with feedback, and not kept [count]."""
    break_every: Annotated[int, Meta(ge=0, le=1000)] = 0
    """Answers after which there is a break [count]; 0: no breaks."""
    stimuli: Annotated[dict[_Name, Stimulus], Meta(min_length=1, max_length=1000)]
    blocks: Annotated[tuple[RatingBlock | ChoiceBlock | StaircaseBlock, ...], Meta(min_length=1, max_length=100)]
    content: bytes = b""
    """The file."""
    folder: str = "."
    """Folder of the file, to which paths in it are relative."""

    @property
    def sha256(self) -> str:
        """Of the file, hexadecimal."""
        return hashlib.sha256(self.content).hexdigest()

    @property
    def trial_count(self) -> int:
        """Number of trials of a participant."""
        return sum(block.trial_count for block in self.blocks)


def load_plan(path: str | Path) -> Plan:
    """Read a plan from a TOML file; docs/study.md describes its keys.

    Raises:
        StudyError: no such file, invalid TOML, or a key that is unknown, missing or out of range.
    """
    path = Path(path)
    with refusing(StudyError), naming(path):
        return parse_plan(read_bytes(path, PLAN_MAX_B, "plan of a study"), folder=path.absolute().parent)


def parse_plan(content: str | bytes, *, folder: str | Path = ".") -> Plan:
    """Read a plan from TOML text.

    Args:
        content: the text.
        folder: to which paths in it are relative.

    Raises:
        StudyError: see `load_plan`.
    """
    content = content.encode() if isinstance(content, str) else content
    try:
        plan = msgspec.convert(tomllib.loads(content.decode("utf-8-sig")), Plan)
    except msgspec.ValidationError as error:
        raise StudyError(f"invalid plan: {error}") from None
    except (ValueError, RecursionError) as error:  # ValueError: also for a number of more than 4300 digits
        raise StudyError(f"not a plan in TOML: {str(error).partition('; use sys.')[0]}") from None
    stimuli = {name: replace(stimulus, name=name) for name, stimulus in plan.stimuli.items()}
    for stimulus in stimuli.values():
        if not (stimulus.swatch or stimulus.recording):
            raise StudyError(f'stimuli.{stimulus.name}: expected swatch = "NAME", recording = "FILE", or both')
    for number, block in enumerate(plan.blocks):
        _check_block(f"blocks[{number}]", block, stimuli)
    names = [block.name for block in plan.blocks]
    if double := next((name for name in names if names.count(name) > 1), None):
        raise StudyError(f"blocks: the name {double!r} is used twice")
    if plan.trial_count > TRIALS_MAX:
        raise StudyError(f"blocks: {plan.trial_count} trials of a participant; expected at most {TRIALS_MAX}")
    return replace(plan, stimuli=stimuli, content=content, folder=str(folder))


def _check_block(where: str, block: Block, stimuli: dict[str, Stimulus]) -> None:
    """Check what the schema cannot express."""
    for name in block.used:
        if name not in stimuli:
            raise StudyError(f"{where}: {no_such('stimulus', name, stimuli)}")
    if isinstance(block, RatingBlock):
        if len(set(block.stimuli)) < len(block.stimuli):
            raise StudyError(f"{where}.stimuli names one twice; repeats = 2 asks each twice")
        if not block.scale[0] < block.scale[1] <= block.scale[0] + 20:
            raise StudyError(f"{where}.scale must be [lowest, highest], 2 to 21 steps, is {list(block.scale)}")
    if isinstance(block, ChoiceBlock) and (same := next((a for a, b in block.pairs if a == b), None)):
        raise StudyError(f"{where}.pairs must have two different stimuli each, has {same!r} twice")
    if isinstance(block, StaircaseBlock):
        stimulus = stimuli[block.stimulus]
        if not 1e-12 <= block.levels[0] < block.levels[1] <= 1e6:
            raise StudyError(f"{where}.levels must be [least, greatest, count], 0 < least; is {list(block.levels)}")
        if block.parameter in ("force_N", "speed_m_s") and stimulus.recording:
            raise StudyError(f"{where}.parameter: {block.parameter} changes nothing where a recording is played")
        for level in (0.0, block.levels[1]):
            try:
                msgspec.convert(msgspec.to_builtins(block.varied(stimulus, level)), Stimulus)
            except msgspec.ValidationError as error:
                raise StudyError(f"{where}: level {level:g}: {error}") from None


def check_name(where: str, value: str) -> str:
    """A name that is written to the results, and that every program reads as text.

    Raises:
        StudyError: an invalid name.
    """
    try:
        return msgspec.convert(value, _Name)
    except msgspec.ValidationError:
        expected = "a name must begin with a letter, and have at most 64 letters, digits, - and _"
        raise StudyError(f"{where}: {expected}; is {value[:60]!r}") from None


def stimuli_sha256(plan: Plan) -> str | None:
    """SHA-256 over the files that the stimuli are made of, in the plan's order; None if one cannot be read."""
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
