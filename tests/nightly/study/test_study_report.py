"""The study report in a browser."""

from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("questplus", reason="questplus is not installed: pip install 'hapscene[study]'")
from hapscene.study.study_report import write_report
from tests.chromium import AXE, AXE_RUN
from tests.study.test_study_report import folder

__all__ = ["folder"]  # fixtures


@pytest.mark.skipif(not AXE.is_file(), reason="axe-core is not here: sh .ci/node-packages")
def test_accessibility_and_narrow_screens(folder: Path, browser: Any) -> None:
    write_report(folder, folder / "report.html")
    for scheme, width in (("light", 1200), ("dark", 390)):
        looks = {"viewport": {"width": width, "height": 844}, "color_scheme": scheme, "bypass_csp": True}
        with browser.new_context(**looks) as context:
            tab = context.new_page()
            tab.goto((folder / "report.html").as_uri())
            tab.evaluate(AXE.read_text(encoding="utf-8"))
            assert tab.evaluate(AXE_RUN) == [], scheme
            assert tab.evaluate("document.documentElement.scrollWidth <= innerWidth"), scheme
