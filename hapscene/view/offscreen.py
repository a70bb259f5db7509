"""Frames drawn without a screen, by a process of their own: `python -m hapscene.view.offscreen DIR`.

The platform of GL is fixed when it is first imported, so a second one can only be tried in a second process. It writes
each frame's pixels to its standard output.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Generator, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from ctypes.util import find_library
from dataclasses import replace
from pathlib import Path
from threading import Event, Timer
from typing import IO, TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import ViewError

if TYPE_CHECKING:
    from hapscene.view.triangles import Drawing

# A process of its own that draws: how it is started, why it failed, and that it goes with the one that started it.
#
# Its own, since a driver that crashes takes only it along, and GL is set up once in a process.


PREFIX: Final = "hapscene-"
"""What the folder of a job is called by, among the system's temporary ones."""

LINE_MAX: Final = 160
"""Longest reason that is given [characters]."""


class Drawer:
    """A process under way.

    Attributes:
        process: itself.
    """

    def __init__(self, process: "subprocess.Popen[bytes]", complaint: IO[bytes]) -> None:
        self.process, self._complaint = process, complaint

    def wake(self) -> None:
        """Set the event of `go_with_the_other` in the process, if it still runs."""
        assert self.process.stdin is not None
        with suppress(OSError):
            os.write(self.process.stdin.fileno(), b"\n")

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
def start_drawer(module: str, job: Path, environment: Mapping[str, str], stdout: int | None = None) -> Iterator[Drawer]:
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
            yield Drawer(process, complaint)
        finally:
            process.kill()


def go_with_the_other(job: Path) -> Event:
    """In the process: once the one that started it is gone, remove what it left, and go too.

    Returns:
        An event that `Drawer.wake` sets.
    """
    woken = Event()

    def wait() -> None:
        while os.read(0, 1):
            woken.set()
        if job.name.startswith(PREFIX) and job.parent.samefile(tempfile.gettempdir()):  # none but ours
            shutil.rmtree(job, ignore_errors=True)
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
    return woken


PLATFORMS: Final = {"osmesa": "libosmesa6", "egl": "libegl1 libgl1"}
"""GL without a screen, and the system packages that each is in."""

LIBRARIES: Final = {"osmesa": ("OSMesa",), "egl": ("EGL", "GL")}
"""The libraries in them."""

DRAWING: Final = "drawing.npz"
"""What the process is handed."""

TIMEOUT_S: Final = 120.0
"""Longest that a frame may take [s]. The first takes longest: a million triangles take 6."""


UNUSED: Final = ("scipy", "cascadio")
"""What pyrender imports through trimesh, where it is installed, and no drawing needs: half of the process's start."""

BATCH: Final = 60
"""Frames that one process draws [count]: OSMesa keeps some MB of each until its process ends."""


class _Undrawn(Exception):
    """Why no frame came."""


_ahead: dict[str, tuple[Path, Drawer]] = {}
"""Processes by platform that were started ahead and have no drawing yet, each with the folder of its job."""


@contextmanager
def started_ahead(wanted: bool = True) -> Iterator[None]:
    """Start the process of the next `draw` now: importing GL takes it longer than drawing, and nobody waits for it.

    Args:
        wanted: whether anything will be drawn; else nothing is started.
    """
    if not wanted:
        yield
        return
    platform = platforms()[0]
    with _started(platform) as (job, drawer):
        _ahead[platform] = job, drawer
        try:
            yield
        finally:
            _ahead.pop(platform, None)


@contextmanager
def _started(platform: str) -> Iterator[tuple[Path, Drawer]]:
    """A process that draws on the platform, and the folder of its job: the one that was started ahead, if there is."""
    if platform in _ahead:
        yield _ahead.pop(platform)
        return
    environment = os.environ | {"PYOPENGL_PLATFORM": platform}
    with job_folder() as job, start_drawer("hapscene.view.offscreen", job, environment, subprocess.PIPE) as drawer:
        yield job, drawer


