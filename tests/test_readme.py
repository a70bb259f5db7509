"""What README and CONTRIBUTING show works as written."""

import json
import re
import shlex
import tomllib
from pathlib import Path

import pytest

import hapscene
from hapscene.study import parse_plan
from tests.cli.command_lines import parse

ROOT = Path(__file__).resolve().parents[1]


def test_the_program_runs_outside_of_a_checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (program,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(program, names)
    assert names["recording"].touching.any()  # type: ignore[attr-defined]


def test_linked_files_exist() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    links = re.findall(r"\]\(([^)#]+)\)", text) + re.findall(r'(?:src|srcset)="([^"]+)"', text)
    assert len(links) > 5
    assert [link for link in links if "://" not in link and not (ROOT / link).exists()] == []


def test_the_readme_is_short_and_names_existing_extras() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    extras = ",".join(re.findall(r"pip install '[^'\[]+\[([\w,]+)\]'", text)).split(",")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert len(text) <= 4500
    assert extras and set(extras) <= project["optional-dependencies"].keys()


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


def test_the_version_is_the_same_everywhere() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert hapscene.__version__ == version
    assert re.search(rf"^version: {re.escape(version)}$", citation, re.MULTILINE)
    assert f"## {version}\n" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_data_in_the_documents_is_valid() -> None:
    for page in sorted((ROOT / "docs").rglob("*.md")):
        for kind, data in re.findall(r"^```(json|toml)\n(.*?)^```$", page.read_text(encoding="utf-8"), re.S | re.M):
            read = json.loads(data) if kind == "json" else tomllib.loads(data)
            if "blocks" in read:
                assert parse_plan(data).blocks


def test_paths_of_documents_in_the_sources_exist() -> None:
    stale = []
    for folder in ("hapscene", "plugins", "examples", "evidence", "tests"):
        for file in (ROOT / folder).rglob("*"):
            if file.suffix in {".py", ".md", ".cs", ".gd", ".mjs", ".hpp", ".ino", ".html", ".js"}:
                text = file.read_text(encoding="utf-8")
                paths = re.findall(r"\bdocs/[\w/-]+\.(?:md|py)\b", text)
                stale += [f"{file.relative_to(ROOT)}: {path}" for path in paths if not (ROOT / path).exists()]
    assert stale == []
