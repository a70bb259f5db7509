"""A session keeps every answer, and goes on where it was: killed at any time, in the same order."""

from pathlib import Path

import pytest
from msgspec.structs import replace

from hapscene.errors import StudyError
from hapscene.study.plan import Plan, parse_plan
from hapscene.study.results_file import COLUMNS, load_rows
from hapscene.study.session import Session
from hapscene.study.trial_order import Trial
from hapscene.swatches.library import swatch_place

from .plans import TEXT

PLAN = parse_plan(TEXT.replace("trials = 20", "trials = 6"))
AT_TIMES = ("time", "latency_s")


def choice(trial: Trial) -> int:
    """What is answered: it follows from the trial alone, as a mixture of right and wrong."""
    return (trial.number * 7 + trial.number // 3) % len(trial.choices)


def sit(plan: Plan, folder: Path, person: str, most: int = 1000) -> None:
    """Answers, at most so many."""
    with Session(plan, folder, person) as session:
        while session.trial is not None and most > 0:
            session.answer(choice(session.trial), latency_s=0.5)
            most -= 1


def answers(folder: Path) -> list[dict[str, str]]:
    return [{n: v for n, v in row.items() if n not in AT_TIMES} for row in load_rows(folder / "results.csv")]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, str]]:
    """The answers of a session that nothing stops."""
    folder = tmp_path_factory.mktemp("whole")
    sit(PLAN, folder, "P01")
    return answers(folder)


def test_every_answer_is_a_row(whole: list[dict[str, str]]) -> None:
    assert [int(row["trial"]) for row in whole] == list(range(PLAN.trial_count))
    assert {row["plan_sha256"] for row in whole} == {PLAN.sha256}
    for row in whole:
        rated, right = row["kind"] == "rating", row["correct_answer"]
        assert (row["rating"] != "NA") == rated == (row["correct"] == "NA") == (right == "NA")
        assert rated or (row["correct"] == "1") == (row["answer"] == right)
        assert not rated or row["choice"] == row["rating"] == str(int(row["answer"]) + 1)
        assert (row["level"] != "NA") == (row["parameter"] == "gain_dB") == (row["kind"] == "staircase")
        assert row["stimulus_3"] == "NA"


@pytest.mark.nightly
def test_stopped_after_each_answer_it_is_the_same(whole: list[dict[str, str]], tmp_path: Path) -> None:
    for done in range(len(whole)):
        with Session(PLAN, tmp_path, "P01") as session:
            assert (session.done, session.total) == (done, len(whole))
            session.answer(choice(session.trial), latency_s=0.5)
    with Session(PLAN, tmp_path, "P01") as session:
        assert session.trial is None
        with pytest.raises(StudyError, match="all 34 trials are answered"):
            session.answer(0, latency_s=0.5)
    assert answers(tmp_path) == whole


def test_people_follow_each_other_in_the_square(tmp_path: Path) -> None:
    plan = parse_plan(TEXT.replace('"staircase"', '"rating"').split('stimulus = "alive"')[0] + 'stimuli = ["alive"]')
    for person in ("P01", "P02", "P01", "P03", "P04"):
        sit(plan, tmp_path, person, most=40 if person == "P04" else 5)
    rows = load_rows(tmp_path / "results.csv")
    assert {row["person"]: row["place"] for row in rows} == {"P01": "0", "P02": "1", "P03": "2", "P04": "3"}
    assert len({row["block"] for row in rows if row["trial"] == "0"}) == 4


def test_what_does_not_fit_is_refused_and_nothing_is_changed(tmp_path: Path) -> None:
    sit(PLAN, tmp_path, "P01", most=20)
    other = parse_plan(TEXT.replace("seed = 1", "seed = 2"))
    with pytest.raises(StudyError, match="holds another plan"):
        Session(other, tmp_path, "P01")
    with pytest.raises(StudyError, match="channel is 'headphones', by the plan it is 'handle'"):
        Session(replace(PLAN, channel="handle"), tmp_path, "P01")
    for person in ("", "1", "NA", "P 01", "é", "T"):
        with pytest.raises(StudyError, match="person: "):
            Session(PLAN, tmp_path, person)
    path = tmp_path / "results.csv"
    good = path.read_bytes().decode()
    lines = good.split("\r\n")
    for column, value, said in (
        ("trial", "7", "trial is '7', by the plan it is"),
        ("block", "other", "block is 'other'"),
        ("answer", "9", "answer: 9 is out of range"),
        ("answer", "x", "answer must be a whole number"),
    ):
        fields = lines[3].split(",")
        fields[COLUMNS.index(column)] = value
        path.write_text("\r\n".join([*lines[:3], ",".join(fields), *lines[4:]]), encoding="utf-8", newline="")
        with pytest.raises(StudyError, match=said):
            Session(PLAN, tmp_path, "P01")
    path.write_text(good, encoding="utf-8", newline="")
    with Session(PLAN, tmp_path, "P01") as session:
        assert session.done == 20
        with pytest.raises(StudyError, match="choice must be from 0 to"):
            session.answer(99, latency_s=0.5)
        for latency_s in (-1.0, float("nan"), float("inf")):
            with pytest.raises(StudyError, match="latency_s"):
                session.answer(0, latency_s=latency_s)
        assert session.done == 20
        with pytest.raises(StudyError, match="another session"):
            Session(PLAN, tmp_path, "P02")
    (tmp_path / "plan.toml").unlink()
    with pytest.raises(StudyError, match=r"has answers, but not their plan\.toml"):
        Session(PLAN, tmp_path, "P01")


def test_a_recording_or_swatch_that_has_changed_is_refused(tmp_path: Path) -> None:
    """Everybody hears the same: it is looked at by content, whoever goes on or begins."""
    shipped = swatch_place("wood").read_bytes()
    mine, recording = tmp_path / "mine.swatch", tmp_path / "oak ä.csv"
    mine.write_bytes(shipped)
    recording.write_bytes(b"1,2,3\n")
    text = TEXT.split("[[blocks]]")[0].replace('swatch = "wood"\nlife', 'swatch = "mine.swatch"\nlife')
    text += '[stimuli.real]\nrecording = "oak ä.csv"\n'
    text += '[[blocks]]\nname = "b"\nkind = "rating"\nstimuli = ["alive", "steady", "real"]\nrepeats = 2\n'
    plan, folder = parse_plan(text, folder=tmp_path), tmp_path / "out"
    sit(plan, folder, "P01", 4)
    rows = answers(folder)
    assert {len(row["stimuli_sha256"]) for row in rows} == {64}
    recording.write_bytes(b"1,2,4\n")
    for person in ("P01", "P02"):
        with pytest.raises(StudyError, match=r"P01, trial \d: a recording or swatch of the plan has changed since"):
            Session(plan, folder, person)
    recording.write_bytes(b"1,2,3\n")
    mine.write_bytes(shipped.replace(b'"name"', b' "name"', 1))
    with pytest.raises(StudyError, match="has changed since"):
        Session(plan, folder, "P01")
    mine.write_bytes(shipped)
    sit(plan, folder, "P01")
    assert answers(folder)[:4] == rows and len(answers(folder)) == 6


def test_a_folder_holds_one_plan(tmp_path: Path) -> None:
    folder, other = tmp_path / "out", parse_plan(TEXT.replace("seed = 1", "seed = 2"))
    Session(PLAN, folder, "P01").close()
    with pytest.raises(StudyError, match="holds another plan"):
        Session(other, folder, "P01")
    assert (folder / "plan.toml").read_bytes() == PLAN.content
