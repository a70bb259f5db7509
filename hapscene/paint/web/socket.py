"""WebSockets of the page: input events and uploads come in; state, traces and sound go out."""

import contextlib
import json
import re
import shutil
import tempfile
from collections.abc import Awaitable, Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import HapsceneError
from hapscene.files import short
from hapscene.paint.web.view import Pointer

__all__ = ["UPLOAD_PATH", "PageSocket", "Uploads", "listed", "number", "parse", "pointer_of", "safe_name"]

MESSAGE_BYTES_MAX: Final = 10_000
"""Longest message that is read [bytes]; a page sends some hundred."""

BACKLOG_BYTES_MAX: Final = 500_000
"""Most that may wait for a page that does not read [bytes]: some seconds of traces. Further traces are dropped."""

PIXEL_MAX: Final = 1e5
"""Largest canvas that is accepted [pixels]."""

Message = Mapping[str, Any]


class PageSocket:
    """The sockets of all open pages, beside viser's. Its methods are called in the server's event loop.

    Args:
        act: does what a message says.
        state: the first thing that a new page receives.
    """

    def __init__(self, act: Callable[[Message], Awaitable[None]], state: Callable[[], Message]) -> None:
        self._act, self._state = act, state
        self._sockets: set[Any] = set()
        self.refused = 0
        """Messages that were not understood [count]."""

    async def serve(self, connection: Any) -> None:
        """Serve a page until it leaves, one message after the other."""
        from websockets.exceptions import ConnectionClosed

        self._sockets.add(connection)
        try:
            self._send_to(connection, json.dumps({"state": self._state()}))
            async for raw in connection:
                message = parse(raw)
                if message is None:
                    self.refused += 1
                else:
                    await self._act(message)
        except ConnectionClosed:
            pass
        finally:
            self._sockets.discard(connection)

    def send(self, **content: Any) -> None:
        """Send to all pages."""
        self._broadcast(json.dumps(content))

    def say(self, text: str, kind: str = "") -> None:
        """Show a line on all pages; `kind` is "error" or empty."""
        self.send(say=text, kind=kind)

    def trace(self, force_N: NDArray[Any], a_m_s2: NDArray[Any], tick_s: float) -> None:
        """Plot and play touch: force (n,) [N] and acceleration (n, block) [m/s²]."""
        head = (1.0, tick_s, len(force_N), a_m_s2.shape[1])
        self._broadcast(np.concatenate((head, force_N, a_m_s2.ravel())).astype("<f4").tobytes())

    def sound(self, a_m_s2: NDArray[Any], rate_Hz: float) -> None:
        """Play an acceleration (n,) [m/s²] at once."""
        self._broadcast(np.concatenate(((2.0, rate_Hz), a_m_s2)).astype("<f4").tobytes())

    def _broadcast(self, content: str | bytes) -> None:
        for connection in self._sockets:
            self._send_to(connection, content)

    def _send_to(self, connection: Any, content: str | bytes) -> None:
        from websockets.asyncio.server import broadcast

        waits = connection.transport.get_write_buffer_size()
        if isinstance(content, bytes) and waits >= BACKLOG_BYTES_MAX:
            return  # a trace or a sound; a text is sent once
        if waits >= 10 * BACKLOG_BYTES_MAX:
            connection.transport.abort()  # it does not read any more
            return
        with contextlib.suppress(RuntimeError):  # it is closing
            broadcast([connection], content)


def parse(raw: str | bytes) -> dict[str, Any] | None:
    """Decode a message: a small JSON object whose "do" is a text; else None."""
    if not isinstance(raw, str) or len(raw) > MESSAGE_BYTES_MAX:
        return None
    try:
        message = json.loads(raw)
    except (ValueError, RecursionError):
        return None
    return message if isinstance(message, dict) and isinstance(message.get("do"), str) else None


def number(message: Message, key: str, low: float, high: float) -> float | None:
    """A number of a message within bounds; None where there is no such number."""
    value = message.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        return None
    return float(value)


def pointer_of(message: Message) -> Pointer | None:
    """The pointer position of a message; None where it has none."""
    client = number(message, "client", 0, 2**53)
    x, y = number(message, "x", -10.0, 10.0), number(message, "y", -10.0, 10.0)
    width, height = number(message, "w", 1.0, PIXEL_MAX), number(message, "h", 1.0, PIXEL_MAX)
    if client is None or x is None or y is None or width is None or height is None:
        return None
    return Pointer(int(client), x, y, width, height)


