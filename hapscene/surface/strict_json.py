"""JSON from strangers: bounded in memory, every key once, no number that is none.

What a text can grow to is bounded before it is parsed: a list in a list costs 60 bytes for every 3 of text, so it is
lists, keys and values that are counted, not bytes alone.
"""

import json
from typing import Any, Final

from hapscene.errors import SwatchError

CONTAINER_MAX: Final = 50_000
"""Most opening brackets and braces of a file [count]. The largest swatch has 12,300: a row per model and triangle."""

KEY_MAX: Final = 50_000
"""Most colons of a file [count]."""

VALUE_MAX: Final = 2_500_000
"""Most commas of a file [count]. The largest texture has 1.1 million numbers, 4096 models of order 256."""


def parse(data: bytes | str, what: str) -> Any:
    """The value of a JSON text in UTF-8.

    Args:
        data: the text; the caller has bounded its length.
        what: what it should be, for messages: "a swatch".

    Raises:
        SwatchError: not JSON, not UTF-8, too many values, NaN or Infinity, a key that stands twice.
    """
    for signs, most, kind in (("[{", CONTAINER_MAX, "lists"), (":", KEY_MAX, "keys"), (",", VALUE_MAX, "values")):
        found = sum(data.count(s.encode()) if isinstance(data, bytes) else data.count(s) for s in signs)
        if found > most:
            raise SwatchError(f"not {what}: {found} {kind}, more than the {most} that one can have")
    try:
        text = data.decode("utf-8-sig") if isinstance(data, bytes) else data
        return json.loads(text, object_pairs_hook=_unique, parse_constant=_refuse)
    except SwatchError as error:
        raise SwatchError(f"not {what}: {error}") from None
    except json.JSONDecodeError as error:
        raise SwatchError(f"not {what}: {error.msg} in line {error.lineno}, column {error.colno}") from None
    except UnicodeDecodeError as error:
        raise SwatchError(f"not {what}: no UTF-8 text at byte {error.start}") from None
    except (ValueError, RecursionError) as error:
        raise SwatchError(f"not {what}: {error}") from None


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        seen: set[str] = set()
        double = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
        raise SwatchError(f"key {double[:50]!r} stands twice")
    return content


def _refuse(constant: str) -> None:
    raise SwatchError(f"{constant} is no number that a surface can have")
