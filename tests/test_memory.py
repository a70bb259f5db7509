"""How much memory there is: what limits say, what is left of it, and the note where it is little."""

import math
from pathlib import Path

import pytest

from hapscene import memory


@pytest.mark.parametrize(
    ("group", "file", "content", "limit_B"),
    [
        ("0::/box\n", "cgroup/box/memory.max", "268435456\n", 256 << 20),
        ("0::/\n", "cgroup/memory.max", "268435456\n", 256 << 20),
        ("0::/\n", "cgroup/memory.max", "max\n", math.inf),
        ("9:cpu,memory:/box\n", "cgroup/memory/box/memory.limit_in_bytes", "1000\n", 1000),
        ("9:cpu,memory:/box\n", "cgroup/memory/memory.limit_in_bytes", "1000\n", 1000),
    ],
)
def test_the_limit_of_a_container_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, group: str, file: str, content: str, limit_B: float
) -> None:
    resource = pytest.importorskip("resource", reason="no limits of a process here")
    monkeypatch.setattr(resource, "getrlimit", lambda kind: (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    (tmp_path / file).parent.mkdir(parents=True)
    (tmp_path / file).write_text(content)
    (tmp_path / "group").write_text(group)
    places = [place.replace("/sys/fs", str(tmp_path)) for place in memory._GROUPS]
    monkeypatch.setattr(memory, "_GROUPS", places)
    monkeypatch.setattr(
        memory, "Path", lambda place: tmp_path / "group" if place == "/proc/self/cgroup" else Path(place)
    )
    assert memory.memory_limit_B() == limit_B


def test_memory_that_is_left_is_within_what_is_allowed() -> None:
    resource = pytest.importorskip("resource")
    before = memory.memory_left_B()
    assert before > 0.0
    allowed = resource.getrlimit(resource.RLIMIT_AS)
    try:
        resource.setrlimit(resource.RLIMIT_AS, (1 << 40, allowed[1]))
        assert memory.memory_left_B() <= min(before, 1 << 40) * 1.5
    finally:
        resource.setrlimit(resource.RLIMIT_AS, allowed)
