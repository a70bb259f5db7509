"""Swatch libraries: folders of .swatch files with an index, beside the shipped swatches, which are read-only.

The index `index.json` lists name, file, hash, size, figures, provenance, licence and tags of each swatch. `get`
downloads swatches from a library folder on any web server. The user's library may contain folders, each of which is a
library folder; names are unique across the folders. The shipped swatches are the measured ones and the folder of
computed ones.
"""

import hashlib
import json
import operator
import os
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from dataclasses import replace as with_changes
from functools import cache
from importlib import resources
from importlib.resources.abc import Traversable
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final
from urllib.parse import quote, urljoin, urlsplit

import msgspec
from msgspec import Meta

from hapscene.errors import SwatchError, no_such, printable
from hapscene.io.files import parse_format, read_bytes, refusing, short, to_struct, write_whole
from hapscene.surface.swatch import NAME_MAX, TOOL_FIELDS, Swatch, touched_with
from hapscene.surface.swatch_file import (
    BYTES_MAX,
    SUFFIX,
    Number,
    read_swatch,
    swatch_from_json,
    swatch_to_json,
)
from hapscene.surface.swatch_summary import figures, words

if TYPE_CHECKING:
    from requests import Response

__all__ = [
    "LibraryEntry",
    "add",
    "computed_entries",
    "edit",
    "find",
    "get",
    "library_folder",
    "load_swatch",
    "own_entries",
    "own_folders",
    "read_index",
    "remove",
    "search",
    "shipped_entries",
    "shipped_swatches",
]

INDEX: Final = "index.json"
FORMAT: Final = "hapscene library"
VERSION: Final = 1

COMPUTED: Final = "computed"
"""Folder of shipped swatches that were computed, not measured."""

TAG_MAX: Final = 20
"""Maximum number of tags of a swatch [count]."""

TAG_LENGTH_MAX: Final = 40
"""Maximum length of a tag [characters]."""

INDEX_BYTES_MAX: Final = 8 * 1024 * 1024
"""Maximum size of an index [bytes]: about ten thousand swatches."""

LOCK: Final = ".lock"
"""File in the folder of the library that a writer locks, so that the changes of several writers are all kept."""

LOCK_WAIT_S: Final = 20.0
"""Maximum wait for other writers [s]; a change takes a few milliseconds."""

ENVIRONMENT: Final = "HAPSCENE_LIBRARY"
"""Environment variable that names the folder of the library."""

_DEVICE: Final = r"(?i:con|prn|aux|nul|com\d|lpt\d)\b"  # on Windows
_FILE_NAME: Final = rf"\A(?!{_DEVICE})[A-Za-z0-9_][A-Za-z0-9 ._()+-]{{0,120}}\.swatch\Z"
_Utf8 = Annotated[str, Meta(pattern=r"\A[^\ud800-\udfff]*\Z")]
_FOLDER: Final = re.compile(r"[A-Za-z0-9_]([A-Za-z0-9 ._()+-]{0,58}[A-Za-z0-9_)+-])?")


@dataclass(frozen=True)
class LibraryEntry:
    """Entry of a swatch in an index."""

    name: Annotated[str, Meta(min_length=1, max_length=NAME_MAX)]
    file: Annotated[str, Meta(pattern=_FILE_NAME)]
    sha256: Annotated[str, Meta(pattern=r"\A[0-9a-f]{64}\Z")]
    bytes: Annotated[int, Meta(gt=0, le=BYTES_MAX)]
    provenance: _Utf8 = ""
    licence: _Utf8 = ""
    figures: dict[str, Number] = field(default_factory=dict)
    tags: tuple[str, ...] = ()
    tool: Annotated[str, Meta(max_length=NAME_MAX)] = ""
    tip: Annotated[str, Meta(max_length=NAME_MAX)] = ""

    @property
    def words(self) -> list[str]:
        """Description of the surface, such as ["firm", "rough"]."""
        return words(self.figures)


class _Index(msgspec.Struct):
    swatches: list[LibraryEntry]


