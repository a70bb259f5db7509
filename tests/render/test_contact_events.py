"""The contact in the row of a tick, and contact events in rows."""

import numpy as np

from hapscene.records import ROW, records
from hapscene.render.contact_info import Contact, ContactEvent, events_of


def rows_of(*ticks: tuple[int, int, int]) -> np.ndarray:
    """Return rows of (body, swatch, began), with the approach speed 0.1 times the tick number."""
    rows = records(len(ticks), ROW)
    for k, (row, (body, swatch, began)) in enumerate(zip(rows, ticks, strict=True)):
        row.body, row.swatch, row.began, row.approach_m_s = body, swatch, began, 0.1 * k
    return rows


def test_a_contact_has_the_numbers_of_its_row() -> None:
    (row,) = np.random.default_rng(1).random((1, ROW.itemsize // 8)).view(np.recarray).view(ROW)[0].view(np.recarray)
    row.body, row.swatch, row.face = 1, 0, 7
    radius_m = float(np.linalg.norm(row.p_WP_m - row.p_WC_m))
    for row.began, row.depth_m, patch_m in ((0, 0.25 * radius_m, 0.5 * radius_m), (1, 2.0 * radius_m, radius_m)):
        contact = Contact(row.tobytes(), ("box", "lid"), ("plain", "wood"))
        assert (contact.body, contact.swatch, contact.face, contact.began) == ("lid", "plain", 7, row.began == 1)
        assert (contact.depth_m, contact.slip_m_s) == (row.depth_m, row.slip_m_s)
        for name, column in (("p_W_m", "p_WC_m"), ("nhat_W", "nhat_W"), ("f_body_W_N", "f_body_W_N")):
            assert getattr(contact, name).tolist() == row[column].tolist()
        torque = np.cross(row.p_WC_m - (1.0, 2.0, 3.0), row.f_body_W_N)
        np.testing.assert_allclose(contact.tau_body_W_Nm((1.0, 2.0, 3.0)), torque)
        np.testing.assert_allclose(contact.patch_radius_m, patch_m)


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
