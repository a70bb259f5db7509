"""Chromium for tests of pages, and axe-core, which looks for what hinders people in one."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from hapscene_benchmarks.paint_browser import ARGUMENTS, find_chromium

AXE = Path(__file__).parents[1] / "build" / "node" / "node_modules" / "axe-core" / "axe.min.js"

AXE_RUN = """() => axe.run(document, {resultTypes: ['violations']}).then(found => found.violations
  .map(rule => `${rule.id}: ${rule.nodes.map(node => node.html.slice(0, 200)).join(', ')}`))"""
"""All that axe-core finds, of whatever weight."""


@contextmanager
def launched() -> Iterator[Any]:
    """A browser, or the test is skipped, saying what is missing."""
    sync = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: pip install 'hapscene[dev]'")
    if find_chromium() is None:
        pytest.skip("no Chromium here: apt-get install chromium")
    with sync.sync_playwright() as runner:
        browser = runner.chromium.launch(executable_path=find_chromium(), args=list(ARGUMENTS))
        yield browser
        browser.close()