def library_folder(folder: str | os.PathLike[str] | None = None) -> Path:
    """Return the folder of the library: `folder`, else the value of `HAPSCENE_LIBRARY`, else the user data folder."""
    if folder is not None:
        return Path(folder)
    if os.environ.get(ENVIRONMENT):
        return Path(os.environ[ENVIRONMENT])
    from platformdirs import user_data_path

    return user_data_path("hapscene", appauthor=False) / "swatches"


def shipped_swatches() -> list[str]:
    """Return the names of the shipped measured swatches, sorted."""
    folder = resources.files("hapscene_swatches")
    return sorted(f.name.removesuffix(SUFFIX) for f in folder.iterdir() if f.name.endswith(SUFFIX))


def load_swatch(name_or_path: str | os.PathLike[str]) -> Swatch:
    """Load a swatch from a file, or by name from the user's library or the shipped swatches.

    A `Path`, and a string that ends in ".swatch" or contains a folder separator, is a file; other strings are names.

    Raises:
        SwatchError: the name is unknown; or the file is missing, too large, damaged, of a later version or unstable.
    """
    with resources.as_file(swatch_place(name_or_path)) as path:
        return read_swatch(path)


def swatch_place(name_or_path: str | os.PathLike[str], folder: str | os.PathLike[str] | None = None) -> Traversable:
    """Return the file that `load_swatch` reads; `folder` is that of the library.

    Raises:
        SwatchError: the name is unknown.
    """
    text = os.fspath(name_or_path)
    if not isinstance(name_or_path, str) or text.endswith(SUFFIX) or Path(text).name != text:
        return Path(text)
    known = shipped_swatches()
    place = resources.files("hapscene_swatches")
    if text not in known:
        own = find(text, folder)
        if own is not None:
            return own
        place = place / COMPUTED
        computed = [entry.name for entry in computed_entries()]
        if text not in computed:
            known += [*computed, *(entry.name for home in own_folders(folder) for entry in own_entries(home))]
            raise SwatchError(no_such("swatch", text, known))
    return place / (text + SUFFIX)


def shipped_entries() -> list[LibraryEntry]:
    """Return the index entries of the shipped measured swatches."""
    folder = resources.files("hapscene_swatches")
    return [entry_of(load_swatch(name), (folder / (name + SUFFIX)).read_bytes()) for name in shipped_swatches()]


@cache
def computed_entries() -> list[LibraryEntry]:
    """Return the index entries of the shipped computed swatches."""
    index = resources.files("hapscene_swatches") / COMPUTED / INDEX
    return parse_index(index.read_bytes(), "the computed swatches") if index.is_file() else []


def own_folders(folder: str | os.PathLike[str] | None = None) -> list[Path]:
    """Return the folder of the library and the library folders in it, by name."""
    home = library_folder(folder)
    inside = home.iterdir() if home.is_dir() else ()
    return [home, *sorted(path for path in inside if _FOLDER.fullmatch(path.name) and (path / INDEX).is_file())]


def own_entries(folder: str | os.PathLike[str] | None = None) -> list[LibraryEntry]:
    """Return the index entries of a library folder; empty if it does not exist.

    Raises:
        SwatchError: the index is damaged.
    """
    path = library_folder(folder) / INDEX
    if not path.is_file():
        return []
    with refusing(SwatchError):
        data = read_bytes(path, INDEX_BYTES_MAX, "index")
    return parse_index(data, str(path))


def find(name: str, folder: str | os.PathLike[str] | None = None) -> Path | None:
    """Return the file of a swatch in any folder of the library; None if it is not found."""
    found = _found(name, folder)
    return None if found is None else found[0] / found[1].file


def _found(name: str, folder: str | os.PathLike[str] | None) -> tuple[Path, LibraryEntry] | None:
    """Return the library folder and the entry of a swatch."""
    each = ((home, entry) for home in own_folders(folder) for entry in own_entries(home))
    return next(((home, entry) for home, entry in each if entry.name == name), None)