def draw(drawing: "Drawing") -> Iterator[NDArray[np.uint8]]:
    """Draw with the first platform that can.

    Yields:
        RGB pixels (height, width, 3) of each frame, as it is drawn; the same for the same drawing and platform.

    Raises:
        ViewError: no platform can draw here; one line says why and which packages would help.
    """
    failures = []
    for platform in platforms():
        begun = False
        try:
            for first in range(0, len(drawing.frames), BATCH):
                frames = _draw_with(platform, replace(drawing, frames=drawing.frames[first : first + BATCH]))
                with closing(frames):
                    for pixels in frames:
                        begun = True
                        yield pixels
            return
        except _Undrawn as reason:
            if begun:
                raise ViewError(f"{platform} stopped drawing midway: {reason}") from None
            failures.append(f"{platform} ({reason}) needs {PLATFORMS[platform]}")
    raise ViewError("no GL can draw here; install one of these system packages: " + "; ".join(failures))


def platforms() -> list[str]:
    """Which are tried, in order: what PYOPENGL_PLATFORM names; EGL where there is a GPU; else OSMesa, which on a CPU
    is 2 to 5 frames a second faster than EGL."""
    order = ["egl", "osmesa"] if _has_gpu() else ["osmesa", "egl"]
    wished = os.environ.get("PYOPENGL_PLATFORM", "")
    return sorted(order, key=lambda name: name != wished)


def _has_gpu() -> bool:
    """Whether a GPU's device file is there, of NVIDIA's driver or of the kernel's own."""
    return any(Path("/dev").glob("nvidia[0-9]*")) or any(Path("/dev/dri").glob("renderD*"))


def _draw_with(platform: str, drawing: "Drawing") -> Generator[NDArray[np.uint8]]:
    """Draw in a process of its own.

    Raises:
        _Undrawn: why a frame did not come.
    """
    width, height = drawing.size
    with _started(platform) as (job, drawer):
        drawing.save(job / DRAWING)
        drawer.wake()
        pipe = drawer.process.stdout
        assert pipe is not None
        for _ in drawing.frames:
            content, late = _read(pipe, width * height * 3, drawer.process)
            if late:
                raise _Undrawn(f"took longer than {TIMEOUT_S:g} s")
            if len(content) < width * height * 3:
                raise _Undrawn(_reason(platform, drawer))
            yield np.frombuffer(content, np.uint8).reshape(height, width, 3)


def _read(pipe: IO[bytes], count: int, process: "subprocess.Popen[bytes]") -> tuple[bytes, bool]:
    """So many bytes, fewer where the process ends before; and whether it was too late and so was ended."""
    late = Event()

    def end() -> None:
        late.set()
        process.kill()

    timer = Timer(TIMEOUT_S, end)
    timer.start()
    try:
        return pipe.read(count), late.is_set()
    finally:
        timer.cancel()


def _reason(platform: str, drawer: Drawer) -> str:
    """Why the process ended without a frame: what PyOpenGL says where a library is not there, tells no one that."""
    told = drawer.reason()
    return told if all(map(find_library, LIBRARIES[platform])) else "not installed"


def _render(job: Path, woken: Event) -> None:
    """What the process does: import GL, wait for the drawing, draw."""
    from hapscene.view.gl import render, without_viewer
    from hapscene.view.triangles import Drawing

    with os.fdopen(os.dup(1), "wb") as out:
        os.dup2(2, 1)  # what a driver prints must not come between the pixels
        sys.modules.update(dict.fromkeys(UNUSED))  # type: ignore[arg-type]  # None refuses an import
        without_viewer()
        woken.wait()
        for pixels in render(Drawing.load(job / DRAWING)):
            out.write(pixels.tobytes())
            out.flush()


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    event = go_with_the_other(folder)
    try:
        _render(folder, event)
    except (KeyboardInterrupt, BrokenPipeError):
        sys.exit(1)
