"""The plan of a study: a TOML file that lists the stimuli, the questions and how often each is asked."""

import hashlib
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from hapscene.errors import HapsceneError, StudyError, did_you_mean, no_such
from hapscene.files import naming, read_bytes, refusing, short

CHANNELS: Final = ("headphones", "handle")

PLAN_MAX_B: Final = 1 << 20
"""Largest plan [bytes]."""

TRIALS_MAX: Final = 10_000
"""Most trials of one person [count]: a day and a half without sleep at ten seconds each."""

UNSAID: Final = {"na", "nan", "null", "none", "t", "f", "true", "false", "inf", "infinity"}
"""Names that pandas or R would not read as text."""


@dataclass(frozen=True)
class Block:
    """Trials of one kind, asked in a row. Fields that its kind does not have are empty."""

    name: str
    kind: str
    """rating, 2ifc or staircase."""
    question: str
    repeats: int = 0
    stimuli: tuple[str, ...] = ()
    """rating: what is rated."""
    scale: tuple[int, int] = (1, 7)
    """rating: its lowest and highest value."""
    labels: tuple[str, ...] = ()
    """rating: what the ends of the scale mean."""
    pairs: tuple[tuple[str, str], ...] = ()
    """2ifc: what is compared; the first of the two is the right answer."""
    margin: float | None = None
    """rating, 2ifc: difference below which two count as equal: points of the scale, or d′; None: never equal."""
    stimulus: str = ""
    """staircase: what is varied."""
    parameter: str = ""
    """staircase: which of its numbers."""
    reference: float = 0.0
    """staircase: its value in the other interval."""
    below: bool = False
    """staircase: levels lie below the reference."""
    levels: tuple[float, ...] = ()
    """staircase: distances from the reference, ascending."""
    trials: int = 0
    """staircase: number of trials."""

    def varied(self, stimulus: Mapping[str, object], distance: float) -> dict[str, object]:
        """staircase: the stimulus at a distance from the reference."""
        value = self.reference + (-distance if self.below else distance)
        return {**stimulus, self.parameter: round(value) if isinstance(stimulus[self.parameter], int) else value}

    @property
    def most(self) -> int:
        """Number of trials that it asks."""
        return self.trials or self.repeats * len(self.stimuli or self.pairs)


@dataclass(frozen=True)
class Plan:
    """The checked content of a plan file."""

    title: str
    channel: str
    seed: int
    people: int
    """How many participants are planned."""
    stimuli: Mapping[str, Mapping[str, object]]
    """Parameters by the stimulus's name, with defaults for those that the file leaves out."""
    blocks: tuple[Block, ...]
    content: bytes = field(repr=False)
    """The file."""
    consent: str = ""
    """What a participant agrees to before the first trial."""
    instructions: str = ""
    """Shown to a participant before the first trial."""
    practice: int = 0
    """Trials of each block that are asked first, with feedback, and not kept [count]."""
    break_every: int = 0
    """Answers after which there is a break [count]; 0 for none."""
    folder: Path = Path()
    """Folder of the file, from which its relative paths start."""

    @property
    def sha256(self) -> str:
        """Of the file, hexadecimal."""
        return hashlib.sha256(self.content).hexdigest()


