"""What happens to a contact, found in the rows of ticks: it begins, taps, comes to another body or swatch, ends."""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

__all__ = ["ContactEvent", "events_of"]

Kind = Literal["began", "crossed", "ended"]


class ContactEvent(NamedTuple):
    """A change.

    Attributes:
        tick: in which.
        kind: began, crossed (another body or swatch, without leaving the surface) or ended.
        body, swatch: that is touched, or was left.
        approach_m_s: speed into the surface, where a contact began: how hard the tap.
    """

    tick: int
    kind: Kind
    body: str
    swatch: str
    approach_m_s: float


def events_of(
    rows: Any, first: int, since: int, body_names: Sequence[str], swatch_names: Sequence[str]
) -> list[ContactEvent]:
    """The events from tick `since` on among ticks (n,) ROW, of which the first is number `first`.

    What was touched before the first is not known, unless it is number 0: what goes on from there is no event.
    """
    found = []
    before = (-1, -1)
    for tick, row in enumerate(zip(*(rows[name].tolist() for name in _NAMES), strict=True), first):
        body, swatch, began, approach_m_s = row
        now = body, swatch
        if tick == first > 0:
            before = now
        kind: Kind | None = None
        if now[0] >= 0 and (began or before[0] < 0):
            kind = "began"
        elif now[0] < 0 <= before[0]:
            kind = "ended"
        elif now != before and now[0] >= 0:
            kind = "crossed"
        if kind is not None and tick >= since:
            at = before if kind == "ended" else now
            name = swatch_names[at[1]] if at[1] < len(swatch_names) else ""
            speed = approach_m_s if kind == "began" else 0.0
            found.append(ContactEvent(tick, kind, body_names[at[0]], name, speed))
        before = now
    return found


_NAMES = ("body", "swatch", "began", "approach_m_s")