def add(
    swatch: Swatch,
    folder: str | os.PathLike[str] | None = None,
    replace: bool = False,
    *,
    inside: str = "",
    tags: Iterable[str] = (),
) -> LibraryEntry:
    """Add a swatch to the library under its name.

    Args:
        swatch: the swatch.
        folder: folder of the library; None for the user's library.
        replace: replace a swatch with the same name and keep its tags.
        inside: folder in the library, created if missing; "" for the library itself.
        tags: search words.

    Raises:
        SwatchError: the name is that of a shipped swatch or exists, or the folder cannot be written.
    """
    root = library_folder(folder)
    _make_folder(root)
    with _locked(root):
        old = _found(swatch.name, root)
        _check_name(swatch.name, taken=old is not None and not replace, known=old is not None)
        home = old[0] if old is not None else root / _checked_folder(inside)
        return _put(swatch, home, _checked_tags(tags) or (old[1].tags if old else ()), old)


def edit(
    name: str,
    folder: str | os.PathLike[str] | None = None,
    *,
    new_name: str | None = None,
    tags: Iterable[str] | None = None,
    inside: str | None = None,
) -> LibraryEntry:
    """Rename, tag or move a swatch of the library; arguments that are None change nothing. Return its new entry.

    Raises:
        SwatchError: no such swatch, the name exists, a tag or folder name is invalid, or a file cannot be written.
    """
    with _locked(library_folder(folder)):
        old = _found(name, folder)
        if old is None:
            raise SwatchError(_no_own(name, folder))
        swatch = read_swatch(old[0] / old[1].file)
        if new_name is not None and new_name != name:
            _check_name(new_name, taken=_found(new_name, folder) is not None, known=False)
            swatch = with_changes(swatch, name=new_name)
        home = old[0] if inside is None else library_folder(folder) / _checked_folder(inside)
        return _put(swatch, home, old[1].tags if tags is None else _checked_tags(tags), old)


def remove(name: str, folder: str | os.PathLike[str] | None = None) -> Path:
    """Remove a swatch from the library and delete its file; return the deleted file.

    Raises:
        SwatchError: no such swatch in the library, or it cannot be deleted.
    """
    with _locked(library_folder(folder)):
        old = _found(name, folder)
        if old is None:
            raise SwatchError(_no_own(name, folder))
        return _take(*old)


def _no_own(name: str, folder: str | os.PathLike[str] | None) -> str:
    """Return the error message for a swatch that is not in the user's library."""
    if name in (*shipped_swatches(), *(entry.name for entry in computed_entries())):
        return f"{name!r} is a shipped swatch, which cannot be changed"
    known = [entry.name for home in own_folders(folder) for entry in own_entries(home)]
    return no_such("swatch", name, known) + f" in {library_folder(folder)}"


@contextmanager
def _locked(root: Path) -> Iterator[None]:
    """Context manager: lock the library against other writers, in this process and in others.

    Raises:
        SwatchError: the folder cannot be written, or others hold the lock for longer than `LOCK_WAIT_S`.
    """
    from filelock import FileLock, Timeout

    if not root.is_dir():  # an empty library; `add` creates the folder first
        yield
        return
    lock = FileLock(root / LOCK, timeout=LOCK_WAIT_S)
    try:
        held = lock.acquire(poll_interval=0.01)
    except Timeout:
        raise SwatchError(f"{root}: another program has been writing there for {LOCK_WAIT_S:g} s: try again") from None
    except OSError as error:
        raise SwatchError(f"{root}: cannot be written: {error.strerror or error}") from None
    with held:
        yield


@contextmanager
def _restored_on_error(*paths: Path) -> Iterator[None]:
    """Context manager: restore the content of files if an exception leaves it."""
    before = {path: path.read_bytes() if path.is_file() else None for path in paths}
    try:
        yield
    except BaseException:
        for path, content in before.items():
            with suppress(OSError, SwatchError):
                if content is None:
                    path.unlink(missing_ok=True)
                elif path.read_bytes() != content:
                    write_whole(path, content, SwatchError)
        raise


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SwatchError(f"{folder}: cannot be written: {error.strerror or error}") from None


