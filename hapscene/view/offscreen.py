"""Triangles to pixels, without a screen. The only importer of pyrender, and so exchangeable.

It runs as a process of its own: `python -m hapscene.view.offscreen JOB.npz OUT.npy`, under PYOPENGL_PLATFORM.
The platform of GL is fixed when it is first imported, so a second one can only be tried in a second process;
and a driver that crashes takes only the picture with it.
"""

import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import ViewError

PLATFORMS: Final = {"osmesa": "libosmesa6", "egl": "libegl1 libgl1"}
"""GL without a screen, in the order in which they are tried, and the system packages that each is in. OSMesa
first: on a CPU it is 2 to 5 frames a second faster."""

TIMEOUT_S: Final = 120.0
"""Longest that drawing may take [s]. A million triangles take 6."""


@dataclass(frozen=True)
class Drawing:
    """Triangles, and an orthographic camera that looks along its own −z."""

    position_m: NDArray[np.float32]
    """(3 k, 3) corners of k triangles, near the origin: they are float32."""
    normal: NDArray[np.float32]
    """(3 k, 3) unit normals."""
    colour: NDArray[np.float32]
    """(3 k, 3) linear RGB, 0 … 1."""
    X_WC: NDArray[np.float64]
    """(4, 4) pose of the camera."""
    extent_m: NDArray[np.float64]
    """(3,) half width and half height of what the camera sees, and how far it sees."""
    size: NDArray[np.int64]
    """(2,) width and height in pixels."""


def draw(drawing: Drawing) -> NDArray[np.uint8]:
    """Draw with the first platform that can.

    Returns:
        RGB pixels (height, width, 3), the same for the same drawing and platform.

    Raises:
        ViewError: no platform can draw here; one line says why and which packages would help.
    """
    failures = []
    with tempfile.TemporaryDirectory(prefix="hapscene-") as folder:
        job, out = Path(folder) / "job.npz", Path(folder) / "out.npy"
        with job.open("wb") as file:
            np.savez(file, **{field.name: getattr(drawing, field.name) for field in fields(Drawing)})
        for platform, packages in PLATFORMS.items():
            reason = _draw_with(platform, job, out)
            if not reason:
                pixels: NDArray[np.uint8] = np.load(out, allow_pickle=False)
                return pixels
            failures.append(f"{platform} ({reason}) needs {packages}")
    raise ViewError("no GL can draw here; install one of these system packages: " + "; ".join(failures))


def _draw_with(platform: str, job: Path, out: Path) -> str:
    """Draw in a process of its own; return why that failed, or nothing."""
    command = [sys.executable, "-m", "hapscene.view.offscreen", str(job), str(out)]
    environment = os.environ | {"PYOPENGL_PLATFORM": platform}
    try:
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=TIMEOUT_S)
    except subprocess.TimeoutExpired:
        return f"took longer than {TIMEOUT_S:g} s"
    if done.returncode == 0:
        return ""
    lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    return lines[-1][:120] if lines else f"ended with code {done.returncode}"


def _render(job: Path, out: Path) -> None:
    """What the process does: one drawing to pixels, through pyrender."""
    import pyglet

    pyglet.options["headless"] = True  # before pyrender imports it, or it asks for X11
    import pyrender

    with np.load(job, allow_pickle=False) as archive:
        drawing = Drawing(**{field.name: archive[field.name] for field in fields(Drawing)})
    material = pyrender.MetallicRoughnessMaterial(metallicFactor=0.0, roughnessFactor=0.85, doubleSided=True)
    primitive = pyrender.Primitive(
        positions=drawing.position_m,
        normals=drawing.normal,
        color_0=drawing.colour,
        mode=4,
        material=material,
    )
    scene = pyrender.Scene(bg_color=(0.95, 0.96, 0.975, 1.0), ambient_light=(0.32, 0.32, 0.32))
    scene.add(pyrender.Mesh([primitive]))
    x_m, y_m, far_m = drawing.extent_m
    scene.add(pyrender.OrthographicCamera(x_m, y_m, znear=far_m * 1e-4, zfar=far_m), pose=drawing.X_WC)
    for direction_C, strength in (((-0.5, 0.8, 1.0), 2.6), ((1.0, 0.1, 0.6), 0.9)):
        light = pyrender.DirectionalLight(color=np.ones(3), intensity=strength)
        scene.add(light, pose=drawing.X_WC @ _looking_from(direction_C))
    renderer = pyrender.OffscreenRenderer(*(int(n) for n in drawing.size))
    pixels, _ = renderer.render(scene)
    np.save(out, pixels[..., :3])


def _looking_from(direction: tuple[float, float, float]) -> NDArray[np.float64]:
    """A rotation (4, 4) whose +z points along `direction`: a light there shines to the origin."""
    z = np.array(direction) / np.linalg.norm(direction)
    x = np.cross((0.0, 1.0, 0.0), z)
    x /= np.linalg.norm(x)
    X = np.eye(4)
    X[:3, :3] = np.column_stack((x, np.cross(z, x), z))
    return X


if __name__ == "__main__":
    _render(Path(sys.argv[1]), Path(sys.argv[2]))