def stimuli_sha256(plan: Plan) -> str | None:
    """SHA-256 over the files that the stimuli are made of, in the plan's order; None where one cannot be read."""
    from importlib.resources import as_file

    from hapscene.swatches.library import swatch_place

    digest = hashlib.sha256()
    for stimulus in plan.stimuli.values():
        swatch, recording = str(stimulus["swatch"]), str(stimulus["recording"])
        places: list[Any] = [plan.folder / recording] if recording else []
        if swatch:
            places.append(plan.folder / swatch if swatch.endswith(".swatch") else swatch_place(swatch))
        try:
            for place in places:
                with as_file(place) as path:
                    digest.update(hashlib.sha256(path.read_bytes()).digest())
        except (OSError, ValueError, HapsceneError):
            return None
    return digest.hexdigest()


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
        folder: from which its relative paths start.

    Raises:
        StudyError: see `load_plan`.
    """
    content = content.encode() if isinstance(content, str) else content
    try:
        table = tomllib.loads(content.decode("utf-8-sig"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise StudyError(f"not a plan in TOML: {error}") from None
    values = _read("", table, _PLAN)
    stimuli = {}
    for name, given in values.pop("stimuli").items():
        where = f"stimuli.{check_name('stimuli', name)}"
        stimulus = _read(where, given, _STIMULUS)
        if not (stimulus["swatch"] or stimulus["recording"]):
            raise StudyError(f'{where} must have swatch = "NAME", recording = "FILE", or both')
        stimuli[name] = {"name": name} | stimulus
    blocks = tuple(_block(number, given, stimuli) for number, given in enumerate(values.pop("blocks")))
    names = [block.name for block in blocks]
    if double := next((name for name in names if names.count(name) > 1), None):
        raise StudyError(f"blocks: the name {double!r} is used twice")
    if (most := sum(block.most for block in blocks)) > TRIALS_MAX:
        raise StudyError(f"blocks: {most} trials a person, more than the {TRIALS_MAX} that are allowed")
    return Plan(stimuli=stimuli, blocks=blocks, content=content, folder=Path(folder), **values)


def check_name(where: str, value: Any) -> str:
    """A name that is written to the results and read as text by every program.

    Raises:
        StudyError: it is no such name.
    """
    plain = isinstance(value, str) and value.isascii() and value.replace("_", "").replace("-", "").isalnum()
    if not plain or not value[0].isalpha() or len(value) > 64 or value.casefold() in UNSAID:
        raise StudyError(
            f"{where}: a name must begin with a letter, have at most 64 letters, digits, - and _, and not read as a "
            f"number or as missing; is {short(value)}"
        )
    return str(value)


class Key(NamedTuple):
    """What a key of the plan may hold."""

    kind: type
    default: Any = ...
    """`...`: the key is required."""
    least: float = 0.0
    """Smallest number, or fewest characters of a text or items of a list."""
    most: float = 1000.0
    among: tuple[str, ...] = ()
    """The texts that are allowed; empty for any."""
    item: "Key | None" = None
    """What each item of a list must be."""


_WORDS: Final = {
    bool: "true or false",
    int: "a whole number from {:g} to {:g}",
    float: "a number from {:g} to {:g}",
    str: "a text of {:g} to {:g} characters",
    list: "a list of {:g} to {:g} items",
    dict: "a table with {:g} to {:g} entries",
}


def _read(where: str, given: Any, keys: Mapping[str, Key]) -> dict[str, Any]:
    """The checked values of a table."""
    if not isinstance(given, dict):
        raise StudyError(f"{where} must be a table, is {short(given)}")
    prefix = f"{where}." if where else ""
    for name in given:
        if name not in keys:
            near = did_you_mean(name[:100], keys)
            raise StudyError(f"unknown key {short(prefix + name)}{near}; allowed are: {', '.join(keys)}")
    if missing := next((name for name, key in keys.items() if key.default is ... and name not in given), None):
        raise StudyError(f"key {prefix + missing!r} is missing")
    return {n: _checked(prefix + n, given[n], key) if n in given else key.default for n, key in keys.items()}


def _checked(where: str, value: Any, key: Key) -> Any:
    if key.kind is float and type(value) is int:
        value = float(value)
    size = len(value) if isinstance(value, str | list | dict) else value
    allowed = value in key.among if key.among else type(value) is key.kind and key.least <= size <= key.most
    if not allowed:
        words = f"one of {', '.join(key.among)}" if key.among else _WORDS[key.kind].format(key.least, key.most)
        raise StudyError(f"{where} must be {words}, is {short(value)}")
    if key.item is not None:
        return tuple(_checked(f"{where}[{number}]", one, key.item) for number, one in enumerate(value))
    return value


_PLAN: Final = {
    "title": Key(str, least=1, most=200),
    "channel": Key(str, "headphones", among=CHANNELS),
    "seed": Key(int, 0, most=2**31 - 1),
    "people": Key(int, least=1, most=10_000),
    "consent": Key(str, "", most=20_000),
    "instructions": Key(str, "", most=20_000),
    "practice": Key(int, 0, most=20),
    "break_every": Key(int, 0),
    "stimuli": Key(dict, least=1),
    "blocks": Key(list, least=1, most=100),
}

_STIMULUS: Final = {
    "swatch": Key(str, ""),
    "recording": Key(str, ""),
    "rate_Hz": Key(float, 0.0, 1.0, 1e6),
    "units": Key(str, ""),
    "columns": Key(str, ""),
    "force_N": Key(float, 1.0, most=100.0),
    "speed_m_s": Key(float, 0.1, most=10.0),
    "seconds": Key(float, 1.5, 0.05, 60.0),
    "life": Key(bool, True),
    "order": Key(int, 0, most=400),
    "gain_dB": Key(float, 0.0, -120.0, 40.0),
    "compensator": Key(str, ""),
}

_NUMBERS: Final = ("force_N", "speed_m_s", "seconds", "order", "gain_dB")
"""What a staircase may vary."""

_NAME: Final = Key(str, least=1, most=64)
_STRONGER: Final = Key(str, "Which of the two is stronger?", 1, 500)

_KINDS: Final[Mapping[str, Mapping[str, Key]]] = {
    "rating": {
        "stimuli": Key(list, least=1, most=100, item=_NAME),
        "repeats": Key(int, 1, 1),
        "question": Key(str, "How real does it feel?", 1, 500),
        "scale": Key(list, (1, 7), 2, 2, item=Key(int, least=-100, most=100)),
        "labels": Key(list, (), 2, 2, item=Key(str, most=100)),
        "margin": Key(float, None, most=100.0),
    },
    "2ifc": {
        "pairs": Key(list, least=1, most=100, item=Key(list, least=2, most=2, item=_NAME)),
        "repeats": Key(int, 1, 1),
        "question": _STRONGER,
        "margin": Key(float, None, most=10.0),
    },
    "staircase": {
        "stimulus": _NAME,
        "parameter": Key(str, among=_NUMBERS),
        "reference": Key(float, 0.0, -1e6, 1e6),
        "below": Key(bool, False),
        "levels": Key(list, least=3, most=3, item=Key(float, least=0.0, most=1e6)),
        "trials": Key(int, 40, 5),
        "question": _STRONGER,
    },
}


def _block(number: int, given: Any, stimuli: Mapping[str, Mapping[str, object]]) -> Block:
    where = f"blocks[{number}]"
    kind = _checked(f"{where}.kind", given.get("kind") if isinstance(given, dict) else None, Key(str, among=(*_KINDS,)))
    values = _read(where, given, {"name": Key(str), "kind": Key(str), **_KINDS[kind]})
    check_name(f"{where}.name", values["name"])
    used = [*values.get("stimuli", ()), *(one for pair in values.get("pairs", ()) for one in pair)]
    for name in (*used, values["stimulus"]) if kind == "staircase" else used:
        if name not in stimuli:
            raise StudyError(f"{where}: {no_such('stimulus', name, stimuli)}")
    if kind == "rating":
        if len(set(used)) < len(used):
            raise StudyError(f"{where}.stimuli names one twice; repeats = 2 asks each twice")
        if not values["scale"][0] < values["scale"][1] <= values["scale"][0] + 20:
            raise StudyError(f"{where}.scale must be [lowest, highest], 2 to 21 steps, is {list(values['scale'])}")
    if same := next((pair for pair in values.get("pairs", ()) if pair[0] == pair[1]), None):
        raise StudyError(f"{where}.pairs must have two different stimuli each, has {same[0]!r} twice")
    if kind == "staircase":
        if values["parameter"] in ("force_N", "speed_m_s") and stimuli[values["stimulus"]]["recording"]:
            raise StudyError(f"{where}.parameter: {values['parameter']} changes nothing where a recording is played")
        values["levels"] = _levels(where, values)
    return Block(**values)


def _levels(where: str, values: Mapping[str, Any]) -> tuple[float, ...]:
    """Distances from the reference that can be played, ascending, spaced by ratio; a whole number takes each once."""
    least, most, count = values["levels"]
    if not 1e-12 <= least < most or count != int(count) or not 2 <= count <= 200:
        raise StudyError(
            f"{where}.levels must be [least, most, count]: distances from the reference, 0 < least < most, 2 to 200 "
            f"of them; is {list(values['levels'])}"
        )
    key = _STIMULUS[values["parameter"]]
    if key.kind is int and values["reference"] % 1.0:
        raise StudyError(f"{where}.reference must be whole, as {values['parameter']} is; is {values['reference']:g}")
    spaced = np.geomspace(least, most, int(count)).tolist()
    levels = tuple(dict.fromkeys(float(round(level)) if key.kind is int else level for level in spaced))
    for level in (0.0, *levels):
        value = values["reference"] + (-level if values["below"] else level)
        _checked(f"{where}: {values['parameter']} at the level {level:g}", key.kind(value), key)
    if len(levels) < 2:
        raise StudyError(f"{where}.levels: {values['parameter']} is a whole number, and fewer than two values are left")
    return levels
