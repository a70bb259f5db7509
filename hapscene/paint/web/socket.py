"""WebSockets of the page: receive input events and uploads; send state, traces and sound."""

import asyncio
import contextlib
import json
import re
import shutil
import tempfile
from collections.abc import Awaitable, Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import HapsceneError
from hapscene.io.files import Json, short
from hapscene.paint.web.view import Pointer

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection

__all__ = [
    "UPLOAD_PATH",
    "PageSocket",
    "Uploads",
    "client_of",
    "number",
    "parse",
    "parse_file_list",
    "pointer_of",
    "safe_name",
]

MESSAGE_BYTES_MAX: Final = 10_000
"""Longest message that is parsed [bytes]; pages send some hundred."""

BACKLOG_BYTES_MAX: Final = 500_000
"""Largest backlog of a page that does not read [bytes]: some seconds of traces. Further traces are dropped."""

PIXEL_MAX: Final = 1e5
"""Largest canvas that is accepted [pixels]."""

Message = Mapping[str, Json]
Samples = NDArray[np.float64]


class PageSocket:
    """The sockets of all open pages, in addition to those of viser. Must be used in the event loop of the server.

    Args:
        act: handles a message of a page.
        state: returns the state for a page, given by viser's number; -1 until the page has sent its number.
    """

    def __init__(self, act: Callable[[Message], Awaitable[None]], state: Callable[[int], Message]) -> None:
        self._act, self._state = act, state
        self._sockets: dict[ServerConnection, int] = {}  # with the number of the page
        self._sent: dict[ServerConnection, Message] = {}  # last state of each page

    async def serve(self, connection: "ServerConnection") -> None:
        """Handle the messages of a page in order until it disconnects."""
        from websockets.exceptions import ConnectionClosed

        self._sockets[connection] = -1
        try:
            self.send_state()
            async for raw in connection:
                message = parse(raw)
                if message is None:
                    continue
                self._sockets[connection] = client_of(message)
                await self._act(message)
                await asyncio.sleep(0.001)  # serves painted faces, sound and other pages before messages that wait
                if "n" in message:  # the page shows that it waits
                    self._send_to(connection, json.dumps({"done": message["n"]}))
        except ConnectionClosed:
            pass
        finally:
            del self._sockets[connection]
            self._sent.pop(connection, None)

    def send_state(self) -> None:
        """Send its state to each page for which it has changed."""
        for connection, client in self._sockets.items():
            state = self._state(client)
            if state != self._sent.get(connection):
                self._sent[connection] = state
                self._send_to(connection, json.dumps({"state": state}))

    def say(self, text: str, kind: str = "", client: int | None = None) -> None:
        """Show a message on a page, or on all pages; `kind` is "error" or ""."""
        self._broadcast(json.dumps({"say": text, "kind": kind}), client)

    def trace(self, force_N: Samples, a_m_s2: Samples, tick_s: float, gains: tuple[float, float] = (1.0, 1.0)) -> None:
        """Plot and play touch: force (n,) [N] and acceleration (n, block) [m/s²], played with first to last gain."""
        head = (1.0, tick_s, len(force_N), a_m_s2.shape[1], *gains)
        self._broadcast(np.concatenate((head, force_N, a_m_s2.ravel())).astype("<f4").tobytes())

    def sound(self, a_m_s2: Samples, rate_Hz: float, start: int, gain: float, client: int) -> None:
        """Plot an acceleration (n,) [m/s²] on a page, and play it at once, with a gain from the sample `start` on."""
        self._broadcast(np.concatenate(((2.0, rate_Hz, start, gain), a_m_s2)).astype("<f4").tobytes(), client)

    def _broadcast(self, content: str | bytes, client: int | None = None) -> None:
        for connection, number in self._sockets.items():
            if client is None or number == client:
                self._send_to(connection, content)

    def _send_to(self, connection: "ServerConnection", content: str | bytes) -> None:
        from websockets.asyncio.server import broadcast

        waits = connection.transport.get_write_buffer_size()
        if isinstance(content, bytes) and waits >= BACKLOG_BYTES_MAX:
            return  # drop traces and sound, but not state and messages
        if waits >= 10 * BACKLOG_BYTES_MAX:
            connection.transport.abort()  # the page does not read any more
            return
        with contextlib.suppress(RuntimeError):  # it is closing
            broadcast([connection], content)


def parse(raw: str | bytes) -> dict[str, Json] | None:
    """Parse a message, a JSON object with a string "do"; None for anything else."""
    if not isinstance(raw, str) or len(raw) > MESSAGE_BYTES_MAX:
        return None
    try:
        message = json.loads(raw)
    except (ValueError, RecursionError):
        return None
    return message if isinstance(message, dict) and isinstance(message.get("do"), str) else None


