"""Worker process of the fuzzer: reads damaged files under resource limits and reports each result.

Each line on standard input names a format and a file; each line on standard output is the result in JSON.
A crash of the reader ends only this process.
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
"""Memory that reading may allocate in addition to four times the size of the file [bytes]."""

ROOT = Path(__file__).resolve().parents[3]
TEMPORARY = Path.cwd() / "temporary"
"""Folder in which the reader may create temporary files."""

READABLE = tuple(map(str, (TEMPORARY, ROOT, sys.prefix, sys.base_prefix, "/proc", "/sys", "/dev", "/usr", "/lib")))
WRITABLE = (str(TEMPORARY), os.devnull)

_forbidden: list[str] = []
"""Forbidden actions of the reader since the last file: access outside its folders, processes, connections."""
_watch: dict[str, Any] = {"folder": None, "roams": False}


def note(event: str, arguments: tuple[Any, ...]) -> None:
    """Audit hook that records forbidden actions."""
    if _watch["folder"] is None:
        return
    if event == "open" and isinstance(arguments[0], str | bytes):
        path, mode, flags = os.path.realpath(os.fsdecode(arguments[0])), arguments[1] or "", arguments[2] or 0
        writes = set(mode) & set("wax+") or flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        known = path.startswith((_watch["folder"], *READABLE)) or _watch["roams"]
        if not (path.startswith(WRITABLE) or "__pycache__" in path if writes else known):
            _forbidden.append(f"{'writes' if writes else 'reads'} {path}")
    elif event in ("os.remove", "os.rename", "os.mkdir", "os.system", "pickle.find_class", "socket.connect"):
        folder = arguments[-1]  # a file descriptor, or -1
        within = Path(f"/proc/self/fd/{folder}").resolve() if isinstance(folder, int) and folder > 0 else Path()
        if not str(within / str(arguments[0])).startswith(WRITABLE) and "__pycache__" not in str(arguments):
            _forbidden.append(f"{event} {arguments}"[:200])


def address_space_B() -> int:
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


def peak_B() -> int:
    return next(1024 * int(line.split()[1]) for line in Path("/proc/self/status").open() if line.startswith("VmHWM"))


def listed(folder: Path) -> set[str]:
    """Return the files beside the input file, in the working folder and in the temporary folder."""
    return {str(file) for place in (folder, Path.cwd(), TEMPORARY) for file in place.iterdir()}


def raised_in(error: BaseException) -> str:
    """Return file and function in hapscene that raised the error."""
    ours = [f for f in traceback.extract_tb(error.__traceback__) if f"{os.sep}hapscene{os.sep}" in f.filename]
    return f"{Path(ours[-1].filename).name}:{ours[-1].name}" if ours else "?"


def read(name: str, path: Path, limited: bool) -> dict[str, Any]:
    """Read a file and return the result: `kind` is "loaded", "refused", or the kind of a fault."""
    entry = FORMATS[name]
    result: dict[str, Any] = {"kind": "loaded", "what": "", "where": "", "text": "", "count": 0}
    size_B = sum(file.stat().st_size for file in path.parent.iterdir())
    allowed_B = 4 * size_B + MEMORY_FREE_B
    Path("/proc/self/clear_refs").write_text("5")  # resets the peak of the memory use
    before_B, start_s = peak_B(), sum(os.times()[:4])  # processor time, child processes included
    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    _forbidden.clear()
    files = listed(path.parent)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            _watch.update(folder=str(path.parent) if limited else None, roams=entry.roams)
            resource.setrlimit(resource.RLIMIT_AS, (address_space_B() + allowed_B if limited else hard, hard))
            result["count"] = count if isinstance(count := entry.read(path), int) else 0
        except HapsceneError as error:
            result |= {"kind": "refused", "text": str(error), "what": type(error).__name__, "where": raised_in(error)}
            if not str(error).isprintable():
                result["kind"] = "unprintable"  # control characters, or several lines
            elif entry.file and str(path.parent) not in str(error):
                result["kind"] = "unnamed"  # a user with many files needs the name
        except BaseException as error:
            result |= {
                "kind": "traceback",
                "what": type(error).__name__,
                "where": raised_in(error),
                "text": str(error)[:200],
            }
        finally:
            resource.setrlimit(resource.RLIMIT_AS, (hard, hard))
            _watch["folder"] = None
    result |= {"warned": bool(caught), "seconds": sum(os.times()[:4]) - start_s, "peak_B": peak_B() - before_B}
    if result["peak_B"] > allowed_B:
        result |= {"kind": "memory", "text": f"{result['peak_B']:,} bytes for a file of {size_B:,}"}
    if listed(path.parent) != files:
        _forbidden.append(f"leaves {', '.join(listed(path.parent) - files)}")
    if _forbidden:
        result |= {"kind": "forbidden", "text": "; ".join(_forbidden[:3])}
    return result


def main() -> None:
    answers = os.fdopen(os.dup(1), "w")
    printed = Path("printed").open("w+b")  # noqa: SIM115
    os.dup2(printed.fileno(), 1)  # output of the reader goes to a file: a reader must not print
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    sys.addaudithook(note)
    for line in sys.stdin:
        name, path, limited = json.loads(line)
        result = read(name, Path(path), limited)
        sys.stdout.flush()
        if printed.seek(0, os.SEEK_END):
            result |= {"kind": "printed", "text": f"{printed.tell()} bytes on standard output"}
            printed.seek(0)
            printed.truncate()
        answers.write(json.dumps(result) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
