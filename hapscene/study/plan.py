"""The plan of a study: a TOML file that says what is felt, what is asked and how often."""

import hashlib
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from hapscene.errors import HapsceneError, StudyError, did_you_mean, no_such
from hapscene.files import naming, read_bytes, refusing, short

CHANNELS: Final = ("headphones", "handle", "device")

PLAN_MAX_B: Final = 1 << 20
"""Largest plan [bytes]."""

EFFECTS: Final = ("friction", "lpc_texture", "tap")
"""What a stimulus may have; the wall is always there, since nothing is touched without it."""

TRIALS_MAX: Final = 10_000
"""Most trials of one person [count]: a day and a half without sleep at ten seconds each."""

UNSAID: Final = {"na", "nan", "null", "none", "t", "f", "true", "false", "inf", "infinity"}
"""Names that pandas or R would read as no text."""


@dataclass(frozen=True)
class Block:
    """Trials of one kind, asked in a row. What its kind does not have is empty."""

    name: str
    kind: str
    """rating, 2ifc, abx or staircase."""
    question: str
    repeats: int = 0
    stimuli: tuple[str, ...] = ()
    """rating: what is rated."""
    scale: tuple[int, int] = (1, 7)
    """rating: its lowest and highest."""
    labels: tuple[str, ...] = ()
    """rating: what the ends of the scale mean."""
    pairs: tuple[tuple[str, str], ...] = ()
    """2ifc, abx: what is compared; in 2ifc the first of the two is the right answer."""
    margin: float | None = None
    """Difference below which it does not matter: points of the scale, or d′; without, nothing is called equal."""
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
    linear: bool = False
    """staircase: thresholds and levels are spaced evenly, not by ratio."""
    trials: int = 0
    """staircase: most trials."""
    stop_within: float = 0.0
    """staircase: ends once the threshold is known to this share of itself (0.1: 10 %), 0 never."""

    def varied(self, stimulus: Mapping[str, object], distance: float) -> dict[str, object]:
        """staircase: the stimulus so far from the reference."""
        value = self.reference + (-distance if self.below else distance)
        whole = isinstance(stimulus[self.parameter], int)
        return {**stimulus, self.parameter: round(value) if whole else value}

    @property
    def most(self) -> int:
        """Most trials that it asks."""
        return self.trials or self.repeats * len(self.stimuli or self.pairs)


@dataclass(frozen=True)
class Plan:
    """What a plan file says, checked."""

    title: str
    channel: str
    seed: int
    people: int
    """How many shall be asked."""
    stimuli: Mapping[str, Mapping[str, object]]
    """Parameters by the stimulus's name, all of them, what the file leaves out by its default."""
    blocks: tuple[Block, ...]
    content: bytes = field(repr=False)
    """The file."""
    consent: str = ""
    """What a person agrees to before all else."""
    instructions: str = ""
    """What a person is told before the first trial."""
    practice: int = 0
    """Trials of each block that are asked first, told right or wrong, and not kept [count]."""
    break_every: int = 0
    """Answers after which there is a break [count]; 0 for none."""
    folder: Path = Path()
    """Where the file lies, from which its paths go."""

    @property
    def sha256(self) -> str:
        """Of the file, hexadecimal."""
        return hashlib.sha256(self.content).hexdigest()


def sources(plan: Plan) -> dict[str, str]:
    """sha256 of the file that each stimulus is made of, by the stimulus's name; "" of one that cannot be read."""
    from importlib.resources import as_file

    from hapscene.surface.library import swatch_place

    found = {}
    for name, stimulus in plan.stimuli.items():
        swatch, recording = str(stimulus["swatch"]), str(stimulus["recording"])
        try:
            inside = recording or (swatch if swatch.endswith(".swatch") else "")
            with as_file(plan.folder / inside if inside else swatch_place(swatch)) as path, path.open("rb") as file:
                found[name] = hashlib.file_digest(file, "sha256").hexdigest()
        except (OSError, ValueError, HapsceneError):
            found[name] = ""
    return found


