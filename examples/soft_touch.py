"""A deforming membrane: its shape is computed 60 times per second from the force of the tool.

A tension T stretches the membrane over a frame: in equilibrium T ∇²w = −f. The tool presses on it with the spring of
the swatch's wall. At rest, the stiffness is that of both springs in series, which the example computes for comparison.
"""

import math

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.linalg import factorized

import hapscene

N, EDGE_M, TENSION_N_M = 41, 0.08, 60.0
FRAME = round(1 / 60 / 1e-3)  # ticks
PRESS_M = 0.004


def membrane() -> tuple[hapscene.Mesh, csr_array, np.ndarray]:
    """Return a square sheet, its finite-element Laplacian, and the indices of the free vertices."""
    x, y = (axis.ravel() for axis in np.meshgrid(*[np.linspace(-EDGE_M / 2, EDGE_M / 2, N)] * 2, indexing="ij"))
    corner = np.arange(N * N).reshape(N, N)
    a, b, c, d = corner[:-1, :-1].ravel(), corner[1:, :-1].ravel(), corner[1:, 1:].ravel(), corner[:-1, 1:].ravel()
    faces = np.concatenate([np.column_stack((a, b, c)), np.column_stack((a, c, d))])
    i, j = np.concatenate([a, b, c, d]), np.concatenate([b, c, d, a])  # right triangles: weight 1 along the grid
    link = coo_array((np.ones(2 * len(i)), (np.r_[i, j], np.r_[j, i])), shape=(N * N, N * N)).tocsr()
    link = (link > 0).astype(np.float64)
    laplacian = csr_array(np.diag(link.sum(axis=1))) - link
    inside = (np.abs(x) < EDGE_M / 2 - 1e-9) & (np.abs(y) < EDGE_M / 2 - 1e-9)
    return hapscene.Mesh(np.column_stack((x, y, np.zeros(N * N))), faces), laplacian, np.flatnonzero(inside)


def main() -> None:
    mesh, laplacian, free = membrane()
    solve = factorized((TENSION_N_M * laplacian)[free][:, free].tocsc())
    scene = hapscene.Scene()
    scene.add(mesh, name="skin", swatch="leather")
    wall_N_m = scene.swatches[1].stiffness_N_m
    renderer = hapscene.Renderer(scene, ["wall"])

    vertices, under = np.array(mesh.vertices_m), np.zeros(N * N)
    forces: list[float] = []
    contact = None
    for tick in range(1500):
        if tick % FRAME == 0:
            under[:] = 0.0
            if contact is not None:  # distribute the force over the corners of the face
                corners = mesh.faces[contact.face]
                plane = np.vstack((mesh.vertices_m[corners, :2].T, np.ones(3)))
                under[corners] = np.linalg.solve(plane, (*contact.p_W_m[:2], 1.0))
            goal_m = solve(under[free]) * (0.0 if contact is None else contact.f_body_W_N[2])
            vertices[free, 2] += 0.25 * (goal_m - vertices[free, 2])  # gradually, or a soft membrane chatters
            renderer.deform("skin", vertices)
        height_m = 0.002 - (PRESS_M + 0.002) * min(tick / 500, 1.0)
        command = renderer.step((0.001, 0.0005, height_m))
        contact = command.contact
        forces.append(float(command.f_W_N[2]))

    skin_N_m = 1.0 / (under[free] @ solve(under[free]))
    row_N = PRESS_M / (1.0 / wall_N_m + 1.0 / skin_N_m)
    print(f"wall of {wall_N_m:.0f} N/m on a membrane of {skin_N_m:.0f} N/m, pressed by {1e3 * PRESS_M:g} mm")
    print(f"force {forces[-1]:.3f} N; both in series: {row_N:.3f} N, the wall alone: {PRESS_M * wall_N_m:.3f} N")
    print(f"largest step of force between two ticks: {np.abs(np.diff(forces)).max():.3f} N")
    assert math.isclose(forces[-1], row_N, rel_tol=0.02)


if __name__ == "__main__":
    main()
