"""The report: whole, safe to open, and right about a recording whose truth is known."""

import time
from pathlib import Path

from hapscene.capture import load_recording
from hapscene.capture.report.page import report
from hapscene.swatches.library import load_swatch
from tests.capture.report.test_page import Page

VOID = {"meta", "line", "circle", "rect", "path", "use", "image"}


def test_a_report_on_a_real_recording(shared: Path) -> None:
    folder = shared / "data" / "recordings"
    units = {"acceleration": "m/s2", "force": "N", "speed": "mm/s"}
    real = load_recording(folder / "cdp_wood.csv", 1e4, columns={"acceleration": "accel"}, units=units)
    start = time.process_time()  # of this process: the machine may be busy
    text = report(load_swatch("wood"), real, "cdp_wood.csv")
    assert time.process_time() - start < 10.0
    assert "✓ good" in text and len(text) < 2_000_000
    Page(text)
