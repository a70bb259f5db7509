"""What a page that reads slowly still gets."""

import json
from typing import Any

import numpy as np
import pytest

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")

from hapscene.paint.web.socket import BACKLOG_BYTES_MAX, PageSocket, parse_file_list


class Slow:
    """A connection on which much waits already, and what was sent on it."""

    def __init__(self, waiting_bytes: int) -> None:
        self.waiting_bytes = waiting_bytes
        self.transport = self
        self.sent: list[str | bytes] = []
        self.aborted = False

    def get_write_buffer_size(self) -> int:
        return self.waiting_bytes

    def abort(self) -> None:
        self.aborted = True


@pytest.fixture(autouse=True)
def wire(monkeypatch: pytest.MonkeyPatch) -> None:
    def broadcast(connections: list[Slow], content: str | bytes) -> None:
        for connection in connections:
            connection.sent.append(content)

    monkeypatch.setattr("websockets.asyncio.server.broadcast", broadcast)


async def nothing(message: Any) -> None:
    """Ignore a message."""


@pytest.mark.parametrize(("waiting_bytes", "count"), [(BACKLOG_BYTES_MAX - 1, 5), (BACKLOG_BYTES_MAX, 3)])
def test_slow_client_loses_traces_but_no_messages(waiting_bytes: int, count: int) -> None:
    """A dropped trace is replaced by the next; a dropped state would leave the page wrong."""
    live, page = PageSocket(nothing, lambda client: {"undo": "fill"}), Slow(waiting_bytes)
    live._sockets[page] = 3
    live.send_state()
    live.sound(np.zeros(9), 1e4, 0, 1.0, 3)
    live.trace(np.zeros(3), np.zeros((3, 10)), 1e-3)
    live.say("Saved.")
    live.say("Not saved.", "error")
    assert len(page.sent) == count
    texts = [json.loads(content) for content in page.sent if isinstance(content, str)]
    assert texts[0] == {"state": {"undo": "fill"}} and [text.get("say") for text in texts[1:]] == [
        "Saved.",
        "Not saved.",
    ]


def test_client_that_reads_nothing_is_disconnected() -> None:
    """What waits for it would fill the memory."""
    live, page = PageSocket(nothing, lambda client: {}), Slow(10 * BACKLOG_BYTES_MAX)
    live._sockets[page] = 3
    live.say("Saved.")
    assert page.aborted and not page.sent


def test_list_of_an_upload() -> None:
    def listed(*sizes: Any) -> Any:
        files = [{"name": f"{i}.obj", "size": n} for i, n in enumerate(sizes)]
        return parse_file_list(json.dumps({"files": files}))

    assert listed(3, 0) == {"0.obj": 3, "1.obj": 0}
    for invalid in (listed(-1), listed(True), listed(1.5), listed("1"), listed(1, -1), listed(), listed(1 << 50)):
        assert isinstance(invalid, str)
