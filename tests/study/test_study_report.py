"""The study report: its numbers are those of the statistics."""

import re
from collections.abc import Callable
from html import unescape
from pathlib import Path

import pytest

pytest.importorskip("questplus", reason="questplus is not installed: pip install 'hapscene[study]'")

from hapscene.errors import StudyError
from hapscene.study.plan import parse_plan
from hapscene.study.session import Session
from hapscene.study.statistics import Estimate, analyse
from hapscene.study.study_report import format_estimate, report, write_report

from .people import Truth, simulate

pytestmark = pytest.mark.nightly

PLAN = """
title = "<b>Surfaces</b> & more"
people = 8
[stimuli.alive]
swatch = "wood"
[stimuli.steady]
swatch = "wood"
life = false
[[blocks]]
name = "real"
kind = "rating"
stimuli = ["alive", "steady"]
repeats = 3
question = "How <i>real</i>?"
[[blocks]]
name = "noticed"
kind = "2ifc"
pairs = [["alive", "steady"]]
repeats = 8
margin = 1.0
[[blocks]]
name = "stronger"
kind = "2ifc"
pairs = [["alive", "steady"]]
repeats = 8
[[blocks]]
name = "gain"
kind = "staircase"
stimulus = "alive"
parameter = "gain_dB"
levels = [0.5, 8.0, 12]
trials = 12
"""

TRUTH = Truth({"alive": 2.0, "steady": 0.0}, {"alive": 5.0, "steady": 3.0}, {"gain": 2.0}, spread=0.3)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study") / "answers"
    simulate(parse_plan(PLAN), folder, people=8, truth=TRUTH, seed=1)
    return folder


@pytest.fixture(scope="module")
def page(folder: Path) -> str:
    return report(folder)


@pytest.fixture
def answered(tmp_path: Path) -> Callable[..., Path]:
    """A folder in which one participant has given `count` correct answers."""

    def answer(count: int, text: str = PLAN) -> Path:
        with Session(parse_plan(text), tmp_path / "answers", "P01") as session:
            for _ in range(count):
                assert session.trial is not None
                session.answer(session.trial.correct or 0, latency_s=2.5, replays=1)
        return tmp_path / "answers"

    return answer


def text_of(page: str) -> str:
    return " ".join(unescape(re.sub("<[^>]*>", " ", re.sub(r"(?s)<(style|svg).*?</\1>", " ", page))).split())


def test_numbers_are_those_of_the_statistics(folder: Path, page: str) -> None:
    page, findings = text_of(page), analyse(folder).findings
    together = [one for one in findings if not one.person]
    assert {one.quantity for one in together} >= {"threshold", "d′", "right", "rating", "difference of ratings"}
    for one in together:
        assert f"{one.quantity} {format_estimate(one.estimate, one.unit)}" in page, one
    judged = [one for one in findings if one.verdict]
    assert {(one.block, one.quantity) for one in judged} == {
        ("real", "difference of ratings"),
        ("noticed", "d′"),
        ("stronger", "d′"),
    }
    for one in judged:
        assert f"{one.block}, {one.what}: {one.verdict} ({one.method})" in page, one


def test_the_page_has_no_scripts_and_loads_nothing(page: str) -> None:
    assert "<script" not in page and "<b>" not in page and "&lt;b&gt;Surfaces&lt;/b&gt; &amp; more" in page
    assert not re.findall(r'(?:src|href)="(?!#|data:)[^"]*"', page) and "default-src 'none'" in page


def test_a_single_participant(answered: Callable[..., Path]) -> None:
    page = text_of(report(answered(34)))
    assert "1 of 8 participants; 34 answers" in page
    assert "P01 34 of 34 2.5 s" in page and "(−∞ to ∞)" in page


def test_a_report_needs_answers(tmp_path: Path) -> None:
    with Session(parse_plan(PLAN), tmp_path / "a", "P01"):
        pass
    with pytest.raises(StudyError, match="no answers yet"):
        write_report(tmp_path / "a", tmp_path / "report.html")
    assert not (tmp_path / "report.html").exists()


def test_format_estimate() -> None:
    assert format_estimate(Estimate(1.234, -0.5, 2.0), "dB") == "1.23 dB (−0.5 to 2)"
    assert format_estimate(Estimate(3.0, -float("inf"), 4.0)) == "3 (−∞ to 4)"
