"""What is said where a process may take little memory."""

import subprocess
import sys
from pathlib import Path

import pytest

from hapscene.command import memory_limit


def test_a_small_ulimit_is_told() -> None:
    resource = pytest.importorskip("resource", reason="no limits of a process here")
    code = "import sys; from hapscene.cli import main; sys.exit(main(['check', 'none.stl']))"

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_DATA, (300 << 20, 300 << 20))

    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, preexec_fn=limit, encoding="utf-8"
    )
    note, error = done.stderr.splitlines()
    assert note.startswith("hapscene: note: this process may take 300 MiB of memory; a touch of a small scene takes")
    assert error == "hapscene: none.stl: no such file"


@pytest.mark.parametrize(
    ("group", "file", "content", "limit_B"),
    [
        ("0::/box\n", "cgroup/box/memory.max", "268435456\n", 256 << 20),
        ("0::/\n", "cgroup/memory.max", "268435456\n", 256 << 20),
        ("0::/\n", "cgroup/memory.max", "max\n", None),
        ("9:cpu,memory:/box\n", "cgroup/memory/box/memory.limit_in_bytes", "1000\n", 1000),
        ("9:cpu,memory:/box\n", "cgroup/memory/memory.limit_in_bytes", "1000\n", 1000),
    ],
)
def test_the_limit_of_a_container_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, group: str, file: str, content: str, limit_B: int | None
) -> None:
    resource = pytest.importorskip("resource", reason="no limits of a process here")
    monkeypatch.setattr(resource, "getrlimit", lambda kind: (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    (tmp_path / file).parent.mkdir(parents=True)
    (tmp_path / file).write_text(content)
    (tmp_path / "group").write_text(group)
    places = [place.replace("/sys/fs", str(tmp_path)) for place in memory_limit._CGROUPS]
    monkeypatch.setattr(memory_limit, "_CGROUPS", places)
    monkeypatch.setattr(
        memory_limit, "Path", lambda place: tmp_path / "group" if place == "/proc/self/cgroup" else Path(place)
    )
    assert memory_limit.memory_limit_B() == limit_B
