"""The process that reads mutants: under limits, watched, and not missed when it dies.

A line on standard input names a format and a file; a line on standard output says what became of it.
"""

import json
import os
import resource
import sys
import traceback
import warnings
from pathlib import Path
from typing import Any

from formats import FORMATS

from hapscene.errors import HapsceneError

MEMORY_FREE_B = 200_000_000
"""Memory that any file may take [bytes]; beside it, four times its size."""

ROOT = Path(__file__).resolve().parents[3]
TEMPORARY = Path.cwd() / "temporary"
"""Where files may be made that are gone afterwards."""

READABLE = tuple(map(str, (TEMPORARY, ROOT, sys.prefix, sys.base_prefix, "/proc", "/sys", "/dev", "/usr", "/lib")))
WRITABLE = (str(TEMPORARY), os.devnull)

_deeds: list[str] = []
"""What the reader did that none may do, since the last file."""
_watch: dict[str, Any] = {"folder": None, "roams": False}


def note(event: str, arguments: tuple[Any, ...]) -> None:
    """An audit hook: files outside, whatever is written, removed, run or sent."""
    if _watch["folder"] is None:
        return
    if event == "open" and isinstance(arguments[0], str | bytes):
        path, mode, flags = os.path.realpath(os.fsdecode(arguments[0])), arguments[1] or "", arguments[2] or 0
        writes = set(mode) & set("wax+") or flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        known = path.startswith((_watch["folder"], *READABLE)) or _watch["roams"]
        if not (path.startswith(WRITABLE) or "__pycache__" in path if writes else known):
            _deeds.append(f"{'writes' if writes else 'reads'} {path}")
    elif event in ("os.remove", "os.rename", "os.mkdir", "os.system", "pickle.find_class", "socket.connect"):
        folder = arguments[-1]  # a descriptor, or -1
        within = Path(f"/proc/self/fd/{folder}").resolve() if isinstance(folder, int) and folder > 0 else Path()
        if not str(within / str(arguments[0])).startswith(WRITABLE) and "__pycache__" not in str(arguments):
            _deeds.append(f"{event} {arguments}"[:200])


def address_space_B() -> int:
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


def peak_B() -> int:
    return next(1024 * int(line.split()[1]) for line in Path("/proc/self/status").open() if line.startswith("VmHWM"))


def listed(folder: Path) -> set[str]:
    """What lies about: beside the file, where the process works, and where only temporary files may be."""
    return {str(file) for place in (folder, Path.cwd(), TEMPORARY) for file in place.iterdir()}


def raised_in(error: BaseException) -> str:
    """File and function of ours in which it was raised."""
    ours = [f for f in traceback.extract_tb(error.__traceback__) if f"{os.sep}hapscene{os.sep}" in f.filename]
    return f"{Path(ours[-1].filename).name}:{ours[-1].name}" if ours else "?"


def read(name: str, path: Path, limited: bool) -> dict[str, Any]:
    """What became of a file: `kind` is loaded, refused, or a fault."""
    entry = FORMATS[name]
    told: dict[str, Any] = {"kind": "loaded", "what": "", "where": "", "text": "", "count": 0}
    size_B = sum(file.stat().st_size for file in path.parent.iterdir())
    allowed_B = 4 * size_B + MEMORY_FREE_B
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    before_B, start_s = peak_B(), sum(os.times()[:4])  # by the processor, with processes of its own
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    _deeds.clear()
    files = listed(path.parent)
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        try:
            _watch.update(folder=str(path.parent) if limited else None, roams=entry.roams)
            resource.setrlimit(resource.RLIMIT_AS, (address_space_B() + allowed_B if limited else hard, hard))
            told["count"] = count if isinstance(count := entry.read(path), int) else 0
        except HapsceneError as error:
            told |= {"kind": "refused", "text": str(error), "what": type(error).__name__, "where": raised_in(error)}
            if not str(error).isprintable():
                told["kind"] = "unprintable"  # or more than a line
            elif entry.file and str(path.parent) not in str(error):
                told["kind"] = "unnamed"  # which file, of a thousand?
        except BaseException as error:
            told |= {
                "kind": "traceback",
                "what": type(error).__name__,
                "where": raised_in(error),
                "text": str(error)[:200],
            }
        finally:
            resource.setrlimit(resource.RLIMIT_AS, (hard, hard))
            _watch["folder"] = None
    told |= {"warned": bool(heard), "seconds": sum(os.times()[:4]) - start_s, "peak_B": peak_B() - before_B}
    if told["peak_B"] > allowed_B:
        told |= {"kind": "memory", "text": f"{told['peak_B']:,} bytes for a file of {size_B:,}"}
    if listed(path.parent) != files:
        _deeds.append(f"leaves {', '.join(listed(path.parent) - files)}")
    if _deeds:
        told |= {"kind": "deed", "text": "; ".join(_deeds[:3])}
    return told


def main() -> None:
    answers = os.fdopen(os.dup(1), "w")
    said = Path("said").open("w+b")  # noqa: SIM115
    os.dup2(said.fileno(), 1)  # whatever is printed is seen
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    sys.addaudithook(note)
    for line in sys.stdin:
        name, path, limited = json.loads(line)
        told = read(name, Path(path), limited)
        sys.stdout.flush()
        if said.seek(0, os.SEEK_END):
            told |= {"kind": "printed", "text": f"{said.tell()} bytes on standard output"}
            said.seek(0)
            said.truncate()
        answers.write(json.dumps(told) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
