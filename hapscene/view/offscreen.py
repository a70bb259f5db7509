"""Rendering without a screen in a child process: `python -m hapscene.view.offscreen`.

A process can load only one GL platform, so each platform needs a separate process, and a crash of a driver does not end
the main process. The child reads a pickled `Drawing` from standard input and writes pixels to standard output.
"""

import gc
import os
import pickle
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from ctypes.util import find_library
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import ViewError
from hapscene.io.confined import import_path

if TYPE_CHECKING:
    from hapscene.view.triangles import Drawing

__all__ = ["draw", "platforms", "started_ahead"]

LINE_MAX: Final = 160
"""Maximum length of a reason in an error [characters]."""

PLATFORMS: Final = {"osmesa": ("libosmesa6", ("OSMesa",)), "egl": ("libegl1 libgl1", ("EGL", "GL"))}
"""GL platforms without a screen: the system packages that they need, and the libraries in these packages."""

TIMEOUT_S: Final = 120.0
"""Maximum time for one frame [s]. The first frame takes longest: 6 s for a million triangles."""

UNUSED: Final = ("scipy", "cascadio")
"""Optional imports of trimesh that rendering does not need; they take half of the start time of the child."""

BATCH: Final = 60
"""Maximum number of frames per process [count]: OSMesa leaks some MB for each frame."""

BATCH_B: Final = 400_000_000
"""Maximum size of the pixels that a process returns [bytes]."""

_ahead: "dict[str, subprocess.Popen[bytes]]" = {}
"""Processes that `started_ahead` started and `draw` has not used yet, by platform."""


class _DrawingFailed(Exception):
    """The child process failed; the message is the reason."""


@contextmanager
def started_ahead() -> Iterator[None]:
    """Context manager: start the process of the next `draw` early, so that it imports GL while other work is done."""
    platform = platforms()[0]
    with _started(platform) as process:
        _ahead[platform] = process
        try:
            yield
        finally:
            _ahead.pop(platform, None)


@contextmanager
def _started(platform: str) -> "Iterator[subprocess.Popen[bytes]]":
    """Context manager: the process that was started ahead for this platform, else a new one; ended on exit."""
    if platform in _ahead:
        yield _ahead.pop(platform)
        return
    pipe = subprocess.PIPE
    with subprocess.Popen(
        [sys.executable, "-P", "-m", "hapscene.view.offscreen"],
        env=os.environ | import_path() | {"PYOPENGL_PLATFORM": platform},
        stdin=pipe,
        stdout=pipe,
        stderr=pipe,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def draw(drawing: "Drawing") -> Iterator[NDArray[np.uint8]]:
    """Render frames on the first platform that works.

    Yields:
        RGB pixels (height, width, 3) of each frame; equal for equal drawings and platforms.

    Raises:
        ViewError: no platform works; the message has the reasons and the missing packages.
    """
    failures = []
    count = int(np.clip(BATCH_B // (3 * drawing.size[0] * drawing.size[1]), 1, BATCH))
    for platform in platforms():
        drawn = False
        try:
            for first in range(0, len(drawing.frames), count):
                batch = replace(drawing, frames=drawing.frames[first : first + count])
                for pixels in _draw_batch(platform, batch):
                    drawn = True
                    yield pixels
            return
        except _DrawingFailed as reason:
            if drawn:
                raise ViewError(f"rendering with {platform} failed after the first frame: {reason}") from None
            failures.append(f"{platform} ({reason}) needs {PLATFORMS[platform][0]}")
    raise ViewError("no OpenGL platform works; install one of these system packages: " + "; ".join(failures))


def platforms() -> list[str]:
    """Return the GL platforms in the order in which they are tried.

    PYOPENGL_PLATFORM comes first, then EGL if there is a GPU. Without a GPU, OSMesa is faster.
    """
    order = ["egl", "osmesa"] if _has_gpu() else ["osmesa", "egl"]
    preferred = os.environ.get("PYOPENGL_PLATFORM", "")
    return sorted(order, key=lambda name: name != preferred)


def _has_gpu() -> bool:
    """Return whether a device file of a GPU exists, of the NVIDIA driver or of the kernel."""
    return any(Path("/dev").glob("nvidia[0-9]*")) or any(Path("/dev/dri").glob("renderD*"))


def _draw_batch(platform: str, drawing: "Drawing") -> NDArray[np.uint8]:
    """Pixels (n, height, width, 3) of all frames, drawn in one child process.

    Raises:
        _DrawingFailed: the process failed, or took too long.
    """
    width, height = drawing.size
    job = pickle.dumps(replace(drawing, parts=[part.in_float32() for part in drawing.parts]))
    with _started(platform) as process:
        try:
            pixels, complaint = process.communicate(job, TIMEOUT_S * len(drawing.frames))
        except subprocess.TimeoutExpired:
            raise _DrawingFailed(f"took longer than {TIMEOUT_S:g} s a frame") from None
    if len(pixels) < len(drawing.frames) * height * width * 3:
        # PyOpenGL's message about a missing library does not name the library
        installed = all(map(find_library, PLATFORMS[platform][1]))
        lines = [line.strip() for line in complaint.decode(errors="replace").splitlines() if line.strip()]
        last = lines[-1][:LINE_MAX] if lines else f"ended with code {process.returncode}"
        raise _DrawingFailed(last if installed else "not installed")
    return np.frombuffer(pixels, np.uint8).reshape(-1, height, width, 3)


def _main() -> None:
    """Main function of the child process: import GL, read the drawing, render it."""
    gc.disable()
    from hapscene.view.gl import render, without_viewer

    with os.fdopen(os.dup(1), "wb") as out:
        os.dup2(2, 1)  # keeps output of a driver out of the pixels
        sys.modules.update(dict.fromkeys(UNUSED))  # type: ignore[arg-type]  # None blocks the import
        without_viewer()
        gc.freeze()  # pyrender collects garbage each time it frees a buffer
        for pixels in render(pickle.load(sys.stdin.buffer)):
            out.write(pixels.tobytes())
            out.flush()
    os._exit(0)  # taking GL down takes longer than a small drawing


if __name__ == "__main__":
    try:
        _main()
    except (EOFError, KeyboardInterrupt, BrokenPipeError):  # the parent process has ended
        sys.exit(1)
