"""A soft organ, pressed by a round tip and simulated 60 times per second by a mass–spring model of your own.

The surface is a network of springs, anchored by further springs to its shape at rest. An implicit Euler step of 1/60 s
gives the next shape. The force of a round tip is distributed over its contact patch, so that displacement and stability
do not depend on the mesh. A point tool loads the corners of one face, which sink in until the body oscillates.
"""

import warnings
from typing import NamedTuple

import numpy as np
import trimesh
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import factorized

import hapscene

FRAME_S = 1 / 60
TICKS = 17  # in a frame
SPRING_N_M = 90.0  # of each edge, which makes a surface tension that does not depend on the mesh
ANCHOR_N_M3 = 3e5  # of each vertex, per area
MASS_KG_M2 = 1.0
TIP_RADIUS_M = 0.008
PRESS_M = 0.008


class Result(NamedTuple):
    """Mean force in the last half second, and mean and largest change per frame of the deepest displacement."""

    force_N: float
    peak_m: float
    ripple_m: float


def organ(level: int) -> hapscene.Mesh:
    """Return the surface of a body of the size of a liver, with 20 · 4^level faces, thin on its left side."""
    ball = trimesh.creation.icosphere(level)
    x, y, z = ball.vertices.T
    ball.vertices = np.column_stack((0.1 * x, (0.07 + 0.02 * x) * y, (0.035 + 0.015 * x) * z))
    return hapscene.Mesh.from_trimesh(ball, "m")


class MassSpring:
    """Displacements (N, 3) of the vertices of a mesh under forces (N, 3)."""

    def __init__(self, mesh: hapscene.Mesh) -> None:
        body = trimesh.Trimesh(mesh.vertices_m, mesh.faces, process=False)
        n, (i, j) = len(body.vertices), body.edges_unique.T
        links = coo_array((np.full(len(i), SPRING_N_M), (i, j)), shape=(n, n))
        links = links + links.T
        area_m2 = np.bincount(body.faces.ravel(), np.repeat(body.area_faces / 3.0, 3), n)
        inertia = MASS_KG_M2 * area_m2 / FRAME_S**2
        self._inertia = inertia[:, None]
        stiffness = diags_array(inertia + ANCHOR_N_M3 * area_m2 + links.sum(axis=1)) - links
        self._solve = factorized(stiffness.tocsc())
        self.shift_m = self._last_m = np.zeros((n, 3))

    def advance(self, force_N: np.ndarray) -> None:
        """Run one implicit Euler step of 1/60 s."""
        right = self._inertia * (2.0 * self.shift_m - self._last_m) + force_N
        self._last_m, self.shift_m = self.shift_m, np.column_stack([self._solve(part) for part in right.T])


def press(level: int, tip_radius_m: float) -> Result:
    """Press on the organ for half a second and hold for a second."""
    mesh = organ(level)
    scene = hapscene.Scene()
    scene.add(mesh, name="liver", swatch="leather")
    renderer = hapscene.Renderer(scene, ["wall"], tip_radius_m=tip_radius_m)
    simulation = MassSpring(mesh)
    top_m = mesh.vertices_m[:, 2].max() + tip_radius_m
    contact, load_N = None, np.zeros(mesh.vertices_m.shape)
    forces_N, peaks_m = list[float](), list[float]()
    for frame in range(90):
        shape_m = mesh.vertices_m + simulation.shift_m
        simulation.advance(load_N if contact is None else contact.vertex_forces_N(shape_m, mesh.faces))
        renderer.deform("liver", mesh.vertices_m + simulation.shift_m)
        for tick in range(frame * TICKS, (frame + 1) * TICKS):
            command = renderer.step((0.033, 0.004, top_m + 0.002 - (PRESS_M + 0.002) * min(tick / 500, 1.0)))
            contact = command.contact
            forces_N.append(float(command.f_W_N[2]))
        peaks_m.append(float(np.linalg.norm(simulation.shift_m, axis=1).max()))
    late_m = np.array(peaks_m[60:])
    return Result(float(np.mean(forces_N[60 * TICKS :])), float(late_m.mean()), float(np.abs(np.diff(late_m)).max()))


def main() -> None:
    coarse, fine = press(4, TIP_RADIUS_M), press(5, TIP_RADIUS_M)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the body oscillates
        point = press(4, 0.0)
    rows = {"round tip, 5,120 faces": coarse, "round tip, 20,480 faces": fine, "point, 5,120 faces": point}
    for name, result in rows.items():
        deep_mm, ripple_mm = 1e3 * result.peak_m, 1e3 * result.ripple_m
        print(f"{name}: {result.force_N:.3f} N, {deep_mm:.3f} mm deep, at most {ripple_mm:.3f} mm from frame to frame")
    assert abs(fine.force_N / coarse.force_N - 1.0) < 0.03 and abs(fine.peak_m / coarse.peak_m - 1.0) < 0.02
    assert max(coarse.ripple_m, fine.ripple_m) < 1e-6 < 1e-3 < point.ripple_m


if __name__ == "__main__":
    main()
