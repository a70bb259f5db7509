"""The web site is built without a warning; links, search, examples and command lines on it work."""

import ast
import contextlib
import io
import json
import os
import re
import shlex
import subprocess
import sys
from html.parser import HTMLParser
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

pytest.importorskip("mkdocs", reason="mkdocs is not installed: pip install 'hapscene[docs]'")

import hapscene
import hapscene.errors
from tests.cli.command_lines import all_commands, parse

ROOT = Path(__file__).resolve().parents[2]

RUN_ELSEWHERE = "tutorials/"
"""tests/nightly/test_tutorials.py runs the programs of these pages, with the commands between them."""

GLOSSARY = re.compile(r"(?m)^\*\*(.+?)\*\*")
"""A term of the glossary."""


class Document(HTMLParser):
    """Anchors, links and blocks of code of a page."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[tuple[str, str]] = []  # tag, address
        self.blocks: list[tuple[str, str]] = []  # classes, text
        self._classes = ""
        self._text: list[str] | None = None
        self.feed(file.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        has = {name: value or "" for name, value in attrs}
        self.anchors |= {has[name] for name in ("id", "name") if name in has}
        self.links += [(tag, has[name]) for name in ("href", "src", "srcset", "poster") if name in has]
        if tag == "div":
            self._classes = has.get("class", "")
        elif tag == "pre":
            self._text = []

    def handle_data(self, data: str) -> None:
        if self._text is not None:
            self._text.append(data)

    def handle_endtag(self, tag: str) -> None:
        if tag == "pre" and self._text is not None:
            if "doc-signature" not in self._classes:
                self.blocks.append((self._classes, "".join(self._text)))
            self._text = None


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the site; mkdocs.yml turns a warning into an error."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--site-dir", str(folder)]
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def documents(site: Path) -> dict[str, Document]:
    """The pages of the site by their path."""
    return {file.relative_to(site).as_posix(): Document(file) for file in sorted(site.rglob("*.html"))}


def public_names() -> list[str]:
    """Public names of hapscene and of its public modules, by the path of their import."""
    names = [f"hapscene.{name}" for name in ("errors", *hapscene.__all__)]
    modules = [hapscene, *(import_module(name) for name in names if find_spec(name))]
    return [f"{module.__name__}.{name}" for module in modules for name in getattr(module, "__all__", ())]


def is_python(classes: str, text: str) -> bool:
    """Whether a block of code is an example in Python: marked as such, or Python code that imports or calls."""
    if "language-python" in classes.split():
        return True
    with contextlib.suppress(SyntaxError):
        return any(isinstance(node, ast.Import | ast.ImportFrom | ast.Call) for node in ast.walk(ast.parse(text)))
    return False


def test_readme_is_the_first_page_and_every_document_has_one(documents: dict[str, Document]) -> None:
    folder = ROOT / "docs"
    pages = {file.relative_to(folder).with_suffix(".html").as_posix() for file in folder.rglob("*.md")}
    assert pages | {"index.html", "contributing.html", "changelog.html"} <= documents.keys()
    assert "touch-a-mesh-in-python" in documents["index.html"].anchors


def test_the_reference_has_every_command(documents: dict[str, Document]) -> None:
    commands = {"-".join(("hapscene", *words)) for words in all_commands()}
    assert commands - documents["reference/cli.html"].anchors == set()


def test_every_link_leads_somewhere(site: Path, documents: dict[str, Document]) -> None:
    broken = []
    inside = 0
    for page, document in documents.items():
        for tag, link in document.links:
            url = urlsplit(link)
            if url.scheme or url.netloc:
                continue
            inside += 1
            base = site if url.path.startswith("/") else (site / page).parent
            file = (base / unquote(url.path).lstrip("/")).resolve() if url.path else site / page
            if file.is_dir():
                file /= "index.html"
            target = documents.get(file.relative_to(site.resolve()).as_posix())
            if not file.is_file() or (
                tag == "a" and url.fragment and url.fragment not in getattr(target, "anchors", ())
            ):
                broken.append(f"{page}: {link}")
    assert inside > 1000
    assert broken == []


def test_nothing_is_loaded_from_another_host(site: Path, documents: dict[str, Document]) -> None:
    for page, document in documents.items():
        assert [link for tag, link in document.links if tag != "a" and "//" in link] == [], page
    for style in site.rglob("*.css"):
        assert not re.search(r"@import|url\(['\"]?(https?:)?//", style.read_text(encoding="utf-8")), style


def test_every_public_name_stands_on_it(documents: dict[str, Document]) -> None:
    anchors = set().union(*(document.anchors for page, document in documents.items() if "reference/" in page))
    names = public_names()
    assert {"hapscene.Renderer", "hapscene.capture.fit_swatch"} <= set(names)
    errors = [value for value in vars(hapscene.errors).values() if isinstance(value, type)]
    assert {f"hapscene.errors.{error.__name__}" for error in errors if issubclass(error, Exception)} <= set(names)
    assert [name for name in names if name not in anchors] == []


def test_search_finds_words_and_names(site: Path, documents: dict[str, Document]) -> None:
    entries = json.loads((site / "search" / "search_index.json").read_text(encoding="utf-8"))["docs"]
    texts = [f"{entry['title']} {entry['text']}".lower() for entry in entries]
    glossary = (ROOT / "docs" / "reference" / "glossary.md").read_text(encoding="utf-8")
    terms = [term for line in GLOSSARY.findall(glossary) for term in re.split(r", | \(|\)", line) if term]
    assert len(terms) > 60
    assert [term for term in terms if not any(term.lower() in text for text in texts)] == []
    titles = {entry["title"] for entry in entries}
    assert [name for name in public_names() if not {name, name.rsplit(".", 1)[1]} & titles] == []
    for entry in entries:
        page, _, anchor = entry["location"].partition("#")
        assert not anchor or anchor in documents[page or "index.html"].anchors, entry["location"]


def test_every_example_runs(documents: dict[str, Document], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The examples of a page run in their order, in a folder with the meshes and swatches of the checkout."""
    count = 0
    for page in sorted(page for page in documents if not page.startswith(RUN_ELSEWHERE)):
        folder = tmp_path / page.replace("/", "_")
        folder.mkdir()
        for name in ("assets", "swatches"):
            (folder / name).symlink_to(ROOT / name)
        monkeypatch.chdir(folder)
        names: dict[str, object] = {"__name__": "__main__"}
        for classes, text in documents[page].blocks:
            if is_python(classes, text):
                count += 1
                with contextlib.redirect_stdout(io.StringIO()):
                    exec(compile(text, page, "exec"), names)
    assert count >= 8


def test_every_command_line_is_understood(documents: dict[str, Document]) -> None:
    lines = [line for document in documents.values() for _, text in document.blocks for line in text.splitlines()]
    commands = [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("hapscene ")]
    assert len(commands) > 40
    for words in commands:
        parse(words)
    for line in lines:
        if line.startswith("python -m hapscene"):
            assert find_spec(line.split()[2]), line