# Uploads: files that are dropped on the page or chosen there, bounded, into a folder of their own. A drop is one
# WebSocket: first a text with the names and sizes of its files, then their bytes, one after the other.


UPLOAD_PATH: Final = "/hapscene-upload"
"""Path of the WebSocket of a drop."""

BYTES_MAX: Final = 512 * 1024 * 1024
"""Largest drop [bytes]: a scan of ten million faces."""

FILES_MAX: Final = 200
"""Most files of a drop [count]: a folder of the Penn toolkit's models."""

DROPS_MAX: Final = 4
"""Most drops at once [count]."""

Take = Callable[[Sequence[Path]], Awaitable[None]]
"""Takes the files of a drop that have its suffixes; they are removed when it returns."""


class Uploads:
    """Receives the files that are dropped on the page.

    Args:
        say: shows a line on the page; the second argument is "error" or empty.
    """

    def __init__(self, say: Callable[[str, str], None]) -> None:
        self._say = say
        self._takers: list[tuple[tuple[str, ...], Take]] = []
        self._drops = 0

    def take(self, suffixes: Sequence[str], taker: Take) -> None:
        """Give files of these suffixes to `taker` from now on."""
        self._takers.append((tuple(suffixes), taker))

    async def serve(self, connection: Any) -> None:
        """Receive one drop, and pass its files on."""
        if self._drops >= DROPS_MAX:
            self._say("Too many files come at once: drop these again in a while.", "error")
            return
        self._drops += 1
        folder = Path(tempfile.mkdtemp(prefix="hapscene-"))
        try:
            files = await self._receive(connection, folder)
            if files:
                await connection.close()
                for _, taker in self._takers:
                    if mine := [file for file in files if self._taker(file) is taker]:
                        await taker(mine)
        except (HapsceneError, OSError) as error:
            self._say(str(error), "error")
        finally:
            self._drops -= 1
            shutil.rmtree(folder, ignore_errors=True)

    async def _receive(self, connection: Any, folder: Path) -> list[Path]:
        """The files of a drop; none where it broke off or was invalid."""
        from websockets.exceptions import ConnectionClosed

        with contextlib.suppress(ConnectionClosed):
            wanted = listed(await connection.recv())
            if isinstance(wanted, str):
                self._say(wanted, "error")
                return []
            if not any(self._taker(Path(name)) for name in wanted):
                known = ", ".join(sorted({suffix for suffixes, _ in self._takers for suffix in suffixes}))
                self._say(f"{short(next(iter(wanted)))}: files that end in {known} can be dropped here.", "error")
                return []
            for name, size in wanted.items():
                with (folder / name).open("wb") as file:
                    left = size
                    while left > 0:
                        data = await connection.recv()
                        if not isinstance(data, bytes) or not 0 < len(data) <= left:
                            return []
                        file.write(data)
                        left -= len(data)
            return [folder / name for name in wanted]
        self._say("The files did not come whole: drop them again.", "error")
        return []

    def _taker(self, file: Path) -> Take | None:
        suffix = file.suffix.lower()
        return next((taker for suffixes, taker in self._takers if suffix in suffixes), None)


def listed(text: Any) -> Mapping[str, int] | str:
    """Names and sizes of a drop's files from a stranger's message; or why it is invalid."""
    try:
        if not isinstance(text, str) or len(text) > 100_000:
            return "These are not files."
        files: Any = json.loads(text)["files"]
        wanted = {safe_name(str(file["name"])): file["size"] for file in files}
    except (ValueError, TypeError, KeyError, RecursionError):
        return "These are not files."
    if not 1 <= len(wanted) == len(files) <= FILES_MAX:
        return f"1 to {FILES_MAX} files of different names can be dropped at once."
    if not all(type(size) is int and size >= 0 for size in wanted.values()):
        return "These are not files."
    if sum(wanted.values()) > BYTES_MAX:
        return f"{BYTES_MAX >> 20} MiB can be dropped at once; open larger files from the terminal."
    return wanted


def safe_name(name: str) -> str:
    """A plain file name from a stranger's: no folder, nothing hidden, no unusual characters."""
    plain = re.sub(r"[^\w .()+-]", "_", re.split(r"[/\\]", name)[-1]).strip(" .")
    stem, dot, suffix = plain.rpartition(".")
    return f"{(stem or 'file')[:100]}{dot}{suffix[:12]}" if dot else plain[:100] or "file"
