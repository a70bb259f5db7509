"""A mesh prepared to be painted: what a ray hits, which faces a brush or a bucket reaches. Built once at load."""

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.constants import SKIN_RATIO
from hapscene.contact.embree import Search, first_face, new_ray
from hapscene.paint.brush import reach
from hapscene.scene.mesh import Mesh
from hapscene.scene.topology import connected, edges_of, weld

Vector = NDArray[np.float64]

FACING_RAD: Final = math.radians(80.0)
"""Most that a face may be turned from where a brush touches, to be painted by it [rad]. Under 90°, so that a brush near
an edge stays on its side of it, and never reaches the back of a wall; far enough that a scan's roughness leaves no
holes."""

BEND_ROUNDING_RAD: Final = 1e-9
"""What a facet's angle is widened by [rad], as `hapscene.scene.region.Facet` does."""


class Shape:
    """A mesh with what picking, brush and bucket need.

    Attributes:
        mesh: in the body's frame B.
        corner_m: (M, 3, 3) float64, corners of every face [m].
        centroid_m: (M, 3) of every face [m].
        normal: (M, 3) unit normals; zero where a face has no area.
        welded: (N,) int64, the first vertex at the place of each one: `hapscene.scene.topology.weld`.
        pairs: (n, 2) int64, faces on both sides of every edge that has just two.
    """

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self.corner_m = np.ascontiguousarray(mesh.triangles_m)
        self.centroid_m = np.asarray(self.corner_m.mean(axis=1))
        self.normal = np.ascontiguousarray(mesh.normals)
        self._search = Search(mesh.vertices_m, mesh.faces, SKIN_RATIO * mesh.diagonal_m)
        self._ray = new_ray()
        self.welded = weld(mesh.vertices_m)
        self._vertex = self.welded[mesh.faces].astype(np.int32)  # faces meet where their corners are at one place
        self._around = np.argsort(self._vertex.ravel(), kind="stable").astype(np.int32)
        count = np.bincount(self._vertex.ravel(), minlength=len(mesh.vertices_m))
        self._start = np.concatenate([[0], np.cumsum(count)]).astype(np.int32)
        self._seen_face = np.zeros(len(mesh.faces), np.int32)
        self._seen_vertex = np.zeros(len(mesh.vertices_m), np.int32)
        self._queue = np.zeros(len(mesh.faces), np.int32)
        self._painted = np.zeros(len(mesh.faces), np.int32)
        self._round = 0
        self.pairs, self._bend_rad = self._edges()
        here = self.centroid_m[0]
        self.brush((0, 0), (here, here), mesh.diagonal_m * 1e-9)  # compiles the walk now, not in the first stroke

    def pick(self, origin_B_m: Vector, direction_B: Vector) -> tuple[int, float, Vector] | None:
        """The first face along a ray from a point (3,) [m], its distance [m] and the point (3,) on it; None without.

        Faces are met from both sides. Embree (float32) names the face; the point is computed in float64 on its plane.
        """
        direction = direction_B / np.linalg.norm(direction_B)
        origin = origin_B_m - self._search.center_m
        # near the mesh the ray has more digits: it starts where it enters the ball around it
        ahead = max(0.0, float(np.linalg.norm(origin)) - 1.01 * self._search.radius_m)
        start = origin + ahead * direction
        far = float(np.linalg.norm(start)) + 2.0 * self._search.radius_m
        args: tuple[Any, ...] = (tuple(start.tolist()), tuple(direction.tolist()), far, 0)
        face = int(first_face(self._search.handle, self._ray, *args))
        if face < 0:
            return None
        distance = ahead + float(self._ray[8])
        across = float(self.normal[face] @ direction)
        if abs(across) > 1e-6:
            exact = float(self.normal[face] @ (self.corner_m[face, 0] - origin_B_m)) / across
            if abs(exact - distance) <= 1e-4 * (distance + self._search.radius_m):
                distance = exact
        return face, distance, np.asarray(origin_B_m + distance * direction)

    def brush(
        self, faces: tuple[int, int], ends_B_m: tuple[Vector, Vector], radius_m: float, facing_rad: float = FACING_RAD
    ) -> NDArray[np.int64]:
        """Faces (n,) under a brush that moves from one place on the surface to another, each given by face and point.

        Painted are the faces whose centroid is in the capsule of that radius about the way, those that the way
        itself goes over, and the two faces at its ends; only where the surface leads there from either end inside the
        capsule, and is turned no more than `facing_rad` from it. So a brush does not reach through a thin wall.
        """
        self._round += 1
        count = reach(
            (self.corner_m, self.centroid_m, self.normal),
            (self._vertex, self._around, self._start),
            (self._seen_face, self._seen_vertex, self._queue, self._painted),
            self._round,
            (int(faces[0]), int(faces[1])),
            (tuple(ends_B_m[0].tolist()), tuple(ends_B_m[1].tolist())),
            float(radius_m),
            math.cos(facing_rad),
        )
        return np.sort(self._painted[:count]).astype(np.int64)

    def longest_edge_m(self, face: int) -> float:
        """Of a face [m]."""
        corners = self.corner_m[face]
        return float(np.linalg.norm(corners - corners[[1, 2, 0]], axis=1).max())

    def facet(self, face: int, angle_rad: float) -> NDArray[np.bool_]:
        """Faces (M,) connected with one over edges that bend by at most an angle, as `region.Facet` picks them."""
        label = connected(self.pairs[self._bend_rad <= angle_rad + BEND_ROUNDING_RAD], len(self.mesh.faces))
        return np.asarray(label == label[face])

    def _edges(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Faces on both sides (n, 2) of each edge with just two, and by how much it bends (n,) [rad]."""
        pairs, alike = edges_of(self.mesh.faces, self.welded).pairs()
        other = np.where(alike, 1.0, -1.0)[:, None] * self.normal[pairs[:, 1]]
        chord = np.linalg.norm(self.normal[pairs[:, 0]] - other, axis=1)
        return pairs, 2 * np.arcsin(np.minimum(chord / 2, 1.0))
