"""Frames drawn without a screen, by a process of their own: `python -m hapscene.view.offscreen JOB.npz`.

The platform of GL is fixed when it is first imported, so a second one can only be tried in a second process; and a
driver that crashes takes only the picture with it. The process writes each frame's pixels to its standard output.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Generator, Iterator
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from threading import Event, Timer
from typing import IO, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import ViewError
from hapscene.view.drawing import Drawing

PLATFORMS: Final = {"osmesa": "libosmesa6", "egl": "libegl1 libgl1"}
"""GL without a screen, and the system packages that each is in."""

TIMEOUT_S: Final = 120.0
"""Longest that a frame may take [s]. The first takes longest: a million triangles take 6."""


BATCH: Final = 60
"""Frames that one process draws [count]: OSMesa keeps some MB of each until its process ends."""


class _Undrawn(Exception):
    """Why no frame came."""


def draw(drawing: Drawing) -> Iterator[NDArray[np.uint8]]:
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


def _draw_with(platform: str, drawing: Drawing) -> Generator[NDArray[np.uint8]]:
    """Draw in a process of its own.

    Raises:
        _Undrawn: why a frame did not come.
    """
    width, height = drawing.size
    environment = os.environ | {"PYOPENGL_PLATFORM": platform}
    with ExitStack() as open_things:
        job = Path(open_things.enter_context(tempfile.TemporaryDirectory(prefix="hapscene-"))) / "job.npz"
        drawing.save(job)
        complaint = open_things.enter_context(tempfile.TemporaryFile())
        command = [sys.executable, "-m", "hapscene.view.offscreen", str(job)]
        process = open_things.enter_context(
            subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=complaint)
        )
        try:
            assert process.stdout is not None
            for _ in drawing.frames:
                content, late = _read(process.stdout, width * height * 3, process)
                if late:
                    raise _Undrawn(f"took longer than {TIMEOUT_S:g} s")
                if len(content) < width * height * 3:
                    raise _Undrawn(_reason(process, complaint))
                yield np.frombuffer(content, np.uint8).reshape(height, width, 3)
        finally:
            process.kill()


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


def _reason(process: "subprocess.Popen[bytes]", complaint: IO[bytes]) -> str:
    """The last line that the process wrote on its way out."""
    code = process.wait()
    complaint.seek(0)
    lines = [line.strip() for line in complaint.read().decode(errors="replace").splitlines() if line.strip()]
    return lines[-1][:120] if lines else f"ended with code {code}"


def _render(job: Path) -> None:
    """What the process does."""
    from hapscene.view.gl import render

    with os.fdopen(os.dup(1), "wb") as out:
        os.dup2(2, 1)  # what a driver prints must not come between the pixels
        for pixels in render(Drawing.load(job)):
            out.write(pixels.tobytes())
            out.flush()


if __name__ == "__main__":
    try:
        _render(Path(sys.argv[1]))
    except (KeyboardInterrupt, BrokenPipeError):
        sys.exit(1)
