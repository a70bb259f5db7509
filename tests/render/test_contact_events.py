"""Contact events in the rows of ticks."""

import numpy as np

from hapscene.records import ROW, records
from hapscene.render.contact_info import ContactEvent, events_of


def rows_of(*ticks: tuple[int, int, int]) -> np.ndarray:
    """Return rows of (body, swatch, began), with the approach speed 0.1 times the tick number."""
    rows = records(len(ticks), ROW)
    for k, (row, (body, swatch, began)) in enumerate(zip(rows, ticks, strict=True)):
        row.body, row.swatch, row.began, row.approach_m_s = body, swatch, began, 0.1 * k
    return rows


def test_a_contact_begins_crosses_and_ends() -> None:
    rows = rows_of((-1, -1, 0), (0, 1, 1), (0, 1, 0), (0, 0, 0), (1, 0, 0), (-1, -1, 0), (1, 1, 1), (1, 1, 1))
    names = ("box", "lid"), ("plain", "wood")
    assert events_of(rows, 10, 0, *names) == [
        ContactEvent(11, "began", "box", "wood", 0.1),
        ContactEvent(13, "crossed", "box", "plain", 0.0),
        ContactEvent(14, "crossed", "lid", "plain", 0.0),
        ContactEvent(15, "ended", "lid", "plain", 0.0),
        ContactEvent(16, "began", "lid", "wood", 0.6000000000000001),
        ContactEvent(17, "began", "lid", "wood", 0.7000000000000001),
    ]


def test_contact_that_continues_is_no_event() -> None:
    names = ("box", "lid"), ("plain", "wood")
    touching = rows_of((0, 1, 0), (0, 1, 0), (-1, -1, 0))
    assert [event.kind for event in events_of(touching, 9000, 20, *names)] == ["ended"]
    assert [event.kind for event in events_of(touching, 0, 0, *names)] == ["began", "ended"]
    assert [event.kind for event in events_of(rows_of((0, 1, 1)), 9000, 20, *names)] == ["began"]


def test_events_read_in_parts_are_complete() -> None:
    rng = np.random.default_rng(5)
    body = rng.integers(-1, 2, 300)
    rows = rows_of(*((int(b), int(b), 0) for b in body))
    names = ("box", "lid"), ("plain", "wood")
    whole, found, since = events_of(rows, 0, 0, *names), [], 0
    for stop in (1, 2, 57, 58, 200, 300):
        first = max(since - 1, 0)
        found += events_of(rows[first:stop], first, since, *names)
        since = stop
    assert found == whole and len(whole) > 100
