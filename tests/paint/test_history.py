"""The undo history restores packed states and limits its memory."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from hapscene.paint.model import history as module
from hapscene.paint.model.history import FaceDelta, History, Step, pack_steps, unpack_steps


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 2_000_000), st.integers(0, 32767), st.integers(0, 32767)), max_size=50))
def test_delta_is_unpacked_exactly(rows) -> None:
    rows = sorted({face: (face, old, new) for face, old, new in rows}.values())
    faces, old, new = (np.array([row[k] for row in rows], dtype) for k, dtype in enumerate(("i8", "i2", "i2")))
    delta = FaceDelta.pack(3, faces, old, new)
    for found, known in zip(delta.unpack(), (faces, old, new), strict=True):
        np.testing.assert_array_equal(found, known)
    assert delta.count == len(rows)


def noise(seed: int) -> Step:
    rng = np.random.default_rng(seed)
    faces = np.sort(rng.choice(1_000_000, 5000, replace=False))
    old, new = rng.integers(0, 30, (2, 5000), dtype=np.int16)
    return Step(f"step {seed}", faces=(FaceDelta.pack(0, faces, old, new),))


def test_oldest_steps_are_dropped_when_memory_is_full() -> None:
    history = History(bytes_max=100_000)
    for seed in range(60):
        history.add(noise(seed))
        assert history.size <= 100_000
        assert history.size == sum(step.size for step in history.done)
    kept = [step.what for step in history.done]
    assert 2 <= len(kept) < 30
    assert kept == [f"step {i}" for i in range(60 - len(kept), 60)]
    base = None
    while history.undo() is not None:
        base = history.state
    assert base not in (0, None)  # not where it began: that is forgotten
    history.add(noise(99))
    assert len(history.done) == 1 and not history.undone
    assert history.size == history.done[0].size


def test_a_replaced_step_counts_once_and_is_another_state() -> None:
    history, states = History(), {0}
    history.add(noise(0))
    for step in (noise(1), Step("small")):
        history.replace_last(step)
        states.add(history.state)
        assert [step.what for step in history.done] == [step.what] and history.size == step.size
    assert len(states) == 3


def test_newest_steps_are_packed_up_to_a_limit(monkeypatch) -> None:
    steps = [noise(seed) for seed in range(4)]
    for count in (0, 1, 3):
        monkeypatch.setattr(module, "PACKED_BYTES", sum(step.size for step in steps[4 - count :]))
        found = unpack_steps(pack_steps(steps))
        assert [(step.what, step.faces) for step in found] == [(step.what, step.faces) for step in steps[4 - count :]]


def test_step_above_the_memory_limit_is_the_only_one() -> None:
    history = History(bytes_max=10)
    history.add(noise(0))
    history.add(noise(1))
    assert [step.what for step in history.done] == ["step 1"]
