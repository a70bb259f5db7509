"""A process of its own that draws: how it is started, why it failed, and that it goes with the one that started it.

Its own, since a driver that crashes takes only it along, and GL is set up once in a process.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, Final

PREFIX: Final = "hapscene-"
"""What the folder of a job is called by, among the system's temporary ones."""

LINE_MAX: Final = 160
"""Longest reason that is given [characters]."""


class Apart:
    """A process under way.

    Attributes:
        process: itself.
    """

    def __init__(self, process: "subprocess.Popen[bytes]", complaint: IO[bytes]) -> None:
        self.process, self._complaint = process, complaint

    def reason(self) -> str:
        """The last line that it wrote on its way out."""
        code = self.process.wait()
        self._complaint.seek(0)
        lines = [line.strip() for line in self._complaint.read().decode(errors="replace").splitlines() if line.strip()]
        return lines[-1][:LINE_MAX] if lines else f"ended with code {code}"


@contextmanager
def job_folder() -> Iterator[Path]:
    """A folder for what the process is handed."""
    with tempfile.TemporaryDirectory(prefix=PREFIX, ignore_cleanup_errors=True) as name:
        yield Path(name)


@contextmanager
def apart(module: str, job: Path, environment: Mapping[str, str], stdout: int | None = None) -> Iterator[Apart]:
    """Run `python -m MODULE JOB`; it is ended with the context, or with this process however that ends.

    Args:
        module: calls `go_with_the_other` first of all.
        job: the folder of `job_folder`.
        environment: its environment.
        stdout: as for Popen.
    """
    command = [sys.executable, "-m", module, str(job)]
    streams: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": stdout}  # stdin ends with this process
    with (
        tempfile.TemporaryFile() as complaint,
        subprocess.Popen(command, env=environment, stderr=complaint, **streams) as process,
    ):
        try:
            yield Apart(process, complaint)
        finally:
            process.kill()


def go_with_the_other(job: Path) -> None:
    """In the process: once the one that started it is gone, remove what it left, and go too."""

    def wait() -> None:
        while os.read(0, 1):  # nothing is ever sent
            pass
        if job.name.startswith(PREFIX) and job.parent.samefile(tempfile.gettempdir()):  # none but ours
            shutil.rmtree(job, ignore_errors=True)
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
