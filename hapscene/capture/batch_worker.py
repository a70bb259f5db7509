"""What a process of a batch does: it fits one recording and gives back the text of the swatch's file.

It writes nothing: the process that runs the batch does, so that a fit that is done twice, because a process died, is
written once. Imported first thing in every process: nothing heavy at the top.
"""

import os
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Job:
    """A recording to be fitted."""

    path: str
    name: str
    content: bytes | None
    """of the file; None: the process can read the file itself"""
    reading: Mapping[str, Any]
    """arguments of `load_surface_recording`"""
    fitting: Mapping[str, Any]
    """arguments of `fit_parts` besides the recording and the name"""
    version: str
    """of the hapscene that runs the batch"""


@dataclass(frozen=True)
class Outcome:
    """What came of it: the text of a swatch, or why there is none."""

    sha256: str
    swatch: str | None
    reason: str
    duration_s: float
    note: str = ""
    """what is to be said of a recording that was fitted"""


def fit_job(job: Job) -> Outcome:
    """Fits a recording; what is wrong with it is told in the outcome, not raised."""
    import hashlib

    from hapscene.errors import HapsceneError

    start_s = time.monotonic()
    sha256 = ""
    try:
        content = read_content(Path(job.path)) if job.content is None else job.content
        sha256 = hashlib.sha256(content).hexdigest()
        swatch, note = _swatch(job, content)
        return Outcome(sha256, swatch, "", time.monotonic() - start_s, note)
    except HapsceneError as error:
        reason = str(error)
    except OSError as error:
        reason = f"{job.path}: cannot be read: {error.strerror or error}"
    except MemoryError:
        reason = f"{job.path}: not enough memory"
    except Exception as error:  # one odd recording must not end a batch of thousands
        reason = f"{job.path}: {type(error).__name__}: {error}"
    return Outcome(sha256, None, " ".join(reason.split()), time.monotonic() - start_s)


def _swatch(job: Job, content: bytes) -> tuple[str, str]:
    """The text of the swatch's file, and what is to be said of it.

    Of that very content: the file may change meanwhile, or be on another machine.
    """
    import tempfile

    from hapscene import __version__
    from hapscene.capture.recording_file import bridged_note, read_surface_recording
    from hapscene.capture.swatch_fit import fit_parts, prepare
    from hapscene.errors import CaptureError
    from hapscene.surface.swatch_file import swatch_to_json

    if job.version != __version__:
        raise CaptureError(f"{job.path}: the process has hapscene {__version__}, the batch {job.version}: update one")
    with tempfile.TemporaryDirectory(prefix="hapscene") as folder:
        copy = Path(folder) / f"recording{Path(job.path).suffix}"
        copy.write_bytes(content)
        try:
            recording = read_surface_recording(copy, **job.reading)
        except CaptureError as error:
            raise CaptureError(str(error).replace(str(copy), job.path)) from None
    try:
        swatch = fit_parts([prepare(recording)], job.name, **job.fitting)
    except CaptureError as error:
        raise CaptureError(f"{job.path}: {error}") from None
    return swatch_to_json(swatch), bridged_note(recording)


def read_content(path: Path) -> bytes:
    """The whole file, if it is not larger than a recording may be.

    Raises:
        CaptureError: larger.
    """
    from hapscene.capture.recording_source import BYTES_MAX
    from hapscene.errors import CaptureError

    if path.stat().st_size > BYTES_MAX:
        raise CaptureError(f"{path}: larger than {BYTES_MAX >> 20} MiB")
    return path.read_bytes()


def version() -> str:
    """Of hapscene in the process that is asked."""
    from hapscene import __version__

    return __version__


def begin_process() -> None:
    """Prepares a process of this machine: one thread for mathematics, Ctrl-C left to the parent, no life without it."""
    import multiprocessing
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for library in ("OMP", "OPENBLAS", "MKL"):
        os.environ[f"{library}_NUM_THREADS"] = "1"  # the processes share the cores already
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def follow() -> None:
        parent.join()
        os._exit(1)  # a killed parent cannot end its processes: without this they would wait for ever

    threading.Thread(target=follow, daemon=True).start()
