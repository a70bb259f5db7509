"""Available memory of this process, from the machine, the container and `ulimit`."""

import math
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

__all__ = ["memory_left_B", "memory_limit_B"]

_GROUPS: Final = (
    *(
        "/sys/fs/cgroup{path}/memory.max",
        "/sys/fs/cgroup/memory.max",
    ),  # version 2, from outside and inside of the container
    *("/sys/fs/cgroup/memory{path}/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.limit_in_bytes"),
)


def memory_limit_B() -> float:
    """Smallest memory limit of the container and `ulimit` [bytes]; infinite if there is no limit."""
    return min((limit_B for limit_B, _ in _limits()), default=math.inf)


def memory_left_B() -> float:
    """Memory that can still be allocated [bytes]; infinite if the system does not report it."""
    left_B = [limit_B - used_B for limit_B, used_B in _limits()]
    return max(min([*left_B, _numbers("/proc/meminfo").get("MemAvailable", math.inf)]), 0.0)


def _limits() -> Iterator[tuple[float, float]]:
    """Each memory limit, and the memory that counts towards it [bytes]."""
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
            with suppress(OSError, ValueError):  # the value may be "max"
                yield float(file.read_text()), _anonymous_B(file.with_name("memory.stat"))


def _anonymous_B(stat: Path) -> float:
    """Anonymous memory of a control group, which cannot be reclaimed [bytes]."""
    with suppress(OSError, ValueError):
        lines = dict(line.split() for line in stat.read_text().splitlines())
        return float(lines.get("anon", lines.get("rss", 0)))
    return 0.0


def _numbers(file: str) -> dict[str, float]:
    """Values of a /proc file with lines "name: value kB" [bytes]."""
    with suppress(OSError):
        lines = (line.partition(":") for line in Path(file).read_text().splitlines())
        return {name: 1024.0 * int(rest.split()[0]) for name, _, rest in lines if rest.endswith(" kB")}
    return {}