def number(message: Message, key: str, low: float, high: float) -> float | None:
    """A number of a message; None if it is missing, not a number or out of range."""
    value = message.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        return None
    return float(value)


def client_of(message: Message) -> int:
    """viser's number of the page that sent a message; -1 if it is missing."""
    client = number(message, "client", 0, 2**53)
    return -1 if client is None else int(client)


def pointer_of(message: Message) -> Pointer | None:
    """The pointer position of a message; None if it has no valid position."""
    client = client_of(message)
    x, y = number(message, "x", -10.0, 10.0), number(message, "y", -10.0, 10.0)
    width, height = number(message, "w", 1.0, PIXEL_MAX), number(message, "h", 1.0, PIXEL_MAX)
    if client < 0 or x is None or y is None or width is None or height is None:
        return None
    return Pointer(client, x, y, width, height)


# Uploads of files that the user drops on the page or selects. Each upload uses one WebSocket: first a text message with
# the names and sizes of the files, then their content in order.


UPLOAD_PATH: Final = "/hapscene-upload"
"""Path of the WebSocket of an upload."""

BYTES_MAX: Final = 512 * 1024 * 1024
"""Largest upload [bytes]: a scan of ten million faces."""

FILES_MAX: Final = 200
"""Largest number of files of an upload [count]."""

UPLOADS_MAX: Final = 4
"""Largest number of uploads at the same time [count]."""

INVALID_LIST: Final = "Invalid upload: expected a list of files."


class Uploads:
    """Receives uploaded files.

    Args:
        say: shows a message on the page; the second argument is "error" or "".
        suffixes: accepted suffixes; files with another one are ignored.
        take: handles the files of an upload, which are deleted when it returns.
    """

    def __init__(
        self,
        say: Callable[[str, str], None],
        suffixes: Sequence[str],
        take: Callable[[Sequence[Path]], Awaitable[None]],
    ) -> None:
        self._say, self._suffixes, self._take = say, suffixes, take
        self._running = 0

    async def serve(self, connection: "ServerConnection") -> None:
        """Receive one upload and pass on its files."""
        if self._running >= UPLOADS_MAX:
            self._say("Too many uploads at the same time: wait until they finish, then try again.", "error")
            return
        self._running += 1
        folder = Path(tempfile.mkdtemp(prefix="hapscene-"))
        try:
            if files := await self._receive(connection, folder):
                await connection.close()
                await self._take(files)
        except (HapsceneError, OSError) as error:
            self._say(str(error), "error")
        finally:
            self._running -= 1
            shutil.rmtree(folder, ignore_errors=True)

    async def _receive(self, connection: "ServerConnection", folder: Path) -> list[Path]:
        """The accepted files of an upload; empty if it was interrupted or invalid."""
        from websockets.exceptions import ConnectionClosed

        with contextlib.suppress(ConnectionClosed):
            wanted = parse_file_list(await connection.recv())
            if isinstance(wanted, str):
                self._say(wanted, "error")
                return []
            accepted = [name for name in wanted if Path(name).suffix.lower() in self._suffixes]
            if not accepted:
                known = ", ".join(self._suffixes)
                self._say(f"{short(next(iter(wanted)))}: unsupported file type; expected {known}.", "error")
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
            return [folder / name for name in accepted]
        self._say("The upload was interrupted: try again.", "error")
        return []


def parse_file_list(text: object) -> Mapping[str, int] | str:
    """Names and sizes of the files of an upload; or an error message."""
    try:
        if not isinstance(text, str) or len(text) > 100_000:
            return INVALID_LIST
        files = json.loads(text)["files"]
        wanted = {safe_name(str(file["name"])): file["size"] for file in files}
    except (ValueError, TypeError, KeyError, RecursionError):
        return INVALID_LIST
    if not 1 <= len(wanted) == len(files) <= FILES_MAX:
        return f"Invalid upload: expected 1 to {FILES_MAX} files with different names."
    if not all(type(size) is int and size >= 0 for size in wanted.values()):
        return INVALID_LIST
    if sum(wanted.values()) > BYTES_MAX:
        return f"The files are too large: at most {BYTES_MAX >> 20} MiB can be uploaded; use hapscene paint FILE."
    return wanted


def safe_name(name: str) -> str:
    """A safe file name: without folders, leading dots and unusual characters."""
    plain = re.sub(r"[^\w .()+-]", "_", re.split(r"[/\\]", name)[-1]).strip(" .")
    stem, dot, suffix = plain.rpartition(".")
    return f"{(stem or 'file')[:100]}{dot}{suffix[:12]}" if dot else plain[:100] or "file"
