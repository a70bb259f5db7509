"""Pages of benchmark, chart and paper: headings, text, pictures and tables, written as Markdown or HTML."""

import base64
import re
import textwrap
from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path
from typing import Final

from hapscene.io.files import whole_file
from hapscene.view.chart import dark_twin, picture

__all__ = ["Page", "shown", "write_page"]

STYLE: Final = """
:root { color-scheme: light dark; --line: light-dark(#d8d8d8, #444); --muted: light-dark(#606060, #a0a0a0); }
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1100px; margin: 0 auto; padding: 16px;
  color: light-dark(#1a1a1a, #e6e6e6); background: light-dark(#fff, #16181c); }
a { color: inherit; } summary { cursor: pointer; } p, dl { max-width: 95ch; }
figure { margin: 16px 0; } figure svg, figure img { max-width: 100%; height: auto; } figcaption { color: var(--muted); }
.table { overflow-x: auto; } table { border-collapse: collapse; }
th, td { text-align: left; vertical-align: top; padding: 5px 10px 5px 0; border-top: 1px solid var(--line); }
"""

POLICY: Final = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
"""Content security policy of the HTML: no external resources and no scripts."""

Part = tuple[Callable[[Path], str], Callable[[], str]]
"""A part of a page: functions that return its Markdown, with links relative to a folder, and its HTML."""


class Page:
    """A page that is filled from top to bottom. Text is plain; HTML escapes it."""

    def __init__(self, title: str) -> None:
        self.title = title
        self._parts: list[Part] = []

    def heading(self, text: str, key: str = "") -> None:
        """Add a heading; `key` is its anchor in HTML."""
        anchor = f' id="{escape(key)}"' if key else ""
        self._add(f"## {text}\n", f"<h2{anchor}>{escape(text)}</h2>")

    def text(self, text: str, strong: bool = False) -> None:
        """Add a paragraph."""
        filled = paragraph(text)
        html = f"<strong>{escaped(filled)}</strong>" if strong else escaped(filled)
        self._add(f"**{filled}**\n" if strong else f"{filled}\n", f"<p>{html}</p>")

    def markdown_only(self, text: str) -> None:
        """Add Markdown that the HTML omits."""
        self._add(text, "")

    def picture(self, path: Path, alt: str) -> None:
        """Add a picture that `hapscene.view.chart.save_both` wrote, for light and dark pages; HTML embeds it."""

        def embedded() -> str:
            light, dark = (
                f"data:image/png;base64,{base64.b64encode(file.read_bytes()).decode()}"
                for file in (path, dark_twin(path))
            )
            source = f'<source media="(prefers-color-scheme: dark)" srcset="{dark}">'
            return f'<figure><picture>{source}<img src="{light}" alt="{escape(alt)}"></picture></figure>'

        self._parts.append((lambda folder: picture(path.relative_to(folder).as_posix(), alt) + "\n", embedded))

    def drawing(self, svg: str, title: str, caption: str) -> None:
        """Add a drawing of `hapscene.view.chart.inline_svg`; Markdown omits it."""
        labelled = svg.replace("<svg", f'<svg role="img" aria-label="{escape(caption or title)}"', 1)
        text = f"<figcaption>{escape(caption)}</figcaption>"
        self._add("", f"<figure><h3>{escape(title)}</h3>{labelled}{text}</figure>")

    def table(self, head: Sequence[str], rows: Sequence[Sequence[str]], fold: str = "") -> None:
        """Add a table. With `fold` it is folded under that summary in HTML, and Markdown omits it."""
        titles = "".join(f"<th>{escaped(cell)}</th>" for cell in head)
        lines = "".join(f"<tr>{''.join(f'<td>{escaped(cell)}</td>' for cell in row)}</tr>" for row in rows)
        html = f'<div class="table"><table><tr>{titles}</tr>{lines}</table></div>'
        if fold:
            self._add("", f"<details><summary>{escape(fold)}</summary>{html}</details>")
        else:
            self._add(table(head, rows), html)

    def markdown(self, folder: Path) -> str:
        """Return the page as Markdown, to be written into `folder`."""
        parts = [part(folder) for part, _ in self._parts]
        return "\n".join([f"# {self.title}\n", *filter(None, parts)])

    def html(self) -> str:
        """Return the page as self-contained HTML."""
        body = "\n".join([f"<h1>{escape(self.title)}</h1>", *(part() for _, part in self._parts)])
        return (
            '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
            '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
            f"<title>{escape(self.title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
        )

    def _add(self, markdown: str, html: str) -> None:
        self._parts.append((lambda _: markdown, lambda: html))


def write_page(file: Path, text: str) -> None:
    """Write a page; a file that exists is replaced when the new one is complete."""
    with whole_file(file) as part:
        part.write_text(text, encoding="utf-8", newline="\n")


def escaped(text: str) -> str:
    """Return text as HTML, with `code` as an element."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(text))


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def paragraph(text: str) -> str:
    """Return text filled to lines of 120 characters."""
    return textwrap.fill(" ".join(text.split()), 120, break_long_words=False, break_on_hyphens=False)


def shown(value: float) -> str:
    """Return a number with three significant digits."""
    if value == 0.0:
        return "0"
    if abs(value) >= 100.0:
        return f"{value:,.0f}"
    return f"{value:.2e}" if abs(value) < 1e-3 else f"{value:.3g}"