def _put(
    swatch: Swatch, home: Path, tags: tuple[str, ...], old: tuple[Path, LibraryEntry] | None = None
) -> LibraryEntry:
    """Write a swatch to a library folder, replacing an old entry in any folder. If this fails, nothing changes."""
    entries = {entry.name: entry for entry in own_entries(home)}
    here = None
    if old is not None and old[0] == home:
        here = entries.pop(old[1].name)
    text = swatch_to_json(swatch).encode("utf-8")
    taken = {entry.file.casefold() for entry in entries.values()} | {f.name.casefold() for f in home.glob("*")}
    entry = entry_of(swatch, text, taken - ({here.file.casefold()} if here else set()), tags)
    _make_folder(home)
    with _restored_on_error(home / entry.file, home / INDEX):
        write_whole(home / entry.file, text, SwatchError)
        write_index(home, (entries | {entry.name: entry}).values())
        if old is not None and here is None:
            _take(*old)
    if here is not None and here.file != entry.file:
        with suppress(OSError):  # no entry names this file any more
            (home / here.file).unlink()
    return entry


def _take(home: Path, gone: LibraryEntry) -> Path:
    """Remove a swatch from a library folder. If this fails, nothing changes."""
    with _restored_on_error(home / INDEX):
        write_index(home, (entry for entry in own_entries(home) if entry.name != gone.name))
        try:
            (home / gone.file).unlink(missing_ok=True)
        except OSError as error:
            raise SwatchError(f"{home / gone.file}: cannot be removed: {error.strerror or error}") from None
    return home / gone.file


def _check_name(name: str, *, taken: bool, known: bool) -> None:
    """Check the name of a swatch that is added."""
    if name in shipped_swatches() or (not known and name in {entry.name for entry in computed_entries()}):
        raise SwatchError(f"{name!r} is the name of a shipped swatch: choose another name (--name)")
    if "/" in name or "\\" in name or name.endswith(SUFFIX):
        raise SwatchError(f"{name!r} looks like a file name: choose another name (--name)")
    if taken:
        raise SwatchError(f"{name!r} is already in the library: replace it (--replace) or choose another name (--name)")


def _checked_folder(inside: str) -> str:
    if inside and (not _FOLDER.fullmatch(inside) or re.match(_DEVICE, inside)):
        raise SwatchError(f"invalid folder name {short(inside)}; expected a simple name such as metals")
    return inside


def _checked_tags(tags: Iterable[str]) -> tuple[str, ...]:
    found = tuple(dict.fromkeys(tag.strip() for tag in tags if tag.strip()))
    if len(found) > TAG_MAX or any(len(tag) > TAG_LENGTH_MAX or not tag.isprintable() for tag in found):
        raise SwatchError(
            f"invalid tags: expected at most {TAG_MAX} tags of 1 to {TAG_LENGTH_MAX} printable characters"
        )
    return found


def write_index(folder: Path, entries: Iterable[LibraryEntry]) -> None:
    """Write the index of a library folder atomically."""
    rows = [asdict(entry) for entry in sorted(entries, key=lambda entry: entry.name)]
    rows = [{key: value for key, value in row.items() if value or key not in TOOL_FIELDS} for row in rows]
    text = json.dumps({"format": FORMAT, "version": VERSION, "swatches": rows}, indent=1, ensure_ascii=False)
    write_whole(folder / INDEX, f"{text}\n".encode(), SwatchError)


def entry_of(swatch: Swatch, data: bytes, taken: Iterable[str] = (), tags: tuple[str, ...] = ()) -> LibraryEntry:
    """Return the index entry of a swatch with file content `data`, and a file name that is not in `taken`."""
    stem = re.sub(r"[^A-Za-z0-9_+-]+", "_", swatch.name).strip("_+-")[:80] or "swatch"
    stem = f"_{stem}" if re.match(_DEVICE, stem) else stem
    names = (stem + tail + SUFFIX for tail in chain(("",), (f"_{i}" for i in count(2))))
    held = set(taken)
    file = next(name for name in names if name.casefold() not in held)
    digest = hashlib.sha256(data).hexdigest()
    texts = swatch.name, file, digest, len(data), swatch.provenance, swatch.licence
    return LibraryEntry(*texts, figures(swatch), tags, swatch.tool, swatch.tip)


def verified(entry: LibraryEntry, data: bytes, where: str) -> Swatch:
    """Parse the content of a swatch file, which must match its index entry.

    Raises:
        SwatchError: the hash or the name differs, or the swatch is invalid.
    """
    if hashlib.sha256(data).hexdigest() != entry.sha256:
        raise SwatchError(f"{where}: its SHA-256 differs from the index")
    with refusing(SwatchError, where):
        swatch = swatch_from_json(data)
    if swatch.name != entry.name:
        raise SwatchError(f"{where}: its name is {swatch.name!r}, but {entry.name!r} in the index")
    return swatch


