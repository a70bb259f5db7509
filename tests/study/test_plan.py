"""A plan says what it should, or which key does not and what is allowed."""

import tomllib
from pathlib import Path

import pytest

from hapscene.errors import StudyError
from hapscene.study.plan import TRIALS_MAX, load_plan, parse_plan

from .plans import TEXT


def test_a_plan_is_read_whole(tmp_path: Path) -> None:
    path = tmp_path / "life.toml"
    path.write_text(TEXT, encoding="utf-8")
    plan = load_plan(path)
    assert (plan.title, plan.channel, plan.seed, plan.people) == ("Is life noticed?", "headphones", 1, 12)
    assert plan.folder == tmp_path and plan.content == path.read_bytes()
    assert plan.stimuli["steady"] == plan.stimuli["alive"] | {"name": "steady", "life": False}
    assert plan.stimuli["rough"]["order"] == 40 and plan.stimuli["rough"]["gain_dB"] == 0.0
    rating, life, pairs, staircase = plan.blocks
    assert (rating.kind, rating.stimuli, rating.scale, rating.most) == (
        "rating",
        ("alive", "steady", "rough"),
        (1, 7),
        12,
    )
    assert life.pairs == (("alive", "steady"),) and life.most == 8 and pairs.most == 8
    assert len(staircase.levels) == 32 and staircase.levels[0] == 0.25 and staircase.levels[-1] == pytest.approx(8.0)
    assert staircase.levels[1] / staircase.levels[0] == pytest.approx(32 ** (1 / 31))


def test_levels_of_a_whole_number_are_whole_and_each_once() -> None:
    text = TEXT.replace('parameter = "gain_dB"\nlevels = [0.25, 8.0, 32]', 'parameter = "order"\nlevels = [1, 20, 30]')
    levels = parse_plan(text).blocks[-1].levels
    assert levels == tuple(sorted(set(levels))) and all(level == int(level) for level in levels)
    assert (levels[0], levels[-1]) == (1.0, 20.0)


WRONG = {
    "channel": ('channel = "headphones"', 'channel = "phone"', "channel must be one of headphones, handle, is"),
    "unknown": ("seed = 1", "sed = 1", "unknown key 'sed'; did you mean 'seed'?; allowed are: title, channel"),
    "missing": ("people = 12", "", "key 'people' is missing"),
    "true is no number": ("people = 12", "people = true", "people must be a whole number from 1 to 10000, is True"),
    "life": ("life = false", "life = 0", "stimuli.steady.life must be true or false, is 0"),
    "order": ("order = 40", "order = 40.0", "stimuli.rough.order must be a whole number from 0 to 400, is 40.0"),
    "not finite": ("order = 40", "gain_dB = nan", "stimuli.rough.gain_dB must be a number from -120 to 40, is nan"),
    "neither": ('swatch = "paper"', "", 'stimuli.rough must have swatch = "NAME"'),
    "name": ("[stimuli.rough]", "[stimuli.'1e5']", "a name must begin with a letter"),
    "name read as missing": ("[stimuli.rough]", "[stimuli.NA]", "a name must begin with a letter"),
    "kind": ('kind = "rating"', 'kind = "rate"', "blocks[0].kind must be one of rating, 2ifc, staircase"),
    "another kind": ('kind = "2ifc"', 'kind = "2ifc"\ntrials = 3', "unknown key 'blocks[1].trials'; allowed are"),
    "repeats": ("repeats = 8", "repeats = 0", "blocks[1].repeats must be a whole number from 1 to 1000, is 0"),
    "no such stimulus": (
        '["rough", "steady"]',
        '["rouh", "steady"]',
        "blocks[2]: no stimulus 'rouh'; there are: alive",
    ),
    "pair of one": ('["rough", "steady"]', '["rough", "rough"]', "blocks[2].pairs must have two different stimuli"),
    "pair of three": ('["rough", "steady"]', '["rough"]', "blocks[2].pairs[1] must be a list of 2 to 2 items"),
    "twice": ('"steady", "rough"]', '"steady", "steady"]', "blocks[0].stimuli names one twice; repeats = 2"),
    "scale": ("repeats = 4\n", "repeats = 4\nscale = [7, 1]\n", "blocks[0].scale must be [lowest, highest]"),
    "same name": ('name = "life"', 'name = "real"', "the name 'real' is used twice"),
    "parameter": ('"gain_dB"', '"life"', "blocks[3].parameter must be one of force_N, speed"),
    "levels": ("[0.25, 8.0, 32]", "[0, 8.0, 32]", "blocks[3].levels must be [least, most, count]"),
    "levels out of range": ("[0.25, 8.0, 32]", "[0.25, 80.0, 32]", "gain_dB at the level"),
    "half": ('"gain_dB"', '"order"\nreference = 4.5', "blocks[3].reference must be whole, as order is; is 4.5"),
    "few": ('"gain_dB"\nlevels = [0.25, 8.0, 32]', '"order"\nlevels = [1, 1.2, 9]', "fewer than two values are left"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_named_with_what_is_allowed(case: str) -> None:
    there, instead, said = WRONG[case]
    assert there in TEXT
    text = TEXT.replace(there, instead, 1)
    tomllib.loads(text)  # it is the plan that is wrong, not the TOML
    with pytest.raises(StudyError) as fault:
        parse_plan(text)
    assert said in str(fault.value) and "\n" not in str(fault.value)


def test_a_file_that_is_no_plan_is_refused_by_its_name(tmp_path: Path) -> None:
    path = tmp_path / "life.toml"
    for content, said in (
        (b"title = ", "not a plan in TOML"),
        (b"\xff", "not a plan in TOML"),
        (b"a=" + b"[" * 5000, ""),
    ):
        path.write_bytes(content)
        with pytest.raises(StudyError, match=str(path)) as fault:
            load_plan(path)
        assert said in str(fault.value)
    with pytest.raises(StudyError, match="no such file"):
        load_plan(tmp_path / "other.toml")


def test_a_person_is_not_asked_for_days() -> None:
    many = "".join(
        f'[[blocks]]\nname = "b{k}"\nkind = "rating"\nstimuli = ["alive"]\nrepeats = 1000\n' for k in range(11)
    )
    with pytest.raises(StudyError, match=f"more than the {TRIALS_MAX}"):
        parse_plan(TEXT + many)