def load_plan(path: str | Path) -> Plan:
    """A study's plan.

    Args:
        path: a TOML file, see `docs/study.md`.

    Raises:
        StudyError: no such file, no TOML, or a key that is unknown, missing, or not what it may be: names the key and
            what is allowed.
    """
    path = Path(path)
    with refusing(StudyError), naming(path):
        return parse_plan(read_bytes(path, PLAN_MAX_B, "plan of a study"), folder=path.absolute().parent)


def parse_plan(content: str | bytes, *, folder: str | Path = ".") -> Plan:
    """A study's plan from its text.

    Args:
        content: the TOML text.
        folder: where its paths go from.

    Raises:
        StudyError: see `load_plan`.
    """
    content = content.encode() if isinstance(content, str) else content
    try:
        table = tomllib.loads(content.decode("utf-8-sig"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise StudyError(f"not a plan in TOML: {error}") from None
    values = _take("", table, _PLAN)
    stimuli = {}
    for name, given in values.pop("stimuli").items():
        where = f"stimuli.{check_name('stimuli', name)}"
        stimulus = _take(where, given, _STIMULUS)
        if bool(stimulus["swatch"]) == bool(stimulus["recording"]):
            raise StudyError(f'{where} must have one of swatch = "NAME" and recording = "FILE"')
        stimuli[name] = {"name": name} | stimulus
    blocks = tuple(_block(number, given, stimuli) for number, given in enumerate(values.pop("blocks")))
    names = [block.name for block in blocks]
    if double := next((name for name in names if names.count(name) > 1), None):
        raise StudyError(f"blocks: the name {double!r} stands twice")
    if (most := sum(block.most for block in blocks)) > TRIALS_MAX:
        raise StudyError(f"blocks: {most} trials a person, more than the {TRIALS_MAX} that are allowed")
    return Plan(stimuli=stimuli, blocks=blocks, content=content, folder=Path(folder), **values)


# What each table may hold: key, then a check that gives the value or raises, then the default (`...`: must be given).

Check = Callable[[str, Any], Any]
Keys = Mapping[str, tuple[Check, Any]]


def _take(where: str, given: Any, keys: Keys) -> dict[str, Any]:
    if not isinstance(given, dict):
        raise StudyError(f"{where} must be a table, is {short(given)}")
    prefix = f"{where}." if where else ""
    for key in given:
        if key not in keys:
            near = did_you_mean(key[:100], keys)
            raise StudyError(f"unknown key {short(prefix + key)}{near}; allowed are: {', '.join(keys)}")
    values = {}
    for key, (check, default) in keys.items():
        if key not in given and default is ...:
            raise StudyError(f"key {prefix + key!r} is missing")
        values[key] = check(prefix + key, given[key]) if key in given else default
    return values


def _text(least: int = 0, most: int = 1000) -> Check:
    def check(where: str, value: Any) -> str:
        if not isinstance(value, str) or not least <= len(value) <= most:
            raise StudyError(f"{where} must be a text of {least} to {most} characters, is {short(value)}")
        return str(value)

    return check


def _among(*allowed: str) -> Check:
    def check(where: str, value: Any) -> str:
        if value not in allowed:
            raise StudyError(f"{where} must be one of {', '.join(allowed)}, is {short(value)}")
        return str(value)

    return check


def _truth(where: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise StudyError(f"{where} must be true or false, is {short(value)}")
    return value


def _whole(least: int, most: int) -> Check:
    def check(where: str, value: Any) -> int:
        if type(value) is not int or not least <= value <= most:
            raise StudyError(f"{where} must be a whole number from {least} to {most}, is {short(value)}")
        return value

    return check


def _number(least: float, most: float) -> Check:
    def check(where: str, value: Any) -> float:
        if type(value) not in (int, float) or not least <= value <= most:
            raise StudyError(f"{where} must be a number from {least:g} to {most:g}, is {short(value)}")
        return float(value)

    return check


def _list(item: Check, least: int, most: int, what: str) -> Check:
    def check(where: str, value: Any) -> tuple[Any, ...]:
        if not isinstance(value, list) or not least <= len(value) <= most:
            found = f"a list of {len(value)}" if isinstance(value, list) else short(value)
            raise StudyError(f"{where} must be {what}, is {found}")
        return tuple(item(f"{where}[{number}]", one) for number, one in enumerate(value))

    return check


def _table(where: str, value: Any) -> dict[str, Any]:
    if not isinstance(value, dict) or not value:
        raise StudyError(f"{where} must be a table [{where}.NAME] for each, is {short(value)}")
    return value


def _any(where: str, value: Any) -> Any:
    return value


def check_name(where: str, value: Any) -> str:
    """A name that stands in the results and is read as text wherever it is read."""
    plain = isinstance(value, str) and value.isascii() and value.replace("_", "").replace("-", "").isalnum()
    if not plain or not value[0].isalpha() or len(value) > 64 or value.casefold() in UNSAID:
        raise StudyError(
            f"{where}: a name must begin with a letter and hold letters, digits, - and _ alone, at most 64, "
            f"and not be read as a number or as missing; is {short(value)}"
        )
    return str(value)


_PLAN: Final[Keys] = {
    "title": (_text(1, 200), ...),
    "channel": (_among(*CHANNELS), "headphones"),
    "seed": (_whole(0, 2**31 - 1), 0),
    "people": (_whole(1, 10_000), ...),
    "consent": (_text(0, 20_000), ""),
    "instructions": (_text(0, 20_000), ""),
    "practice": (_whole(0, 20), 0),
    "break_every": (_whole(0, 1000), 0),
    "stimuli": (_table, ...),
    "blocks": (_list(_any, 1, 100, "tables [[blocks]], 1 to 100"), ...),
}

_STIMULUS: Final[Keys] = {
    "swatch": (_text(), ""),
    "recording": (_text(), ""),
    "rate_Hz": (_number(1.0, 1e6), 0.0),
    "units": (_text(), ""),
    "columns": (_text(), ""),
    "force_N": (_number(0.0, 100.0), 1.0),
    "speed_m_s": (_number(0.0, 10.0), 0.1),
    "seconds": (_number(0.05, 60.0), 1.5),
    "life": (_truth, True),
    "order": (_whole(0, 400), 0),
    "gain_dB": (_number(-120.0, 40.0), 0.0),
    "effects": (_list(_among(*EFFECTS), 0, len(EFFECTS), f"a list of {', '.join(EFFECTS)}"), ("lpc_texture",)),
    "compensator": (_text(), ""),
}

_NUMBERS: Final = tuple(key for key, (_, default) in _STIMULUS.items() if type(default) in (int, float))
"""What a staircase may vary."""

_EVERY: Final[Keys] = {"name": (check_name, ...), "kind": (_any, ...)}
_QUESTION = _text(1, 500)
_PAIRS = _list(_list(_any, 2, 2, 'two stimuli, ["A", "B"]'), 1, 100, 'a list of pairs, [["A", "B"]]')
_REPEATS = _whole(1, 1000)

_KINDS: Final[Mapping[str, Keys]] = {
    "rating": {
        "stimuli": (_list(_any, 1, 100, "a list of stimuli's names, 1 to 100"), ...),
        "repeats": (_REPEATS, 1),
        "question": (_QUESTION, "How real does it feel?"),
        "scale": (_list(_whole(-100, 100), 2, 2, "two whole numbers, [lowest, highest]"), (1, 7)),
        "labels": (_list(_text(0, 100), 2, 2, "two texts, what lowest and highest mean"), ()),
        "margin": (_number(0.0, 100.0), None),
    },
    "2ifc": {
        "pairs": (_PAIRS, ...),
        "repeats": (_REPEATS, 1),
        "question": (_QUESTION, "Which of the two is stronger?"),
        "margin": (_number(0.0, 10.0), None),
    },
    "abx": {
        "pairs": (_PAIRS, ...),
        "repeats": (_REPEATS, 1),
        "question": (_QUESTION, "Which is the last one, A or B?"),
        "margin": (_number(0.0, 10.0), None),
    },
    "staircase": {
        "stimulus": (_any, ...),
        "parameter": (_among(*_NUMBERS), ...),
        "reference": (_number(-1e6, 1e6), 0.0),
        "below": (_truth, False),
        "levels": (_list(_number(-1e6, 1e6), 3, 3, "[least, most, count]"), ...),
        "linear": (_truth, False),
        "trials": (_whole(5, 1000), 40),
        "stop_within": (_number(0.0, 1.0), 0.0),
        "question": (_QUESTION, "Which of the two is stronger?"),
    },
}


def _block(number: int, given: Any, stimuli: Mapping[str, Mapping[str, object]]) -> Block:
    where = f"blocks[{number}]"
    kind = _among(*_KINDS)(f"{where}.kind", given.get("kind", "") if isinstance(given, dict) else "")
    values = _take(where, given, {**_EVERY, **_KINDS[kind]})
    used = [*values.get("stimuli", ()), *(one for pair in values.get("pairs", ()) for one in pair)]
    used += [values["stimulus"]] if kind == "staircase" else []
    for name in used:
        if not isinstance(name, str) or name not in stimuli:
            raise StudyError(f"{where}: {no_such('stimulus', str(name)[:60], stimuli)}")
    if len(set(values.get("stimuli", ()))) < len(values.get("stimuli", ())):
        raise StudyError(f"{where}.stimuli names one twice; repeats = 2 asks each twice")
    if same := next((pair for pair in values.get("pairs", ()) if pair[0] == pair[1]), None):
        raise StudyError(f"{where}.pairs must have two different stimuli each, has {same[0]!r} twice")
    if kind == "rating" and not values["scale"][0] < values["scale"][1] <= values["scale"][0] + 20:
        raise StudyError(f"{where}.scale must be [lowest, highest], 2 to 21 steps, is {list(values['scale'])}")
    if kind == "staircase":
        recorded = stimuli[values["stimulus"]]["recording"]
        if values["parameter"] in (("force_N", "speed_m_s") if recorded else ("rate_Hz",)):
            is_a = "recording" if recorded else "swatch"
            raise StudyError(f"{where}.parameter: {values['parameter']} changes nothing of a {is_a}")
        values["levels"] = _levels(where, values)
    return Block(**values)


def _levels(where: str, values: Mapping[str, Any]) -> tuple[float, ...]:
    """Distances from the reference that can be played, ascending; of a whole number each value once."""
    least, most, count = values["levels"]
    if not (0 if values["linear"] else 1e-12) <= least < most or count != int(count) or not 2 <= count <= 200:
        raise StudyError(
            f"{where}.levels must be [least, most, count]: distances from the reference, 0 < least < most (0 ≤ least "
            f"where linear = true), 2 to 200 of them; is {list(values['levels'])}"
        )
    spaced = np.linspace(least, most, int(count)) if values["linear"] else np.geomspace(least, most, int(count))
    check, default = _STIMULUS[values["parameter"]]
    whole = type(default) is int
    if whole and values["reference"] % 1.0:
        raise StudyError(f"{where}.reference must be whole, as {values['parameter']} is; is {values['reference']:g}")
    levels = tuple(dict.fromkeys(float(round(level)) if whole else float(level) for level in spaced))
    for level in (0.0, *levels):
        value = values["reference"] + (-level if values["below"] else level)
        check(f"{where}: {values['parameter']} at the level {level:g}", round(value) if whole else value)
    if len(levels) < 2:
        raise StudyError(f"{where}.levels: {values['parameter']} is a whole number, and fewer than two values are left")
    return levels
