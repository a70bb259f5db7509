"""The static site in an HTML validator and in a browser."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.chromium import AXE, AXE_RUN
from tests.swatches.test_site import address, site, sources

__all__ = ["address", "site", "sources"]  # fixtures

NODE = Path(__file__).resolve().parents[3] / "build" / "node" / "node_modules"


VALIDATOR = NODE / "html-validate"


VALIDATE = """
const [, package, ...files] = process.argv, fs = require("fs");
const validator = new (require(package).HtmlValidate)({root: true, extends: ["html-validate:recommended"]});
Promise.all(files.map(file => validator.validateString(fs.readFileSync(file, "utf8"))))
    .then(reports => console.log(JSON.stringify(reports.map(r => r.results.flatMap(x => x.messages)))));
"""


@pytest.mark.skipif(shutil.which("node") is None, reason="no node here: apt-get install nodejs")
@pytest.mark.skipif(not VALIDATOR.exists(), reason="html-validate is not here: sh .ci/node-packages")
def test_pages_are_valid_html(site: Path) -> None:
    files = [file for file in sorted(site.glob("*.html")) if not file.stem.endswith("-touch")]
    requests = ["node", "-e", VALIDATE, str(VALIDATOR), *map(str, files)]
    done = subprocess.run(requests, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    reports = json.loads(done.stdout)
    assert len(reports) == len(files) == 4
    for file, messages in zip(files, reports, strict=True):
        escaped = [m for m in messages if m["ruleId"] == "long-title"]  # which counts &lt; as four characters
        assert messages == (escaped if file.name.startswith("h1") else []), file.name


@pytest.mark.skipif(not AXE.is_file(), reason="axe-core is not here: sh .ci/node-packages")
@pytest.mark.parametrize("look", ["light", "dark"])
def test_accessibility_and_width(site: Path, address: str, browser: Any, look: str) -> None:
    for width in (390, 1440):
        with browser.new_context(
            viewport={"width": width, "height": 900}, color_scheme=look, bypass_csp=True
        ) as context:
            tab = context.new_page()
            for page in sorted(site.glob("*.html")):
                tab.goto(address + page.name)
                tab.evaluate(AXE.read_text(encoding="utf-8"))
                assert tab.evaluate(AXE_RUN) == [], f"{page.name} at {width}"
                assert tab.evaluate("document.documentElement.scrollWidth") <= width, page.name


def test_sound_and_search_without_external_requests(site: Path, address: str, browser: Any) -> None:
    with browser.new_context(viewport={"width": 800, "height": 900}) as context:
        tab = context.new_page()
        requests: list[str] = []
        wrong: list[str] = []
        tab.on("request", lambda request: requests.append(request.url))
        other = ("favicon", "GL Driver Message")  # a missing icon, and notes of the software renderer
        tab.on("console", lambda m: any(o in m.location["url"] + m.text for o in other) or wrong.append(m.text))
        tab.on("pageerror", lambda error: wrong.append(str(error)))
        tab.goto(address)
        assert tab.inner_text(".here") == address
        assert [tile.is_visible() for tile in tab.locator(".tile").all()] == [True] * 3
        tab.get_by_label("Find").fill("planed wood")
        shown = [tile.inner_text().splitlines()[0] for tile in tab.locator(".tile").all() if tile.is_visible()]
        assert shown == ["oak, planed"] and tab.inner_text("output") == "1 of 3"
        tab.get_by_role("link", name="oak, planed").click()
        duration = (
            "n => new Promise(done => { n.onloadedmetadata = () => done(n.duration); n.onerror = done; n.load(); })"
        )
        assert tab.locator("audio").evaluate(duration) == pytest.approx(1.75, abs=0.01)
        frame = tab.frame_locator("iframe")
        frame.locator("html[data-ready]").wait_for(state="attached", timeout=60_000)
        assert frame.locator("#legend bdi").inner_text() == "oak, planed"
        assert requests and all(url.startswith(address) for url in requests) and wrong == []
