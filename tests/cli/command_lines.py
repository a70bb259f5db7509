"""Parsing of command lines without running them."""

from collections.abc import Iterator, Sequence
from contextlib import suppress

from cyclopts import App

from hapscene.cli import app
from hapscene.errors import HapsceneError

__all__ = ["all_commands", "parse"]


def parse(words: Sequence[str]) -> None:
    """Parse the words after `hapscene`. Raises CycloptsError for invalid ones; files may be missing."""
    with suppress(HapsceneError):
        app().parse_args(list(words))


def all_commands(tree: App | None = None, words: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The words of each command that can be run."""
    tree = app() if tree is None else tree
    if tree.default_command is not None:
        yield words
    for name in tree:
        if not name.startswith("-") and not (words == ("swatch",) and name == "search"):
            yield from all_commands(tree[name], (*words, name))
