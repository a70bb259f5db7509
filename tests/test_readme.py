"""What the README shows works as it stands there."""

import re
import shlex
from pathlib import Path

import pytest

from tests.cli.command_lines import parse

ROOT = Path(__file__).resolve().parents[1]


def test_its_snippets_run_as_written_outside_of_a_checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    ten_lines, fit = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(ten_lines, names)
    assert names["recording"].touching.any()  # type: ignore[attr-defined]
    assert names["command"].flags == 0  # type: ignore[attr-defined]
    exec(fit, names)
    assert names["variance"] > 0.0  # type: ignore[operator]


def test_files_that_it_links_to_are_there() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    links = re.findall(r"\]\(([^)#]+)\)", text)
    assert len(links) > 5
    assert [link for link in links if "://" not in link and not (ROOT / link).exists()] == []


def shown_commands(text: str) -> list[str]:
    """The lines of a document's code that call hapscene."""
    fenced = "\n".join(re.findall(r"^```\w*\n(.*?)^```$", text, re.DOTALL | re.MULTILINE))
    return re.findall(r"^hapscene .*", fenced, re.MULTILINE) + re.findall(r"^ {4}(hapscene .*)", text, re.MULTILINE)


@pytest.mark.parametrize("file", ["README.md", "CONTRIBUTING.md"])
def test_command_lines_are_understood(file: str) -> None:
    lines = shown_commands((ROOT / file).read_text(encoding="utf-8"))
    assert len(lines) >= 4
    for line in lines:
        parse(shlex.split(line, comments=True)[1:])
