"""How much memory this process may take, and a note where that is little: who ends it then says no word."""

import sys
from contextlib import suppress
from pathlib import Path
from typing import Final

from hapscene.command.console import note

LITTLE_B: Final = 512 << 20
"""Memory from which nothing is said [bytes]. A touch of a small scene takes 220 MB that the system cannot take back;
its first one, when functions are compiled, up to 500 MB."""

_CGROUPS: Final = (
    *("/sys/fs/cgroup{path}/memory.max", "/sys/fs/cgroup/memory.max"),  # version 2, seen from outside and inside
    *("/sys/fs/cgroup/memory{path}/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.limit_in_bytes"),
)


def note_memory_limit() -> None:
    """Say it where a limit is set that may be too small."""
    limit_B = memory_limit_B()
    if limit_B is not None and limit_B < LITTLE_B:
        note(
            f"this process may take {limit_B >> 20} MiB of memory; a touch of a small scene takes 256 MiB, its first "
            f"one up to {LITTLE_B >> 20} MiB: with less it may stand still or be ended without a word"
        )


def memory_limit_B() -> int | None:
    """The smallest limit that is set, by the container or by `ulimit`; None where there is none [bytes]."""
    if sys.platform == "win32":
        return None
    import resource

    limits = [resource.getrlimit(kind)[0] for kind in (resource.RLIMIT_AS, resource.RLIMIT_DATA)]
    found = [limit for limit in limits if limit != resource.RLIM_INFINITY]
    with suppress(OSError):
        groups = [line.split(":", 2) for line in Path("/proc/self/cgroup").read_text().splitlines()]
        paths = {path for number, kinds, path in groups if number == "0" or "memory" in kinds.split(",")}
        for file in {place.format(path=path) for place in _CGROUPS for path in paths}:
            with suppress(OSError, ValueError):  # "max" is no number
                found.append(int(Path(file).read_text()))
    return min(found, default=None)
