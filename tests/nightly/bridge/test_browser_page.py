"""The page of examples/engines/browser in Chromium, against a real `hapscene serve`."""

import os
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

pytest.importorskip("websockets", reason="websockets is not installed: pip install 'hapscene[serve]'")
pytest.importorskip("playwright", reason="playwright is not installed: pip install 'hapscene[dev]'")
from playwright.sync_api import Browser, Page, expect

from tests.bridge.served import Served

FOLDER = Path(__file__).resolve().parents[3] / "examples" / "engines" / "browser"


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *what: Any) -> None:
        pass


@pytest.fixture
def page(browser: Browser, tmp_path: Path) -> Iterator[Page]:
    served = Served(tmp_path, "--ws", "0")
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=os.fspath(FOLDER))) as files:
        Thread(target=files.serve_forever, daemon=True).start()
        page = browser.new_page()
        page.goto(f"http://127.0.0.1:{files.server_port}/?port={served.ws.rpartition(':')[2]}")
        yield page
        page.close()
        files.shutdown()
    served.process.kill()
    served.process.wait()


def test_a_page_adds_paints_tunes_and_removes(page: Page) -> None:
    rows, text = page.locator("#bodies tr"), page.locator("#text")
    expect(rows).to_have_count(1, timeout=120_000)
    page.click("#add button")
    expect(rows).to_have_count(2)
    expect(rows.nth(1)).to_contain_text("box, 12 faces")  # closed, and wound outward: no note
    rows.nth(1).locator("select").select_option("leather")
    expect(page.locator("#tune option")).to_have_text(["plain", "wood", "leather"])
    page.locator("#tune select").select_option("wood")
    page.locator("#tune input").fill("300")
    expect(text).to_have_text("done: tune")
    page.click("#resume")
    expect(text).to_contain_text("never started")
    expect(text).to_have_class("wrong")
    if "HAPSCENE_PICTURE" in os.environ:
        page.screenshot(path=os.environ["HAPSCENE_PICTURE"])
    rows.nth(1).locator("button").click()
    expect(rows).to_have_count(1)
