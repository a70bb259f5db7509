"""Contact events, found in the rows of ticks: a contact begins, moves to another body or swatch, or ends."""

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

__all__ = ["ContactEvent", "events_of"]

Kind = Literal["began", "crossed", "ended"]


class ContactEvent(NamedTuple):
    """One contact event.

    Attributes:
        tick: number of the tick.
        kind: "began", "crossed" (to another body or swatch without leaving the surface) or "ended".
        body, swatch: names of what is touched, or was touched if the contact ended.
        approach_m_s: speed into the surface if the contact began, otherwise 0 [m/s].
    """

    tick: int
    kind: Kind
    body: str
    swatch: str
    approach_m_s: float


def events_of(
    rows: Any, first: int, since: int, body_names: Sequence[str], swatch_names: Sequence[str]
) -> list[ContactEvent]:
    """Return the events from tick `since` on in rows (n,) ROW, of which the first is tick number `first`.

    A contact that goes on in the first row is no event, unless that row is tick 0.
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
