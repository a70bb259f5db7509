"""How much memory this process may take: what the machine has left, and what a container or `ulimit` allows."""

import math
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

__all__ = ["memory_left_B", "memory_limit_B"]

_GROUPS: Final = (
    *("/sys/fs/cgroup{path}/memory.max", "/sys/fs/cgroup/memory.max"),  # version 2, seen from outside and inside
    *("/sys/fs/cgroup/memory{path}/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.limit_in_bytes"),
)


def memory_limit_B() -> float:
    """The smallest limit that is set, by the container or by `ulimit`; infinite where there is none [bytes]."""
    return min((limit_B for limit_B, _ in _limits()), default=math.inf)


def memory_left_B() -> float:
    """Memory that may still be taken, as far as the system tells; else infinite [bytes]."""
    left_B = [limit_B - used_B for limit_B, used_B in _limits()]
    return max(min([*left_B, _numbers("/proc/meminfo").get("MemAvailable", math.inf)]), 0.0)


def _limits() -> Iterator[tuple[float, float]]:
    """Each limit that is set, and how much is taken of it."""
    if sys.platform == "win32":
        return
    import resource

    own = _numbers("/proc/self/status")
    for kind, used in ((resource.RLIMIT_AS, "VmSize"), (resource.RLIMIT_DATA, "VmData")):
        limit_B = resource.getrlimit(kind)[0]
        if limit_B != resource.RLIM_INFINITY:
            yield limit_B, own.get(used, 0.0)
    with suppress(OSError):
        groups = [line.split(":", 2) for line in Path("/proc/self/cgroup").read_text().splitlines()]
        paths = {path for number, kinds, path in groups if number == "0" or "memory" in kinds.split(",")}
        for file in {Path(place.format(path=path)) for place in _GROUPS for path in paths}:
            with suppress(OSError, ValueError):  # "max" is no number
                yield float(file.read_text()), _anonymous_B(file.with_name("memory.stat"))


def _anonymous_B(stat: Path) -> float:
    """What a group has taken that cannot be given back."""
    with suppress(OSError, ValueError):
        lines = dict(line.split() for line in stat.read_text().splitlines())
        return float(lines.get("anon", lines.get("rss", 0)))
    return 0.0


def _numbers(file: str) -> dict[str, float]:
    """What a list of names and numbers in kB says [bytes]."""
    with suppress(OSError):
        lines = (line.partition(":") for line in Path(file).read_text().splitlines())
        return {name: 1024.0 * int(rest.split()[0]) for name, _, rest in lines if rest.endswith(" kB")}
    return {}