def parse_index(data: bytes, where: str) -> list[LibraryEntry]:
    """Parse an untrusted index; its file names cannot refer to other folders.

    Raises:
        SwatchError: not an index, of a later version, or with an invalid entry.
    """
    if len(data) > INDEX_BYTES_MAX:
        raise SwatchError(f"{where}: larger than {INDEX_BYTES_MAX >> 20} MiB, the maximum for an index")
    with refusing(SwatchError, where):
        content = parse_format(data, "an index of swatches", FORMAT, VERSION)
        found = to_struct(content, _Index).swatches
        entries = [_checked(entry, f"swatches[{i}]") for i, entry in enumerate(found)]
        for key, values in (("name", {e.name for e in entries}), ("file", {e.file.casefold() for e in entries})):
            if len(values) < len(entries):
                raise SwatchError(f"two swatches have the same {key}")
    return entries


def _checked(entry: LibraryEntry, place: str) -> LibraryEntry:
    """Check what the types of an entry do not state."""
    for key in ("name", *TOOL_FIELDS):
        if not getattr(entry, key).isprintable():
            raise SwatchError(f"{place}.{key} must be printable characters")
    with refusing(SwatchError, f"{place}.tags"):
        return with_changes(entry, tags=_checked_tags(entry.tags))


# Search: words and bounds.


_BOUND: Final = re.compile(r"([A-Za-z][A-Za-z0-9_]*)\s*(<=|>=|<|>)\s*(\S+)")
_COMPARE: Final = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}
_SHORT: Final = {"stiffness": "stiffness_N_m", "roughness": "roughness_m_s2", "friction": "friction_dynamic"}


def search(entries: Iterable[LibraryEntry], terms: Iterable[str]) -> list[LibraryEntry]:
    """Return the entries that match all terms.

    A term is a part of the name, the beginning of a word of description or tags, or a word of tool, tip, provenance or
    licence, ignoring case ("wood", "probe"); or a bound on a figure ("friction<0.3", "stiffness>=500", "tap_Hz>80").

    Raises:
        SwatchError: an invalid bound, or one on an unknown figure.
    """
    found = list(entries)
    known = {key for entry in found for key in entry.figures} | set(_SHORT)
    for term in terms:
        bound = _BOUND.fullmatch(term.strip())
        if bound is None and re.search("[<>]", term):
            raise SwatchError(f"{term!r}: invalid bound; expected a figure, <, <=, > or >=, and a number: friction<0.4")
        if bound is None:
            found = [entry for entry in found if _has(entry, term.strip().casefold())]
            continue
        name, sign, limit = bound.groups()
        if name not in known:
            raise SwatchError(f"unknown figure {name!r}; expected one of: {', '.join(sorted(known))}")
        try:
            value = float(limit)
        except ValueError:
            raise SwatchError(f"{term!r}: expected a number after {sign}, not {limit!r}") from None
        key = _SHORT.get(name, name)
        found = [e for e in found if key in e.figures and _COMPARE[sign](e.figures[key], value)]
    return found


def _has(entry: LibraryEntry, word: str) -> bool:
    """Whether a word is part of the name, begins a word of the description or tags, or is a word of the other texts."""
    if word in entry.name.casefold() or any(token.startswith(word) for token in _tokens(*entry.words, *entry.tags)):
        return True
    return set(_tokens(word)) <= set(_tokens(touched_with(entry), entry.provenance, entry.licence))


def _tokens(*texts: str) -> list[str]:
    return re.findall(r"\w+", " ".join(texts).casefold())


# Download of swatches from a library folder on a web server.
#
# Servers are untrusted: names and sizes in the index are checked, at most the declared size is read, hashes must match,
# and swatches are parsed as untrusted files.


TIMEOUT_S: Final = 20.0
"""Timeout of a server [s]."""

REDIRECTIONS_MAX: Final = 5
"""Maximum number of redirections per attempt [count]; two or three are common."""

REASON_SHOWN: Final = 120
"""Maximum length of text from a server in a message [characters]."""


