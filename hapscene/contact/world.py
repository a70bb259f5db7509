"""The scene as the compiled contact reads it: bodies and meshes in flat arrays, and the proxy's own memory."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.contact.embree import Search, new_ray

if TYPE_CHECKING:
    from hapscene.scene.body import Body

ASIDE: Final = 4
"""First slot of the planes that were dropped in this tick."""

SLOTS: Final = ASIDE + 6
"""Slots for planes in all. About a vertex of a scan lie 6 faces."""

BODY: Final = np.dtype(
    [
        ("search", "i8"),  # address of the search structure
        ("center_B_m", "f8", (3,)),  # origin of the search structure's frame
        ("radius_m", "f8"),  # of the ball around it that holds the mesh
        ("skin_m", "f8"),  # distance the proxy keeps while it is searched for
        ("vertex", "i8"),  # the mesh's first row in World.vertices_m
        ("face", "i8"),  # the mesh's first row in World.faces
        ("two_sided", "i8"),  # 1: both sides of a face hold, 0: only its outside
        ("moved", "i8"),  # 1 where the pose is not that of the last tick
        ("R_WB", "f8", (3, 3)),
        ("p_WB_m", "f8", (3,)),
        ("was_R_WB", "f8", (3, 3)),  # pose in the last tick
        ("was_p_WB_m", "f8", (3,)),
    ],
    align=True,
)

PROXY: Final = np.dtype(
    [
        ("p_W_m", "f8", (3,)),  # the proxy, a skin off every face that holds it
        ("count", "i8"),  # planes that hold it, 0 to 3; a fourth while one is added
        # slots 0 to 2: the planes that hold the proxy; 3: one just met; from ASIDE on: those dropped in this tick
        ("nhat_W", "f8", (SLOTS, 3)),  # plane i: nhat · x = offset, nhat on the proxy's side
        ("offset_m", "f8", (SLOTS,)),
        ("skin_m", "f8", (SLOTS,)),
        ("body", "i8", (SLOTS,)),
        ("face", "i8", (SLOTS,)),
        ("side", "f8", (SLOTS,)),  # +1 where nhat is the face's own normal, −1 where it is turned (two-sided)
        (
            "met",
            "i8",
            (SLOTS,),
        ),  # 1 where the face was met by a ray from where the proxy is, 2 where it was taken back
        ("aside", "i8"),  # how many planes were dropped in this tick
        ("gram", "f8", (4, 4)),  # scratch of `nearest`: products of the normals
        ("short_m", "f8", (4,)),  # scratch of `nearest`: how far the tool is behind each plane
        ("push_m", "f8", (4,)),  # result of `nearest`: how hard each plane pushes
        ("near_count", "i8"),  # bodies close enough to be met in this tick
        (
            "p_WP_m",
            "f8",
            (3,),
        ),  # result: the proxy on the surface itself; at the tool where it touches nothing
        ("held", "i8"),  # result: 1 while the tool is inside a surface
        ("by", "i8"),  # result: which plane pushes most
    ],
    align=True,
)


class World(NamedTuple):
    """Everything the contact reads and writes. `near` lists the bodies that a tick has to look at."""

    bodies: Any  # (b,) BODY
    vertices_m: NDArray[np.float64]  # (v, 3), each mesh in its body's frame
    faces: NDArray[np.int32]  # (f, 3), counted within each mesh
    ball_W_m: NDArray[np.float64]  # (b, 4) centre and radius of each body's ball
    near: NDArray[np.int64]  # (b,)
    ray: NDArray[np.float32]
    proxy: Any  # (1,) PROXY


def build_world(bodies: "Sequence[Body]", searches: dict[int, Search]) -> World:
    """Pack the bodies of a scene. `searches` keeps one `Search` per mesh, by identity, and is filled here."""
    rows = records(len(bodies), BODY)
    vertices: list[NDArray[np.float64]] = []
    faces: list[NDArray[np.int32]] = []
    first: dict[int, tuple[int, int]] = {}
    vertex_count = face_count = 0
    for row, body in zip(rows, bodies, strict=True):
        mesh = body.mesh
        key = id(mesh)
        if key not in first:
            first[key] = vertex_count, face_count
            searches.setdefault(key, Search(mesh.vertices_m, mesh.faces))
            vertices.append(np.ascontiguousarray(mesh.vertices_m, np.float64))
            faces.append(np.ascontiguousarray(mesh.faces, np.int32))
            vertex_count += len(mesh.vertices_m)
            face_count += len(mesh.faces)
        search = searches[key]
        row.search, row.radius_m, row.skin_m = search.handle, search.radius_m, search.skin_m
        row.center_B_m = search.center_m
        row.vertex, row.face = first[key]
        row.two_sided = body.two_sided
        row.R_WB, row.p_WB_m = body.X_WB[:3, :3], body.X_WB[:3, 3]
        row.was_R_WB, row.was_p_WB_m = row.R_WB, row.p_WB_m
    ball = np.zeros((len(rows), 4))
    for i, row in enumerate(rows):
        ball[i, :3] = row.R_WB @ row.center_B_m + row.p_WB_m
        ball[i, 3] = row.radius_m + row.skin_m
    return World(
        bodies=rows,
        vertices_m=np.concatenate(vertices) if vertices else np.zeros((0, 3)),
        faces=np.concatenate(faces) if faces else np.zeros((0, 3), np.int32),
        ball_W_m=ball,
        near=np.zeros(len(rows), np.int64),
        ray=new_ray(),
        proxy=records(1, PROXY),
    )


def records(count: int, dtype: np.dtype[Any]) -> Any:
    """Zeroed records whose fields are attributes, in compiled code and out of it."""
    return np.zeros(count, dtype).view(np.recarray)
