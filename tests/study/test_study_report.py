"""The study report: its numbers are those of the statistics."""

import math
import re
from html import unescape
from pathlib import Path

import pytest

pytest.importorskip("questplus", reason="questplus is not installed: pip install 'hapscene[study]'")

from matplotlib.figure import Figure

from hapscene.errors import StudyError
from hapscene.study.session import Session
from hapscene.study.statistics import Estimate, Finding, analyse
from hapscene.study.study_report import _axis_limits, _plot, format_estimate, report, write_report

from .test_statistics import PLAN, folder

__all__ = ["folder"]  # fixtures


def text_of(page: str) -> str:
    return " ".join(unescape(re.sub("<[^>]*>", " ", re.sub(r"(?s)<(style|svg).*?</\1>", " ", page))).split())


def test_numbers_are_those_of_the_statistics(folder: Path) -> None:
    page, findings = text_of(report(folder)), analyse(folder).findings
    together = [one for one in findings if not one.person]
    assert {one.quantity for one in together} >= {"threshold", "d′", "right", "rating", "difference of ratings"}
    for one in together:
        assert f"{one.quantity} {format_estimate(one.estimate, one.unit)}" in page, one
    judged = [one for one in findings if one.verdict]
    assert {(one.block, one.quantity) for one in judged} > {("real", "difference of ratings"), ("life", "d′")}
    for one in judged:
        assert f"{one.block}, {one.what}: {one.verdict} ({one.method})" in page, one


def test_axes_contain_all_finite_values() -> None:
    open_end = Estimate(1.0, -math.inf, 2.0)
    assert _axis_limits([open_end, Estimate(3.0, 0.0, 4.0)]) == pytest.approx((-0.48, 4.48))
    assert _axis_limits([Estimate(2.0, 2.0, 2.0)]) == (1.5, 2.5)
    assert _axis_limits([Estimate(math.inf, -math.inf, math.inf)]) == (0.0, 1.0)


def test_estimates_of_a_block_are_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    figures: list[Figure] = []
    monkeypatch.setattr(
        "hapscene.study.study_report.inline_svg", lambda figure, name: figures.append(figure) or "<svg>"
    )
    open_end, closed = Estimate(1.0, -math.inf, 2.0), Estimate(0.5, 0.0, 1.0)
    found = [
        Finding("b", "x − y", who, quantity, unit, "", estimate, 5)
        for quantity, unit in (("d′", ""), ("threshold", "dB"))
        for who, estimate in (("", open_end), ("P1", closed))
    ]
    for quantity, label, more in (("d′", "d′", [([0.0, 0.0], [0.0, 1.0])]), ("threshold", "threshold [dB]", [])):
        assert "P1 x − y 0.5" in _plot(3, found, quantity)
        (axes,) = figures.pop().axes
        drawn = [tuple(map(list, line.get_data())) for line in axes.lines]
        known = [([-0.24, 2.0], [0, 0]), ([1.0], [0]), ([0.0, 1.0], [1, 1]), ([0.5], [1]), *more]
        assert drawn == [(pytest.approx(x), y) for x, y in known]
        assert [text.get_text() for text in axes.get_yticklabels()] == ["x − y", "P1  x − y"]
        assert axes.get_ylim() == (1.6, -0.6) and axes.get_xlabel() == label


def test_a_report_needs_answers_and_one_participant_has_open_intervals(tmp_path: Path) -> None:
    with Session(PLAN, tmp_path / "a", "P01") as session:
        with pytest.raises(StudyError, match="no answers yet"):
            write_report(tmp_path / "a", tmp_path / "report.html")
        assert not (tmp_path / "report.html").exists()
        while session.trial is not None:
            session.answer(session.trial.correct or 0, latency_s=2.5, replays=1)
    page = text_of(report(tmp_path / "a"))
    assert f"1 of 12 participants; {PLAN.trial_count} answers" in page
    assert "(−∞ to ∞)" in page
