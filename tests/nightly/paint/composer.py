"""Controls the page of `hapscene paint`, which runs in a separate process, in a real browser."""

import base64
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.until import until

PATIENCE_S = 180.0
"""Longest wait for any step on a busy machine [s]."""

DROP = """(files) => {
  const carried = new DataTransfer();
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  for (const [name, text] of files) carried.items.add(new File([bytes(text)], name));
  document.body.dispatchEvent(new DragEvent("drop", { dataTransfer: carried, bubbles: true, cancelable: true }));
}"""

ROWS = "[...document.querySelectorAll('.hs-bodies [role=treeitem]')].map(n => n.firstChild.textContent)"


class Composer:
    """A tab of a browser on the page of `hapscene paint`, at the tab Bodies."""

    def __init__(self, browser: Any, url: str) -> None:
        self.tab = browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
        self.tab.set_default_timeout(1e3 * PATIENCE_S)
        self.troubles: list[str] = []
        self.tab.on("pageerror", lambda error: self.troubles.append(str(error)))
        self.tab.goto(url)
        self.wait("window.hapscene && window.hapscene.client() >= 0 && window.hapscene.state.tool")

    def wait(self, script: str) -> None:
        self.tab.wait_for_function(script)

    def bodies(self, *names: str) -> None:
        """Wait until the tree has these bodies."""
        until(lambda: self.tab.evaluate(ROWS) == list(names))

    def see_bodies(self) -> None:
        self.tab.get_by_role("tab", name="Bodies").click()
        self.tab.wait_for_selector(".hs-bodies [role=treeitem]")

    def drop(self, *files: Path) -> None:
        """Drop files onto the page."""
        contents = [[file.name, base64.b64encode(file.read_bytes()).decode()] for file in files]
        self.tab.evaluate(DROP, contents)

    def press(self, act: str, body: str) -> None:
        self.tab.locator(f'[data-body-act="{act}"][data-body="{body}"]').first.click()

    def choose(self, body: str) -> None:
        """Select a body and wait until its fields appear."""
        self.press("choose", body)
        self.tab.wait_for_selector(f'[data-body-set="name"][data-body="{body}"]')

    def put(self, field: str, value: str) -> None:
        """Type into a field of the selected body."""
        at = self.tab.locator(f'input[data-body-set="{field}"]')
        at.fill(value)
        at.press("Enter")

    def value(self, field: str) -> str:
        return str(self.tab.locator(f'[data-body-set="{field}"]').input_value())

    def has(self, field: str, value: str) -> None:
        """Wait until a field of the selected body shows a value."""
        self.wait(f"document.querySelector('[data-body-set=\"{field}\"]')?.value === {value!r}")

    def did(self, what: str) -> None:
        """Wait until this is the step that undo would revert."""
        self.wait(f"(window.hapscene.state.undo || '').includes({what!r})")


@contextmanager
def painter(folder: Path, *words: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Run `hapscene paint` in a separate process; yield the process and its URL."""
    command = [sys.executable, "-m", "hapscene", "paint", *words, "--port", "0", "--no-browser"]
    with subprocess.Popen(command, stdout=-1, stderr=-1, text=True, cwd=folder) as process:
        try:
            assert process.stdout is not None and process.stderr is not None
            end_s = time.monotonic() + 120.0
            while "http://127.0.0.1:" not in (line := process.stdout.readline()):
                assert time.monotonic() < end_s and process.poll() is None, process.stderr.read()
            yield process, line.split()[0]
        finally:
            process.kill()
