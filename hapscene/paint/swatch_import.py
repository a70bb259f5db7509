"""Swatches of files that are no hapscene's: recordings are fitted, the Penn toolkit's models read, in a process beside.

That process is the command line's own: `hapscene capture fit`, `hapscene swatch import`. What it writes is opened
as any stranger's swatch is.
"""

import asyncio
import contextlib
import re
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain, count
from pathlib import Path
from typing import Final

from hapscene.errors import CaptureError, SwatchError, printable
from hapscene.surface.library import add, computed_entries, find, shipped_swatches
from hapscene.surface.swatch_file import SUFFIX, read_swatch

RECORDINGS: Final = (".csv", ".txt", ".tsv", ".wav", ".npz", ".mat", ".hsrec")
"""Suffixes of recordings."""

TIME_MAX_S: Final = 1800.0
"""Longest time that a fit may take [s]; ten minutes of recording take about two."""


class Unsaid(CaptureError):
    """What a recording does not say of itself, and whoever has it must: rate, columns or units.

    Attributes:
        guess: what the reader takes for its columns, as "acceleration=accel"; "" where it has no guess.
    """

    def __init__(self, reason: str) -> None:
        guess = re.search(r"--columns (\S+?)\)", reason)
        self.guess = guess[1] if guess else ""
        super().__init__(re.sub(r": give .*", "", reason))


async def import_files(
    files: Sequence[Path], *, name: str = "", rate: str = "", columns: str = "", units: str = ""
) -> list[str]:
    """Put what files hold into the user's library; the names that the swatches have there.

    Args:
        files: .swatch files, XML files of the Penn toolkit (models with their taps), or recordings, one swatch each.
        name: of the swatch of one recording; its file's stem unless told.
        rate, columns, units: of recordings, as the command line has them.

    Raises:
        Unsaid: a recording of which more must be said.
        CaptureError, SwatchError: why nothing can be made of a file.
    """
    made: list[str] = []
    with tempfile.TemporaryDirectory(prefix="hapscene-") as place:
        folder = Path(place)
        swatches = [file for file in files if file.suffix.lower() == SUFFIX]
        models = [str(file) for file in files if file.suffix.lower() == ".xml"]
        if models:
            await _run(("swatch", "import", *models, "-o", str(folder)))
        for i, file in enumerate(files):
            if file.suffix.lower() in RECORDINGS:
                told = [("name", name or file.stem), ("rate", rate), ("columns", columns), ("units", units)]
                given = [f"--{option}={value}" for option, value in told if value]  # whatever it begins with
                await _run(("capture", "fit", str(file), "-o", str(folder / f"{i}-{file.stem}{SUFFIX}"), *given))
        for file in (*swatches, *sorted(folder.glob(f"*{SUFFIX}"))):
            swatch = await asyncio.to_thread(read_swatch, file)
            made.append(add(replace(swatch, name=free_name(swatch.name))).name)
    return made


def free_name(name: str) -> str:
    """The name, or with the first number behind it that no swatch has: "oak 2"."""
    stem = re.sub(r" \d+$", "", name)
    names = chain((name,), (f"{stem} {i}" for i in count(2)))
    shipped = {*shipped_swatches(), *(entry.name for entry in computed_entries())}
    return next(free for free in names if free not in shipped and find(free) is None)


async def _run(arguments: Sequence[str]) -> None:
    """Run a command of hapscene's; the error it ends with is raised."""
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "hapscene", *arguments),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        async with asyncio.timeout(TIME_MAX_S):
            _, said = await process.communicate()
    except TimeoutError:
        raise CaptureError(f"it took longer than {TIME_MAX_S / 60:g} minutes: given up") from None
    finally:
        if process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
    if process.returncode:
        last = said.decode(errors="replace").strip().rpartition("\n")[2]
        reason = _plain(last.removeprefix("hapscene: "))
        if any(option in reason for option in ("--rate", "--columns", "--units")):
            raise Unsaid(reason)
        raise SwatchError(reason or "nothing could be made of it")


def _plain(line: str) -> str:
    """A line without the folders that the files lie in."""
    return printable(re.sub(r"/\S*/(?=[^/\s])", "", line.strip()))