def read_index(url: str) -> tuple[str, list[LibraryEntry]]:
    """Download an index; return its address and entries. `url` is the address of the index or its folder.

    Raises:
        SwatchError: not an http or https address, no answer, or an invalid index.
    """
    if urlsplit(url).scheme not in ("http", "https") or not urlsplit(url).netloc:
        raise SwatchError(f"{url!r} is not a valid address; expected http://… or https://…")
    url = url.removesuffix("index.html")  # the address of a published site in a browser
    address = url if url.endswith(".json") else urljoin(url.rstrip("/") + "/", INDEX)
    return address, parse_index(_downloaded(address, INDEX_BYTES_MAX), address)


def get(
    name: str,
    address: str,
    entries: list[LibraryEntry],
    *,
    folder: str | os.PathLike[str] | None = None,
    replace: bool = False,
    new_name: str | None = None,
) -> LibraryEntry:
    """Download a swatch into the library, with its tags.

    Args:
        name: name of the swatch.
        address: address of the index from `read_index`; the file is in the same folder.
        entries: entries of the index.
        folder: folder of the library; None for the user's library.
        replace: replace a swatch with the same name.
        new_name: name in the library; None for its name in the index.

    Raises:
        SwatchError: no such swatch, no answer, invalid content, or an existing name. The library is then unchanged.
    """
    entry = next((e for e in entries if e.name == name), None)
    if entry is None:
        raise SwatchError(no_such("swatch", name, (e.name for e in entries)) + f" at {address}")
    url = urljoin(address, quote(entry.file))
    swatch = verified(entry, _downloaded(url, entry.bytes), url)
    named = swatch if new_name is None else with_changes(swatch, name=new_name)
    return add(named, folder, replace, tags=entry.tags)


def _downloaded(url: str, most: int) -> bytes:
    """Download at most `most` bytes."""
    import requests
    from urllib3.exceptions import HTTPError

    place = url
    try:
        with requests.Session() as session:
            # requests would follow redirections itself and read their content without a limit
            session.get_redirect_target = lambda resp: None  # type: ignore[method-assign]
            for _ in range(REDIRECTIONS_MAX + 1):
                headers = {"Accept-Encoding": "identity"}
                with session.get(place, headers=headers, stream=True, timeout=TIMEOUT_S) as answer:
                    if not answer.is_redirect:
                        return _content(url, answer, most)
                    place = _redirected(place, answer.headers["Location"])
    except (requests.RequestException, HTTPError) as error:
        raise SwatchError(f"{url}: cannot be downloaded: {printable(_reason(error))}; try again") from None
    raise SwatchError(f"{url}: more than {REDIRECTIONS_MAX} redirections")


def _content(url: str, answer: "Response", most: int) -> bytes:
    """Read the content of a response, which must not be compressed or longer than `most` bytes."""
    if answer.status_code != 200:
        reason = printable(str(answer.reason), REASON_SHOWN)
        raise SwatchError(f"{url}: the server returns {answer.status_code} {reason}")
    if answer.headers.get("Content-Encoding", "identity").lower() != "identity":
        raise SwatchError(f"{url}: the server sends compressed data, which was not requested")
    data: bytes = answer.raw.read(most + 1, decode_content=False)
    if len(data) > most:
        raise SwatchError(f"{url}: is longer than {most} bytes")
    return data


def _redirected(place: str, target: str) -> str:
    """Return the target of a redirection: http or https, and only https from https."""
    try:
        found = urljoin(place, target)
    except ValueError:
        raise SwatchError(f"{place}: is redirected to the invalid address {printable(target, REASON_SHOWN)}") from None
    schemes = ("https",) if urlsplit(place).scheme == "https" else ("http", "https")
    if urlsplit(found).scheme not in schemes:
        raise SwatchError(
            f"{place}: is redirected to {printable(found, REASON_SHOWN)}; expected {' or '.join(schemes)}"
        )
    return found


def _reason(error: BaseException) -> str:
    """Return the innermost cause of a failed transfer."""
    cause = error
    while cause.__context__ is not None:
        cause = cause.__context__
    return " ".join(str(cause).split())[:150] or type(cause).__name__
