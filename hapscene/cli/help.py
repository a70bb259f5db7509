"""Plain-text help pages: two columns, wrapped to the width of the terminal."""

import re
import shutil
import textwrap
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from cyclopts.help import HelpEntry, HelpPanel

__all__ = ["HelpFormatter"]

LABEL_MAX: Final = 22
"""Longest label printed on the same line as its text [characters]."""

WIDTH_MAX: Final = 100
"""Longest line of wrapped text [characters]."""

METAVARS: Final = {"STR": "NAME", "PATH": "FILE", "INT": "COUNT", "FLOAT": "NUMBER"}
"""Placeholder of a value in the help, by the placeholder that cyclopts derives from the type."""

HIDDEN_DEFAULTS: Final = (None, "", '""', "()", "False")
"""Defaults that are not printed."""


class HelpFormatter:
    """Formatter of help pages for cyclopts, without boxes and colours.

    Args:
        summaries: summaries of the commands whose modules are not imported when the list is printed.
    """

    def __init__(self, summaries: Mapping[str, str]) -> None:
        self._summaries = summaries

    def render_usage(self, console: object, options: object, usage: object) -> None:
        """Print the usage line."""
        print(f"usage: {str(usage).strip()}\n")

    def render_description(self, console: object, options: object, description: object) -> None:
        """Print the docstring of a command: the wrapped summary, then details and examples with their line breaks."""
        summary, gap, more = _plain(description).partition("\n\n")
        print(textwrap.fill(summary, _width()) + gap + more.rstrip() + "\n")

    def __call__(self, console: object, options: object, panel: "HelpPanel") -> None:
        """Print a group of commands or of options."""
        if not panel.entries:
            return
        print("Options:" if panel.title == "Parameters" else f"{panel.title}:")
        rows = [self._row(entry) for entry in panel.entries]
        width = LABEL_MAX if panel.format == "parameter" else max(len(label) for label, _ in rows)
        for label, text in rows:
            indent = " " * (width + 4)
            first = f"  {label:<{width}}  "
            if len(label) > width:
                print(f"  {label}")
                first = indent
            print(textwrap.fill(text, _width(), initial_indent=first, subsequent_indent=indent) or first.rstrip())
        print()

    def _row(self, entry: "HelpEntry") -> tuple[str, str]:
        """The label of a command or option, and its text."""
        label = ", ".join(entry.display_labels_with_metavar)
        label = re.sub(r"\b[A-Z]+\b", lambda word: METAVARS.get(word[0], word[0]), label)
        return label, _description(entry) or self._summaries.get(label, "")


def _description(entry: "HelpEntry") -> str:
    """The description of an option, with its choices and default."""
    text = " ".join(_plain(entry.description).split()).removesuffix(".")
    if entry.choices and len(entry.choices) > 1:
        text += f"; one of {', '.join(entry.choices)}"
    if entry.default not in HIDDEN_DEFAULTS:
        text += f" (default: {re.sub(r'[()]|,(?= )|[.]0(?=[,)]|$)', '', str(entry.default))})"
    return text


def _plain(text: object) -> str:
    """The plain text inside an object that cyclopts has wrapped for rich."""
    return getattr(getattr(text, "primary_renderable", text), "plain", "")


def _width() -> int:
    return min(shutil.get_terminal_size().columns, WIDTH_MAX)
