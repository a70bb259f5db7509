"""What a process of a batch does: it fits one recording and gives back the text of the swatch's file.

It writes nothing: the process that runs the batch does, so that a fit that is done twice, because a process died, is
written once. Imported first thing in every process: nothing heavy at the top.
"""

import hashlib
import time
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hapscene.errors import CaptureError, HapsceneError
from hapscene.files import read_bytes, refusing


@dataclass(frozen=True)
class Job:
    """A recording to be fitted."""

    path: str
    name: str
    content: bytes | None
    """of the file; None: the process can read the file itself"""
    reading: Mapping[str, Any]
    """arguments of `load_recording`"""
    fitting: Mapping[str, Any]
    """arguments of `fit_parts` besides the recording and the name"""
    version: str
    """of the hapscene that runs the batch"""


@dataclass(frozen=True)
class FitOutcome:
    """What came of it: the text of a swatch, or why there is none."""

    sha256: str
    swatch: str | None
    reason: str
    duration_s: float
    note: str = ""
    """what is to be said of a recording that was fitted"""


def fit_job(job: Job) -> FitOutcome:
    """Fits a recording; what is wrong with it is told in the outcome, not raised."""
    import tempfile

    start_s = time.monotonic()
    sha256 = ""
    try:
        with tempfile.TemporaryDirectory(prefix="hapscene") as folder:
            copy = Path(folder) / f"recording{Path(job.path).suffix}"
            sha256 = _copied(job, copy)
            swatch, note = _swatch(job, copy)
        return FitOutcome(sha256, swatch, "", time.monotonic() - start_s, note)
    except HapsceneError as error:
        reason = str(error)
    except OSError as error:
        reason = f"{job.path}: cannot be read: {error.strerror or error}"
    except MemoryError:
        reason = f"{job.path}: not enough memory"
    except Exception as error:  # one odd recording must not end a batch of thousands
        reason = f"{job.path}: cannot be fitted, by a fault of ours or a damaged file ({type(error).__name__}: {error})"
    return FitOutcome(sha256, None, " ".join(reason.split()), time.monotonic() - start_s)


def _copied(job: Job, copy: Path) -> str:
    """Write the recording's content, as it is now, into a file of our own; its SHA-256."""
    content = read_content(Path(job.path)) if job.content is None else job.content
    copy.write_bytes(content)
    return hashlib.sha256(content).hexdigest()


def _swatch(job: Job, copy: Path) -> tuple[str, str]:
    """The text of the swatch's file, and what is to be said of it.

    Of a copy: the recording may change meanwhile, or be on another machine.
    """
    from hapscene import __version__
    from hapscene.capture.io.recording import BridgedWarning, load_recording
    from hapscene.capture.swatch_fit import fit_parts, prepare
    from hapscene.surface.swatch_file import swatch_to_json

    if job.version != __version__:
        raise CaptureError(f"{job.path}: the process has hapscene {__version__}, the batch {job.version}: update one")
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", BridgedWarning)
            recording = load_recording(copy, **job.reading)
    except CaptureError as error:
        raise CaptureError(str(error).replace(str(copy), job.path)) from None
    with refusing(CaptureError, job.path):
        swatch = fit_parts([prepare(recording)], job.name, **job.fitting)
    bridged = [str(each.message) for each in caught if issubclass(each.category, BridgedWarning)]
    return swatch_to_json(swatch), "; ".join(note.removeprefix(f"{copy}: ") for note in bridged)


def content_sha256(path: Path) -> str:
    """SHA-256 of a recording's file.

    Raises:
        CaptureError: larger than a recording may be.
    """
    return hashlib.sha256(read_content(path)).hexdigest()


def read_content(path: Path) -> bytes:
    """The whole file, if it is not larger than a recording may be.

    Raises:
        CaptureError: larger.
    """
    from hapscene.capture.io.formats import BYTES_MAX

    with refusing(CaptureError):
        if path.is_file():
            return read_bytes(path, BYTES_MAX, "recording")
        with path.open("rb") as pipe:
            return pipe.read(BYTES_MAX + 1)  # one too many is refused when it is read
