"""A valid plan is read; the error of an invalid plan names the key and the permitted values."""

import tomllib
from pathlib import Path

import msgspec
import pytest

from hapscene.errors import StudyError
from hapscene.study.plan import TRIALS_MAX, Stimulus, load_plan, parse_plan

from .plans import TEXT


def test_a_plan_is_read(tmp_path: Path) -> None:
    path = tmp_path / "life.toml"
    path.write_text(TEXT, encoding="utf-8")
    plan = load_plan(path)
    assert (plan.title, plan.channel, plan.seed, plan.people) == ("Is life noticed?", "headphones", 1, 12)
    assert plan.folder == str(tmp_path) and plan.content == path.read_bytes()
    assert plan.stimuli["steady"] == Stimulus(name="steady", swatch="wood", life=False)
    rating, life, pairs, staircase = plan.blocks
    assert (rating.kind, rating.stimuli, rating.scale, rating.trial_count) == (
        "rating",
        ("alive", "steady", "rough"),
        (1, 7),
        12,
    )
    assert life.pairs == (("alive", "steady"),) and life.trial_count == 8 and pairs.trial_count == 8
    assert len(staircase.distances) == 32 and staircase.distances[0] == 0.25 and staircase.distances[-1] == 8.0
    assert staircase.distances[1] / staircase.distances[0] == pytest.approx(32 ** (1 / 31))


DEFAULTS = """
title = "Short"
people = 3
[stimuli.a]
swatch = "wood"
[[blocks]]
name = "r"
kind = "rating"
stimuli = ["a"]
[[blocks]]
name = "c"
kind = "2ifc"
pairs = [["a", "a2"]]
[[blocks]]
name = "s"
kind = "staircase"
stimulus = "a"
parameter = "speed_m_s"
levels = [0.1, 0.4, 3]
[stimuli.a2]
swatch = "paper"
"""


def test_defaults_of_a_plan() -> None:
    plan = parse_plan(DEFAULTS)
    assert (plan.channel, plan.seed, plan.consent, plan.instructions, plan.folder) == ("headphones", 0, "", "", ".")
    stimulus = msgspec.structs.asdict(plan.stimuli["a"])
    assert {key: value for key, value in stimulus.items() if value} == {
        **{"name": "a", "swatch": "wood", "force_N": 1.0, "speed_m_s": 0.1, "seconds": 1.5, "life": True}
    }
    rating, choice, staircase = plan.blocks
    assert (rating.repeats, rating.scale, rating.labels, rating.margin, rating.used) == (1, (1, 7), None, 0.0, ("a",))
    assert (choice.repeats, choice.margin, choice.used) == (1, 0.0, ("a", "a2"))
    assert (staircase.reference, staircase.trials, staircase.used) == (0.0, 40, ("a",))
    assert [block.trial_count for block in plan.blocks] == [1, 1, 40]
    assert staircase.distances == pytest.approx((0.1, 0.2, 0.4))
    from_half = msgspec.structs.replace(staircase, reference=0.5)
    assert from_half.varied(plan.stimuli["a"], 0.2) == msgspec.structs.replace(plan.stimuli["a"], speed_m_s=0.7)
    for one in (plan, *plan.stimuli.values(), *plan.blocks):
        with pytest.raises(AttributeError):
            setattr(one, one.__struct_fields__[0], "other")


WRONG = {
    "channel": ('channel = "headphones"', 'channel = "phone"', "$.channel"),
    "unknown": ("seed = 1", "sed = 1", "unknown field `sed`"),
    "unknown of a stimulus": ("life = false", "lif = false", "unknown field `lif`"),
    "unknown of a block": ("repeats = 8", "repeat = 8", "unknown field `repeat`"),
    "not finite": ("life = false", "gain_dB = nan", "gain_dB"),
    "neither": ('swatch = "paper"', "", "stimuli.rough"),
    "name": ("[stimuli.rough]", "[stimuli.'1e5']", "$.stimuli"),
    "kind": ('kind = "rating"', 'kind = "rate"', "$.blocks[0].kind"),
    "no such stimulus": ('["rough", "steady"]', '["rouh", "steady"]', "blocks[2]: no stimulus 'rouh'"),
    "twice": ('"steady", "rough"]', '"steady", "steady"]', "blocks[0].stimuli"),
    "scale": ("repeats = 4\n", "repeats = 4\nscale = [7, 1]\n", "blocks[0].scale"),
    "same name": ('name = "life"', 'name = "real"', "the name 'real' is used twice"),
    "parameter": ('"gain_dB"', '"life"', "$.blocks[3].parameter"),
    "levels out of range": ("[0.25, 8.0, 32]", "[0.25, 80.0, 32]", "blocks[3]: level 80: "),
    "without effect": (
        'swatch = "wood"\n[stimuli.st',
        'recording = "a.csv"\n[stimuli.st',
        "blocks[3].parameter",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_invalid_keys_are_named(case: str) -> None:
    there, instead, expected = WRONG[case]
    assert there in TEXT
    text = TEXT.replace(there, instead, 1)
    text = text.replace('"gain_dB"', '"force_N"') if case == "without effect" else text
    tomllib.loads(text)  # it is the plan that is wrong, not the TOML
    with pytest.raises(StudyError) as fault:
        parse_plan(text)
    assert expected in str(fault.value) and "\n" not in str(fault.value)


def test_invalid_files(tmp_path: Path) -> None:
    path = tmp_path / "life.toml"
    for content, expected in (
        (b"title = ", "TOML"),
        (b"\xff", "TOML"),
        (b"a=" + b"[" * 5000, ""),
        (b"people = " + b"9" * 5000, "4300 digits"),
    ):
        path.write_bytes(content)
        with pytest.raises(StudyError, match=str(path)) as fault:
            load_plan(path)
        assert expected in str(fault.value)
    with pytest.raises(StudyError, match="no such file"):
        load_plan(tmp_path / "other.toml")


def test_the_number_of_trials_is_limited() -> None:
    many = "".join(
        f'[[blocks]]\nname = "b{k}"\nkind = "rating"\nstimuli = ["alive"]\nrepeats = 1000\n' for k in range(11)
    )
    with pytest.raises(StudyError, match=f"at most {TRIALS_MAX}"):
        parse_plan(TEXT + many)
