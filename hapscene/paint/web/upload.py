"""Files that come through the browser, dropped on the page or chosen there: bounded, into a folder of their own.

A drop is one WebSocket: first a text with the names and sizes of its files, then their bytes, one after the other. When
all are there, whoever takes files of a suffix is given them; what it says is shown.
"""

import contextlib
import json
import logging
import re
import shutil
import tempfile
from collections.abc import Awaitable, Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from hapscene.errors import HapsceneError
from hapscene.files import short

UPLOAD_PATH: Final = "/hapscene-upload"
"""Where the WebSocket of a drop is."""

BYTES_MAX: Final = 512 * 1024 * 1024
"""Largest drop [bytes]: a scan of ten million faces."""

FILES_MAX: Final = 200
"""Most files of a drop [count]: a folder of the Penn toolkit's models."""

DROPS_MAX: Final = 4
"""Most drops at once [count]."""

Take = Callable[[Sequence[Path]], Awaitable[None]]
"""Takes the files of a drop that have its suffixes. They are gone when it has returned."""


class Uploads:
    """What becomes of the files that are dropped on the page.

    Args:
        say: shows a line to all who look; the second is "error" or nothing.
        log: is told of messages that are none.
    """

    def __init__(self, say: Callable[[str, str], None], log: logging.Logger) -> None:
        self._say, self._log = say, log
        self._takers: list[tuple[tuple[str, ...], Take]] = []
        self._drops = 0

    def take(self, suffixes: Sequence[str], taker: Take) -> None:
        """Give files of these suffixes to `taker` from now on."""
        self._takers.append((tuple(suffixes), taker))

    async def serve(self, connection: Any) -> None:
        """Receive one drop, and have its files taken."""
        if self._drops >= DROPS_MAX:
            self._say("Too many files come at once: drop these again in a while.", "error")
            return
        self._drops += 1
        folder = Path(tempfile.mkdtemp(prefix="hapscene-"))
        try:
            files = await self._receive(connection, folder)
            if files:
                await connection.close()
                await self._hand_over(files)
        except (HapsceneError, OSError) as error:
            self._say(str(error), "error")
        finally:
            self._drops -= 1
            shutil.rmtree(folder, ignore_errors=True)

    async def _receive(self, connection: Any, folder: Path) -> list[Path]:
        """The files of a drop; none where it broke off, or was none."""
        from websockets.exceptions import ConnectionClosed

        with contextlib.suppress(ConnectionClosed):
            wanted = listed(await connection.recv())
            if isinstance(wanted, str):
                self._log.warning("malformed drop refused")
                self._say(wanted, "error")
                return []
            refused = [name for name in wanted if self._taker(Path(name)) is None]
            if len(refused) == len(wanted):
                known = ", ".join(sorted({suffix for suffixes, _ in self._takers for suffix in suffixes}))
                self._say(f"{short(refused[0])}: files that end in {known} can be dropped here.", "error")
                return []
            for name, size in wanted.items():
                with (folder / name).open("wb") as file:
                    left = size
                    while left > 0:
                        data = await connection.recv()
                        if not isinstance(data, bytes) or not 0 < len(data) <= left:
                            self._log.warning("malformed drop refused")
                            return []
                        file.write(data)
                        left -= len(data)
            return [folder / name for name in wanted]
        self._say("The files did not come whole: drop them again.", "error")
        return []

    async def _hand_over(self, files: Sequence[Path]) -> None:
        for _, taker in self._takers:
            mine = [file for file in files if self._taker(file) is taker]
            if mine:
                await taker(mine)

    def _taker(self, file: Path) -> Take | None:
        suffix = file.suffix.lower()
        return next((taker for suffixes, taker in self._takers if suffix in suffixes), None)


def listed(text: Any) -> Mapping[str, int] | str:
    """Names and sizes of a drop's files, of a message from anybody; or why it is none."""
    try:
        if not isinstance(text, str) or len(text) > 100_000:
            return "These are no files."
        files: Any = json.loads(text)["files"]
        wanted = {safe_name(str(file["name"])): file["size"] for file in files}
    except (ValueError, TypeError, KeyError, RecursionError):
        return "These are no files."
    if not 1 <= len(wanted) == len(files) <= FILES_MAX:
        return f"1 to {FILES_MAX} files of different names can be dropped at once."
    if not all(type(size) is int and size >= 0 for size in wanted.values()):
        return "These are no files."
    if sum(wanted.values()) > BYTES_MAX:
        return f"{BYTES_MAX >> 20} MiB can be dropped at once; open larger files from the terminal."
    return wanted


def safe_name(name: str) -> str:
    """A name of a file from anybody as a plain one: no folder, nothing hidden, nothing odd."""
    plain = re.sub(r"[^\w .()+-]", "_", re.split(r"[/\\]", name)[-1]).strip(" .")
    stem, dot, suffix = plain.rpartition(".")
    return f"{(stem or 'file')[:100]}{dot}{suffix[:12]}" if dot else plain[:100] or "file"
