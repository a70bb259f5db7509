"""The system's Chromium, headless, drawn by the processor and cut off from the net; axe-core, which finds what hinders
people in a page."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

ARGUMENTS = (
    "--no-sandbox",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1",
)

AXE = Path(__file__).parents[1] / "build" / "node" / "node_modules" / "axe-core" / "axe.min.js"

AXE_RUN = """() => axe.run(document, {resultTypes: ['violations']}).then(found => found.violations
  .map(rule => `${rule.id}: ${rule.nodes.map(node => node.html.slice(0, 200)).join(', ')}`))"""
"""Script that returns all findings of axe-core, of any severity."""


def find_chromium() -> str | None:
    """The system's Chromium, or Chrome; None without one."""
    return shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@contextmanager
def launched() -> Iterator[Any]:
    """A browser of playwright's; where one is missing, the test skips."""
    sync = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: pip install 'hapscene[dev]'")
    path = find_chromium()
    if path is None:
        pytest.skip("no Chromium here: apt-get install chromium")
    with sync.sync_playwright() as runner:
        browser = runner.chromium.launch(executable_path=path, args=list(ARGUMENTS))
        yield browser
        browser.close()
