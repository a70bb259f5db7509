"""The window on a virtual display."""

import ctypes
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import trimesh

from hapscene.render.recording import Recording
from hapscene.scene.scene import Scene
from hapscene.view.palette import FORCE, LIGHT, rgb
from tests.screen import virtual_screen
from tests.view.test_window import scene

__all__ = ["scene"]  # fixtures


PATIENCE_S = 120.0


@pytest.fixture(scope="module")
def display() -> Iterator[str]:
    """A display of a new Xvfb."""
    if shutil.which("Xvfb") is None:
        pytest.skip("Xvfb (package xvfb) is not installed")
    with virtual_screen(1100, 800) as name:
        if not name:
            pytest.skip("Xvfb does not start here")
        yield name


def screenshot(display: str) -> np.ndarray:
    from PIL import ImageGrab

    return np.asarray(ImageGrab.grab(xdisplay=display).convert("RGB")).astype(int)


def close_window(display: str) -> None:
    """Ask the window to close, as a window manager does."""
    from pyglet.libs.x11 import xlib

    server = xlib.XOpenDisplay(display.encode())
    root, parent = xlib.Window(), xlib.Window()
    children, count = ctypes.POINTER(xlib.Window)(), ctypes.c_uint()
    top = xlib.XDefaultRootWindow(server)
    xlib.XQueryTree(server, top, ctypes.byref(root), ctypes.byref(parent), ctypes.byref(children), ctypes.byref(count))
    for k in range(count.value):
        event = xlib.XEvent()
        event.xclient.type, event.xclient.window, event.xclient.format = 33, children[k], 32  # ClientMessage
        event.xclient.message_type = xlib.XInternAtom(server, b"WM_PROTOCOLS", 0)
        event.xclient.data.l[0] = xlib.XInternAtom(server, b"WM_DELETE_WINDOW", 0)
        xlib.XSendEvent(server, children[k], 0, 0, ctypes.byref(event))
    xlib.XSync(server, 0)
    xlib.XCloseDisplay(server)


PLAY = """
import sys
from hapscene.render.recording import Recording
from hapscene.touch import open_scene
from hapscene.view.window import play_in_window
play_in_window(open_scene(sys.argv[1]), Recording.load(sys.argv[2]), "plate")
print("ended")
"""


@pytest.mark.parametrize("end", ["close", "interrupt", "kill"])
def test_window_shows_the_touch_and_closes(
    tmp_path: Path, scene: Scene, recording: Recording, display: str, end: str
) -> None:
    from dataclasses import replace

    trimesh.creation.box((0.1, 0.06, 0.02)).export(tmp_path / "plate.ply")
    wood = Scene()
    wood.add(tmp_path / "plate.ply", unit="m", swatch="wood")
    wood.save(tmp_path / "plate.scene.json")
    held = replace(recording, f_W_N=np.tile([0.0, 0.0, 1.0], (len(recording), 1)))  # the arrow is always there
    held.save(tmp_path / "touch.npz")
    (tmp_path / "temporary").mkdir()
    command = [sys.executable, "-c", PLAY, str(tmp_path / "plate.scene.json"), str(tmp_path / "touch.npz")]
    environment = os.environ | {"DISPLAY": display, "PYTHONUNBUFFERED": "1", "TMPDIR": str(tmp_path / "temporary")}
    with subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        try:
            wait_for(lambda: shows_the_touch(display), process)
            if end == "close":
                close_window(display)
            elif end == "interrupt":
                os.killpg(process.pid, signal.SIGINT)  # to the process group, as a terminal does
            else:
                process.kill()
            out, err = process.communicate(timeout=PATIENCE_S)  # ends when all processes have closed the pipes
            assert "Traceback" not in err, err
            assert end == "kill" or (process.returncode == 0 and "ended" in out)
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
    assert list((tmp_path / "temporary").iterdir()) == []


def wait_for(seen: Callable[[], bool], process: "subprocess.Popen[str]") -> None:
    until_s = time.monotonic() + PATIENCE_S
    while process.poll() is None and time.monotonic() < until_s:
        if seen():
            return
        time.sleep(0.05)  # leaves the processor to the other process
    pytest.fail(process.stderr.read() if process.poll() is not None and process.stderr else "nothing was shown")


def shows_the_touch(display: str) -> bool:
    pixels = screenshot(display)
    green = np.abs(pixels - rgb(FORCE) * 255).max(axis=2) < 60  # the force arrow
    orange = (pixels[..., 0] > 180) & (pixels[..., 2] < 60)
    grey = (pixels == np.round(rgb(LIGHT.background) * 255)).all(axis=2)
    return bool(green.sum() > 30 and orange.sum() > 5000 and grey.mean() > 0.3)
