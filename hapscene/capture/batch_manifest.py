"""The manifest of a batch: what became of each recording. It makes a batch one that can be stopped and gone on with."""

import hashlib
import json
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Final, Literal

from hapscene.errors import CaptureError
from hapscene.output import write_whole

NAME: Final = "manifest.json"
FORMAT: Final = "hapscene batch"
VERSION: Final = 1

BYTES_MAX: Final = 256 << 20
"""Largest manifest that is opened [bytes]: half a million recordings."""

SAVE_S: Final = 1.0
"""Shortest time between two savings [s]. What a killed batch forgets is fitted again, into the same files."""

SAVE_SHARE: Final = 0.05
"""Largest share of the time that may go into saving [1]: counts when there are 10,000 recordings and more."""


@dataclass
class Entry:
    """What became of a recording."""

    recording: str
    """absolute path"""
    output: str
    """the swatch's file, relative to the manifest"""
    status: Literal["waiting", "ok", "failed"] = "waiting"
    reason: str = ""
    """why it failed"""
    sha256: str = ""
    """of the recording's file when it was fitted"""
    settings: str = ""
    """digest of how it was read and fitted, and of hapscene's version"""
    output_sha256: str = ""
    duration_s: float = 0.0
    """how long the fit took"""


class Manifest:
    """The entries of a batch's folder, by recording."""

    def __init__(self, folder: Path) -> None:
        """Opens the folder's manifest, or begins one.

        Raises:
            CaptureError: a manifest that is damaged or of a later version.
        """
        self.folder = folder
        self.path = folder / NAME
        self.entries: dict[str, Entry] = {e.recording: e for e in _read(self.path)} if self.path.exists() else {}
        self._saved_s = -1e9
        self._cost_s = 0.0

    def add(self, recording: Path, output: str) -> Entry:
        """The entry of a recording, a new one where it had none or its swatch was to go elsewhere.

        Raises:
            CaptureError: the output is that of another recording.
        """
        key = str(recording.absolute())
        entry = self.entries.get(key)
        if entry is None or entry.output != output:
            entry = self.entries[key] = Entry(key, output)
        return entry

    def check_outputs(self) -> None:
        """No swatch may be that of two recordings: a batch would silently replace what another one made."""
        owner: dict[str, str] = {}
        for entry in self.entries.values():
            other = owner.setdefault(entry.output.casefold(), entry.recording)
            if other != entry.recording:
                raise CaptureError(
                    f"{self.folder / entry.output}: is the swatch of {other} and would be that of {entry.recording}: "
                    "take another folder"
                )

    def is_done(self, entry: Entry, sha256: str, settings: str) -> bool:
        """Whether that content was fitted in that way and its swatch is still there."""
        same = entry.status == "ok" and entry.sha256 == sha256 and entry.settings == settings
        return same and (self.folder / entry.output).is_file()

    def save(self, at_once: bool = True) -> None:
        """Writes the manifest whole; with `at_once` false only if it is time for it."""
        start_s = time.monotonic()
        if not at_once and start_s - self._saved_s < max(SAVE_S, self._cost_s / SAVE_SHARE):
            return
        rows = [asdict(entry) for entry in self.entries.values()]
        text = json.dumps({"format": FORMAT, "version": VERSION, "recordings": rows}, indent=1, ensure_ascii=False)
        write_whole(self.path, text.encode(), CaptureError)
        self._saved_s = time.monotonic()
        self._cost_s = self._saved_s - start_s


def digest(settings: Mapping[str, Any]) -> str:
    """Short text that differs where settings do."""
    text = json.dumps(settings, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _read(path: Path) -> list[Entry]:
    try:
        with path.open("rb") as f:
            data = f.read(BYTES_MAX + 1)
    except OSError as error:
        raise CaptureError(f"{path}: cannot be read: {error.strerror}") from None
    try:
        content = json.loads(data) if len(data) <= BYTES_MAX else None
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise CaptureError(f"{path}: not the manifest of a batch: take another folder")
    if content.get("version") != VERSION:
        raise CaptureError(f"{path}: a manifest of version {content.get('version')}, read here is {VERSION}")
    kinds = {f.name: float if f.name == "duration_s" else str for f in fields(Entry)}
    found = content.get("recordings")
    rows: list[Any] = found if isinstance(found, list) else [None]
    for row in rows:
        if not isinstance(row, dict) or any(not isinstance(row.get(key), kind) for key, kind in kinds.items()):
            raise CaptureError(f"{path}: a damaged manifest: remove it, or take another folder")
    return [Entry(**{key: row[key] for key in kinds}) for row in rows]
