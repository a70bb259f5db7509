"""Plain help pages: two columns, wrapped to the terminal's width."""

import re
import shutil
import textwrap
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from cyclopts.help import HelpEntry, HelpPanel

__all__ = ["HelpFormatter"]

LABEL_MAX: Final = 22
"""Longest label that stands beside its text [characters]; longer ones get a line of their own."""

WIDTH_MAX: Final = 100
"""Longest line of wrapped text [characters], however wide the terminal is."""

METAVARS: Final = {"STR": "NAME", "PATH": "FILE", "INT": "COUNT", "FLOAT": "NUMBER"}
"""What a value is called, by the type that cyclopts names."""

HIDDEN_DEFAULTS: Final = (None, "", '""', "()", "False")


class HelpFormatter:
    """Prints a help page for cyclopts, without the boxes and colours of its own formatter.

    Args:
        summaries: one line for each command that is not imported to print the list.
    """

    def __init__(self, summaries: Mapping[str, str]) -> None:
        self._summaries = summaries

    def render_usage(self, console: object, options: object, usage: object) -> None:
        """Print the usage line."""
        print(f"usage: {str(usage).strip()}\n")

    def render_description(self, console: object, options: object, description: Any) -> None:
        """Print a command's docstring up to its arguments: summary, details, examples. Its lines stay as they are."""
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
        """The names of a command or an option, and its text."""
        label = ", ".join(entry.display_labels_with_metavar)
        label = re.sub(r"\b[A-Z]+\b", lambda word: METAVARS.get(word[0], word[0]), label)
        return label, _description(entry) or self._summaries.get(label, "")


def _description(entry: "HelpEntry") -> str:
    """What an option is, its choices, and its default."""
    text = " ".join(_plain(entry.description).split()).removesuffix(".")
    if entry.choices and len(entry.choices) > 1:
        text += f"; one of {', '.join(entry.choices)}"
    if entry.default not in HIDDEN_DEFAULTS:
        text += f" (default: {re.sub(r'[()]|,(?= )|[.]0(?=[,)]|$)', '', str(entry.default))})"
    return text


def _plain(text: Any) -> str:
    """The characters of a text that cyclopts has wrapped for rich."""
    return getattr(getattr(text, "primary_renderable", text), "plain", "")


def _width() -> int:
    return min(shutil.get_terminal_size().columns, WIDTH_MAX)
