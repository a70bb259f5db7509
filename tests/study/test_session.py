"""Sessions: every answer is saved, and an interrupted session resumes in the same order."""

from pathlib import Path

import pytest
from msgspec.structs import replace

from hapscene.errors import StudyError
from hapscene.study.plan import Plan, parse_plan
from hapscene.study.session import COLUMNS, Session, load_rows
from hapscene.study.trial_order import Trial
from hapscene.swatches.library import swatch_place

from .plans import TEXT

PLAN = parse_plan(TEXT.replace("trials = 20", "trials = 6"))
AT_TIMES = ("time", "latency_s")


def choice(trial: Trial) -> int:
    """An answer that follows from the trial alone, a mixture of right and wrong."""
    return (trial.number * 7 + trial.number // 3) % len(trial.choices)


def answer_trials(plan: Plan, folder: Path, person: str, most: int = 1000) -> None:
    """Answer at most `most` trials."""
    with Session(plan, folder, person) as session:
        while session.trial is not None and most > 0:
            session.answer(choice(session.trial), latency_s=0.5)
            most -= 1


def answers(folder: Path) -> list[dict[str, str]]:
    return [{n: v for n, v in row.items() if n not in AT_TIMES} for row in load_rows(folder / "results.csv")]


@pytest.fixture(scope="module")
def complete(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, str]]:
    """The answers of an uninterrupted session."""
    folder = tmp_path_factory.mktemp("complete")
    answer_trials(PLAN, folder, "P01")
    return answers(folder)


def test_every_answer_is_a_row(complete: list[dict[str, str]]) -> None:
    assert [int(row["trial"]) for row in complete] == list(range(PLAN.trial_count))
    assert {row["plan_sha256"] for row in complete} == {PLAN.sha256}
    for row in complete:
        rated, right = row["kind"] == "rating", row["correct_answer"]
        assert (row["rating"] != "NA") == rated == (row["correct"] == "NA") == (right == "NA")
        assert rated or (row["correct"] == "1") == (row["answer"] == right)
        assert not rated or row["choice"] == row["rating"] == str(int(row["answer"]) + 1)
        assert (row["level"] != "NA") == (row["parameter"] == "gain_dB") == (row["kind"] == "staircase")


@pytest.mark.nightly
def test_interruptions_do_not_change_the_session(complete: list[dict[str, str]], tmp_path: Path) -> None:
    for done in range(len(complete)):
        with Session(PLAN, tmp_path, "P01") as session:
            assert (session.done, session.total) == (done, len(complete))
            session.answer(choice(session.trial), latency_s=0.5)
    with Session(PLAN, tmp_path, "P01") as session:
        assert session.trial is None
        with pytest.raises(StudyError):
            session.answer(0, latency_s=0.5)
    assert answers(tmp_path) == complete


def test_participants_get_successive_rows_of_the_square(tmp_path: Path) -> None:
    plan = parse_plan(TEXT.replace('"staircase"', '"rating"').split('stimulus = "alive"')[0] + 'stimuli = ["alive"]')
    for person in ("P01", "P02", "P01", "P03", "P04"):
        answer_trials(plan, tmp_path, person, most=40 if person == "P04" else 5)
    rows = load_rows(tmp_path / "results.csv")
    assert {row["person"]: row["place"] for row in rows} == {"P01": "0", "P02": "1", "P03": "2", "P04": "3"}
    assert len({row["block"] for row in rows if row["trial"] == "0"}) == 4


def test_inconsistent_files_and_arguments_are_refused(tmp_path: Path) -> None:
    answer_trials(PLAN, tmp_path, "P01", most=20)
    other = parse_plan(TEXT.replace("seed = 1", "seed = 2"))
    with pytest.raises(StudyError, match=r"plan\.toml"):
        Session(other, tmp_path, "P01")
    assert (tmp_path / "plan.toml").read_bytes() == PLAN.content
    with pytest.raises(StudyError, match="channel"):
        Session(replace(PLAN, channel="handle"), tmp_path, "P01")
    for person in ("", "1", "NA", "P 01", "é", "T"):
        with pytest.raises(StudyError, match="person: "):
            Session(PLAN, tmp_path, person)
    path = tmp_path / "results.csv"
    good = path.read_bytes().decode()
    lines, kept = good.split("\r\n"), []
    for column, value, expected in (
        ("trial", "7", "trial"),
        ("block", "other", "block"),
        ("answer", "9", "answer 9"),
        ("answer", "x", "answer is .x."),
    ):
        fields = lines[3].split(",")
        fields[COLUMNS.index(column)] = value
        path.write_text("\r\n".join([*lines[:3], ",".join(fields), *lines[4:]]), encoding="utf-8", newline="")
        with pytest.raises(StudyError, match=expected) as caught:
            Session(PLAN, tmp_path, "P01")
        kept.append(caught)  # an error that is kept does not keep the file open
    path.write_text(good, encoding="utf-8", newline="")
    with Session(PLAN, tmp_path, "P01") as session:
        assert session.done == 20
        with pytest.raises(StudyError, match="choice 99"):
            session.answer(99, latency_s=0.5)
        for latency_s in (-1.0, float("nan"), float("inf")):
            with pytest.raises(StudyError, match="latency_s"):
                session.answer(0, latency_s=latency_s)
        assert session.done == 20
        with pytest.raises(StudyError, match="in use"):
            Session(PLAN, tmp_path, "P02")
    Session(PLAN, tmp_path, "P02").close()
    assert session.done == 20 and len(kept) == 4
    (tmp_path / "plan.toml").unlink()
    with pytest.raises(StudyError, match=r"plan\.toml"):
        Session(PLAN, tmp_path, "P01")


def test_a_recording_or_swatch_that_has_changed_is_refused(tmp_path: Path) -> None:
    """All participants must get the same stimuli; files are compared by content."""
    shipped = swatch_place("wood").read_bytes()
    mine, recording = tmp_path / "mine.swatch", tmp_path / "oak ä.csv"
    mine.write_bytes(shipped)
    recording.write_bytes(b"1,2,3\n")
    text = TEXT.split("[[blocks]]")[0].replace('swatch = "wood"\nlife', 'swatch = "mine.swatch"\nlife')
    text += '[stimuli.real]\nrecording = "oak ä.csv"\n'
    text += '[[blocks]]\nname = "b"\nkind = "rating"\nstimuli = ["alive", "steady", "real"]\nrepeats = 2\n'
    plan, folder = parse_plan(text, folder=tmp_path), tmp_path / "out"
    answer_trials(plan, folder, "P01", 4)
    rows = answers(folder)
    assert {len(row["stimuli_sha256"]) for row in rows} == {64}
    recording.write_bytes(b"1,2,4\n")
    for person in ("P01", "P02"):
        with pytest.raises(StudyError, match=r"P01, trial \d: .* has changed"):
            Session(plan, folder, person)
    recording.write_bytes(b"1,2,3\n")
    mine.write_bytes(shipped.replace(b'"name"', b' "name"', 1))
    with pytest.raises(StudyError, match="has changed"):
        Session(plan, folder, "P01")
    mine.write_bytes(shipped)
    answer_trials(plan, folder, "P01")
    assert answers(folder)[:4] == rows and len(answers(folder)) == 6
