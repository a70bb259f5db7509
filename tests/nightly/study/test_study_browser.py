"""The page of a study in Chromium, as a participant uses it."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("websockets", reason="websockets is not installed: pip install 'hapscene[serve]'")

from hapscene.study.session import load_rows
from tests.chromium import AXE, AXE_RUN
from tests.study.test_study_server import Asked, ask
from tests.until import until

__all__ = ["ask"]  # fixtures


@pytest.mark.parametrize(("scheme", "width"), [("light", 1000), ("dark", 390)])
def test_answers_by_keys_and_buttons(
    ask: Callable[..., Asked], browser: Any, scheme: str, width: int, tmp_path: Path
) -> None:
    server, session, _ = ask()
    with browser.new_context(viewport={"width": width, "height": 844}, color_scheme=scheme) as context:
        context.set_default_timeout(120_000)
        tab, wrong = context.new_page(), []
        tab.on("pageerror", lambda error: wrong.append(str(error)))
        tab.goto(server.url)

        def looked_at(screen: str) -> None:
            tab.wait_for_selector(f"#{screen}:not([hidden])")
            if AXE.is_file():
                tab.evaluate(AXE.read_text(encoding="utf-8"))
                assert tab.evaluate(AXE_RUN) == [], screen
            assert tab.evaluate("document.documentElement.scrollWidth <= innerWidth"), screen

        looked_at("begin")
        assert "free will" in tab.inner_text("#consent")
        tab.click("text=I agree; begin")
        tab.wait_for_selector("#trial:not([hidden])")
        looks, asked = set(), 0
        while session.trial is not None:
            state = server.state()
            tab.wait_for_function("(n) => study.state.number === n", arg=state["number"])
            if state["kind"] not in looks:
                looked_at("trial")
                looks.add(state["kind"])
            assert tab.locator("#choices button:enabled").count() == 0
            tab.keyboard.press("2")
            tab.keyboard.press("Space")
            tab.wait_for_selector("#choices button:enabled")
            before = session.done
            if asked % 2:
                tab.locator("#choices button").nth(1).click()
            else:
                tab.keyboard.press("2")
            until(lambda: session.done != before)  # noqa: B023
            asked += 1
            if asked == 5:  # the tab was closed
                tab.reload()
                tab.wait_for_selector("#trial:not([hidden])")
        looked_at("end")
        assert wrong == [] and looks == {"rating", "pair"}
    rows = load_rows(tmp_path / "answers" / "results.csv")
    assert len(rows) == 8 and {row["answer"] for row in rows} == {"1"}
    assert all(0.0 <= float(row["latency_s"]) < 120.0 for row in rows)


def test_response_time_starts_at_the_end_of_playback(ask: Callable[..., Asked], browser: Any, tmp_path: Path) -> None:
    server, session, player = ask()
    with browser.new_context() as context:
        context.set_default_timeout(120_000)
        tab = context.new_page()
        tab.goto(server.url)
        tab.click("#begin-button")
        tab.wait_for_selector("#trial:not([hidden])")
        player.free.clear()
        tab.keyboard.press("Space")
        time.sleep(3.0)  # playing
        player.free.set()
        tab.wait_for_selector("#choices button:enabled")
        ended_s = time.monotonic()
        time.sleep(0.5)
        tab.locator("#choices button").first.click()
        until(lambda: session.done == 1)
        most_s = time.monotonic() - ended_s
    latency_s = float(load_rows(tmp_path / "answers" / "results.csv")[0]["latency_s"])
    assert 0.5 <= latency_s < most_s + 2.5  # playback is not included
