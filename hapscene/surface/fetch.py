"""Swatches from a library on the web: any folder of swatches with its index behind a plain web server.

Nothing is believed: names and sizes of the index are checked, what arrives is never more than the index says, its
hash must match (pooch), and it is opened as any stranger's swatch is before it enters the library. A transfer that
breaks off is taken up where it stopped, if the server can, also by a later call; else it is begun again.
"""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote, urljoin, urlsplit

from hapscene.errors import SwatchError, no_such
from hapscene.surface.library import INDEX, INDEX_BYTES_MAX, Entry, add, library_folder, parse_index, verified

TIMEOUT_S: Final = 20.0
"""Longest silence of a server [s]."""

TRIES: Final = 4
"""Times a transfer is begun or taken up [count]."""

_CHUNK: Final = 1 << 16  # bytes


def read_index(url: str) -> tuple[str, list[Entry]]:
    """The address of an index and its entries; `url` names the index or the folder that it is in.

    Raises:
        SwatchError: no http or https address, no answer, or no valid index.
    """
    if urlsplit(url).scheme not in ("http", "https") or not urlsplit(url).netloc:
        raise SwatchError(f"{url!r} is no address: expected http://… or https://…")
    address = url if url.endswith(".json") else urljoin(url.rstrip("/") + "/", INDEX)
    data = bytearray()
    _retried(address, INDEX_BYTES_MAX, data.__len__, data.extend, data.clear)
    return address, parse_index(bytes(data), address)


def get(
    name: str, address: str, entries: list[Entry], folder: str | os.PathLike[str] | None = None, replace: bool = False
) -> Entry:
    """Fetches a swatch that an index lists, into the library.

    Args:
        name: of the swatch.
        address: of the index, as `read_index` gives it; the file lies beside it.
        entries: of the index.
        folder: the library's, None for the user's own.
        replace: take it though the library has one of that name.

    Raises:
        SwatchError: no such swatch, no answer, another content than the index says, no valid swatch, or a name that
            is taken. The library is then as it was.
    """
    entry = next((e for e in entries if e.name == name), None)
    if entry is None:
        raise SwatchError(no_such("swatch", name, (e.name for e in entries)) + f" at {address}")
    home = library_folder(folder)
    url = urljoin(address, quote(entry.file))
    try:
        home.mkdir(parents=True, exist_ok=True)
        data = _fetched(url, entry, home)
    except OSError as error:
        raise SwatchError(f"{url}: cannot be fetched into {home}: {error.strerror or error}") from None
    return add(verified(entry, data, url), home, replace)


def _fetched(url: str, entry: Entry, home: Path) -> bytes:
    """The content at `url`, of the size and hash that the entry says."""
    import pooch

    pooch.get_logger().setLevel("ERROR")
    part = home / f".{entry.sha256}.part"  # kept when a transfer breaks off, for the next try
    whole = home / f".{entry.sha256}.whole"

    def download(address: str, output: Any, _: Any) -> None:
        _resumed(address, entry.bytes, part)
        part.replace(output)

    if part.is_symlink() or (part.exists() and (not part.is_file() or part.stat().st_size > entry.bytes)):
        part.unlink()
    try:
        pooch.retrieve(url, f"sha256:{entry.sha256}", whole.name, home, downloader=download)
        return whole.read_bytes()
    except ValueError:  # pooch's word for another hash
        raise SwatchError(f"{url}: its content is not what the index says (sha256): not taken") from None
    finally:
        whole.unlink(missing_ok=True)


def _resumed(url: str, size: int, part: Path) -> None:
    """Fills `part` up to `size` bytes, from where it stands."""
    with part.open("ab") as file:

        def write(data: bytes) -> None:
            file.write(data)
            file.flush()

        def clear() -> None:
            file.seek(0)
            file.truncate()

        _retried(url, size, file.tell, write, clear)
        if file.tell() != size:
            clear()
            raise SwatchError(f"{url}: is shorter than the {size} bytes that the index says: not taken")


def _retried(
    url: str, most: int, held: Callable[[], int], write: Callable[[bytes], object], clear: Callable[[], object]
) -> None:
    """Transfers `url` into a sink, taking it up again when it breaks off; never writes more than `most` bytes."""
    import requests
    from urllib3.exceptions import HTTPError

    problem = ""
    for _ in range(TRIES):
        start = held()
        wanted = {"Accept-Encoding": "identity"} | ({"Range": f"bytes={start}-"} if start else {})
        try:
            with requests.get(url, headers=wanted, stream=True, timeout=TIMEOUT_S) as answer:
                if answer.status_code == 416 or (answer.status_code == 206 and not _continues(answer, start)):
                    clear()
                    problem = "cannot be taken up where it broke off"
                    continue
                if answer.status_code not in (200, 206):
                    raise SwatchError(f"{url}: the server says {answer.status_code} {answer.reason}")
                if answer.headers.get("Content-Encoding", "identity").lower() != "identity":
                    raise SwatchError(f"{url}: the server sends it compressed, which was not asked for: not taken")
                if answer.status_code == 200 and start:
                    clear()
                while data := answer.raw.read(_CHUNK, decode_content=False):
                    if held() + len(data) > most:
                        clear()
                        raise SwatchError(f"{url}: is longer than {most} bytes: not taken")
                    write(data)
                return
        except (requests.RequestException, HTTPError) as error:
            problem = _reason(error)
            if isinstance(error, requests.exceptions.InvalidURL | requests.exceptions.InvalidSchema):
                break
    raise SwatchError(f"{url}: cannot be fetched: {problem}")


def _continues(answer: Any, start: int) -> bool:
    """Whether a partial answer begins where it was asked to."""
    return str(answer.headers.get("Content-Range", "")).startswith(f"bytes {start}-")


def _reason(error: BaseException) -> str:
    """The innermost cause of a failed transfer, in a few words."""
    cause = error
    while cause.__context__ is not None:
        cause = cause.__context__
    return " ".join(str(cause).split())[:150] or type(cause).__name__
