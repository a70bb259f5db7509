"""The scene as compiled contact code reads it: bodies and meshes in flat arrays, and the state of the proxy."""

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, NamedTuple
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.block import by_pointer
from hapscene.compiled.native import native
from hapscene.constants import EDGE_OVERLAP, NEAR_MAX, PASSED_MAX, SKIN_RATIO, SKIN_RATIO_MIN
from hapscene.contact.embree import Search, fronts_only, new_ray
from hapscene.contact.face_tree import build_tree
from hapscene.contact.shading import corner_normals
from hapscene.errors import SceneError
from hapscene.records import Owning, Record, Records, pack_small_arrays, records

if TYPE_CHECKING:
    from hapscene.scene.body import Body
    from hapscene.scene.mesh import Mesh

__all__ = [
    "BODY",
    "DROPPED",
    "FACES_MAX",
    "FRONT_MAX",
    "HALF_TURN_COS2_MIN",
    "NO_SHADE",
    "PROXY",
    "SAVED",
    "SHAPES",
    "WAYS",
    "Extension",
    "Shapes",
    "World",
    "build_world",
    "pack_faces",
    "shapes_of",
    "skin_of",
    "update_ball",
]

DROPPED: Final = 4
"""First slot of the planes that were dropped in this tick."""

SAVED: Final = DROPPED + 6
"""First slot of the planes before an edge was crossed. Six faces meet at a typical vertex of a scan."""

SLOTS: Final = SAVED + 3
"""Number of slots for planes."""

FACES_MAX: Final = 16
"""Most edges that are crossed by adjacency in one tick [count]."""

SHAPES: Final = 3
"""Shapes of a deforming body [count]: one in use, one posted, one being written."""

WAYS: Final = 14
"""Rays from the proxy that look for faces of a deforming body [count]: along the axes and the diagonals of the
octants. Every direction is within 28° of a ray."""

FAR_M: Final = 5.0
"""Distance from the nearest body beyond which the position of a tool may be in another unit [m]: several times the
workspace of a haptic device. A scene of large bodies has a longer one. A tool that moves away slowly is reported within
twice this distance."""

FAR_RATIO: Final = 20.0
"""The same distance as a multiple of the diameter of the largest body [1]. A position in mm is about 500 times too
far."""

BODY: Final = np.dtype(
    [
        ("search", "i8"),  # address of the search structure
        ("center_B_m", "f8", (3,)),  # origin of the search structure's frame
        ("radius_m", "f8"),  # radius of the ball around that origin that contains the mesh
        ("skin_m", "f8"),  # distance that the proxy keeps from faces during the search
        ("face", "i8"),  # first row in World.corners_m of the shape in use
        ("two_sided", "i8"),  # 1: both sides of a face are solid, 0: only the outside
        ("moved", "i8"),  # 1 if the pose differs from that of the last tick
        ("punctured", "i8"),  # 0, or while punctured: 1 entered from the outside of a face, −1 from its back
        ("entry_face", "i8"),  # face at which the tool entered, and the barycentric coordinates of the place
        ("entry_at", "f8", (3,)),
        ("shift_s", "f8"),  # remaining time of the shift below, see `hapscene.contact.deformation`
        ("shift_W_m", "f8", (3,)),  # transition between shapes: shift of the body from its pose
        ("R_WB", "f8", (3, 3)),
        ("p_WB_m", "f8", (3,)),
        ("last_R_WB", "f8", (3, 3)),  # pose in the last tick
        ("last_p_WB_m", "f8", (3,)),
        # tree of the faces, for a tool with a tip radius
        ("tree", "i8"),  # first row in World.tree
        ("leaf_count", "i8"),
        ("tree_face", "i8"),  # first row in World.tree_face
        ("tree_count", "i8"),  # faces in the tree
        # fields of a deforming body
        ("next", "i8"),  # 1 + index of the next deforming body, 0 for the last
        ("shape_used", "i8"),  # shape in use, from 1; 0 for the shape of the mesh
        ("shape_posted", "i8"),  # shape to take in the next tick
        ("shape_taking", "i8"),  # shape that a tick is about to take
        ("shape_search", "i8", (SHAPES,)),
        ("shape_center_B_m", "f8", (SHAPES, 3)),
        ("shape_radius_m", "f8", (SHAPES,)),
        ("shape_face", "i8", (SHAPES,)),
        ("shape_tree", "i8", (SHAPES,)),
        ("face_count", "i8"),
        ("enclosing", "i8"),  # 1 if the last shape enclosed the proxy, for example a hollow two-sided body
        ("shape_ticks", "i8"),  # ticks since the last shape was taken
    ],
    align=True,
)

OF_MESH: Final = ("search", "center_B_m", "radius_m", "skin_m", "face", "tree", "leaf_count", "tree_face", "tree_count")
"""Fields of a body that are equal for all resting bodies with the same mesh."""

PROXY: Final = np.dtype(
    [
        ("p_W_m", "f8", (3,)),  # proxy position of the search, one skin above every face in contact
        ("count", "i8"),  # active planes, 0 to 3; 4 while one is added
        ("near_at_W_m", "f8", (3,)),  # device position at which the nearby bodies were listed
        # distance from there to the nearest body that is not listed, less the motion of bodies since
        ("near_margin_m", "f8"),
        ("near_count", "i8"),  # bodies that can be met in this tick, up to the limit
        ("near_flags", "i8"),  # `CROWDED` if there were more than the limit; `TOOL_FAR`
        ("far_m", "f8"),  # distance from all bodies beyond which the device position is reported
        ("placed", "i8"),  # 1 if the proxy was placed since the last tick
        ("moving_flags", "i8"),  # flags of this tick about moving and deforming bodies
        ("enclosing", "i8"),  # 1 + index of a one-sided body inside which the proxy was placed, 0 for none
        ("reshaped", "i8"),  # 1 + index of the first deforming body, 0 for none
        ("puncture_count", "i8"),  # length of `punctured`
        ("dropped_count", "i8"),  # planes that were dropped in this tick
        ("touching", "i8"),  # result: 1 while the device is inside a surface
        ("dominant", "i8"),  # result: index of the plane that pushes most
        ("p_WP_m", "f8", (3,)),  # result: proxy on the surface itself; the device position without contact
        ("radius_m", "f8"),  # radius of the tip; the proxy is its centre. 0 for a point
        ("crease_cos", "f8"),  # planes count as one smooth surface down to this cosine; `NO_SHADE` without shading
        ("push_m", "f8", (4,)),  # result of `nearest`: multiplier of each plane
        ("short_m", "f8", (4,)),  # scratch of `nearest`: how far the device is behind each plane
        # slots 0 to 2: active planes; 3: one just met; from DROPPED on: dropped in this tick; from SAVED on: active
        # planes before an edge was crossed
        ("nhat_W", "f8", (SLOTS, 3)),  # plane i: nhat · x = offset; nhat points to the side of the proxy
        ("offset_m", "f8", (SLOTS,)),
        ("skin_m", "f8", (SLOTS,)),
        ("body", "i8", (SLOTS,)),
        ("face", "i8", (SLOTS,)),
        ("side", "f8", (SLOTS,)),  # +1 if nhat is the normal of the face, −1 if reversed (two-sided)
        ("met", "i8", (SLOTS,)),  # 1: a ray from the present proxy position met the face, 2: the plane was restored
        ("crossed", "i8", (FACES_MAX, 3)),  # crossed edges: body, 3 face + edge, side
        ("gram", "f8", (4, 4)),  # scratch of `nearest`: Gram matrix of the normals
        ("punctured", "i8", (PASSED_MAX,)),  # punctured bodies, the newest last
        ("ray_face", "i8", (WAYS,)),  # faces around the proxy when a body changes shape, −1 for none
        ("ray_side", "f8", (WAYS,)),  # 1 if the proxy is in front of the face, −1 behind
    ],
    align=True,
)

FRONT_MAX: Final = 1024
"""Most nodes and faces that bound the motion of a tip with a radius [count]; a stroke needs about 100."""

BALL: Final = np.dtype(
    [
        # nodes and faces that together contain all faces nearby, with their planes; see `contact.ball`
        ("count", "i8"),
        ("plane", "f8", (4, FRONT_MAX)),  # nhat and offset
        ("height_m", "f8", (FRONT_MAX,)),  # scratch: height of a position above each plane
        ("violated", "i8", (FRONT_MAX,)),  # scratch: entries whose plane a position violates
        ("body", "i8", (FRONT_MAX,)),
        ("node", "i8", (FRONT_MAX,)),  # node of the tree, or −1 − face
        ("stamp", "i8", (FRONT_MAX,)),  # number of the position of the tip for which the plane was computed
        ("now", "i8"),  # number of the present position of the tip
    ],
    align=True,
)

NO_SHADE: Final = 2.0
"""Value of `PROXY.crease_cos` without shading [1]: above every cosine."""

HALF_TURN_COS2_MIN: Final = 0.01
"""Squared cosine of half the rotation in a tick below which a body is always listed as nearby [1]."""


@by_pointer
class World(NamedTuple):
    """All arrays that the contact reads and writes."""

    bodies: Records  # (b,) BODY
    # (f, 4, 3), mesh after mesh: corners in the body frame, and the face of the mesh across each edge (`Neighbours`).
    # So a face is two cache lines. With shading (f, 7, 3): normals at the corners follow
    corners_m: NDArray[np.float64]
    ball_W_m: NDArray[np.float64]  # (b, 4) centre and radius of the ball in which a body can be met in this tick
    near: NDArray[np.int64]  # (n,) bodies to cast against: at most NEAR_MAX and those in contact
    moved: NDArray[np.int64]  # (b + 1,) number of bodies that moved in this tick, and their indices
    # (b, 6) of the tool on each body since the reset, linear [N·s] and about its origin [N·m·s]
    impulse: NDArray[np.float64]
    ray: NDArray[np.float32]
    fronts_only: NDArray[np.uint64]  # arguments of a ray that passes through faces from behind
    proxy: Records  # (1,) PROXY
    # for a tool with a tip radius, otherwise empty
    ball: Records  # (1,) BALL
    tree: NDArray[np.float32]  # (n, 8) nodes of the trees of all meshes, see `hapscene.contact.face_tree`
    tree_face: NDArray[np.int32]  # (f,) faces in the order of the leaves


HOT: Final = ("proxy", "bodies", "ray", "moved", "impulse", "ball_W_m", "fronts_only", "near")
"""Arrays that every tick touches; `build_world` places them side by side in memory."""


@native
def update_ball(body: np.record, ball: NDArray[np.float64]) -> float:
    """Move the bounding ball (4,) of a body to its present pose; return how much closer that can bring the body [m].

    The ball of a moving body also covers the sweep in the frame of the body (`_carry`): its radius grows by the motion
    of its centre, and is divided by the cosine of half the rotation, because a chord cuts an arc.
    """
    if body.radius_m < 0.0:  # the body was removed and is never near
        ball[3] = body.radius_m
        return 0.0
    c, R, was = body.center_B_m, body.R_WB, body.last_R_WB
    way2, trace = 0.0, 0.0
    for i in range(3):
        now = R[i, 0] * c[0] + R[i, 1] * c[1] + R[i, 2] * c[2] + body.p_WB_m[i]
        way2 += (now - ball[i]) ** 2
        ball[i] = now
        trace += R[i, 0] * was[i, 0] + R[i, 1] * was[i, 1] + R[i, 2] * was[i, 2]
    way = math.sqrt(way2)
    radius = body.radius_m + body.skin_m
    if body.moved == 1:
        half2 = (1.0 + trace) / 4.0
        radius = (radius + way) / math.sqrt(half2) if half2 > HALF_TURN_COS2_MIN else math.inf
    grown = radius - ball[3]
    ball[3] = radius
    return float(way + grown)


class Shapes:
    """The packed meshes of a scene: search structures and corners. Shared by all worlds of the same bodies.

    Attributes:
        searches: search structure of each mesh, by the identity of the mesh.
        first: first row of each mesh in `corners_m`, by the identity of the mesh.
        corners_m: see `World`.
        skin_m: skin of all meshes.
    """

    def __init__(self, meshes: "Sequence[Mesh]", crease_rad: float, skin_m: float | None = None) -> None:
        self.meshes = list(meshes)  # keeps the meshes alive, so that their identities stay unique
        self.skin_m = skin_of(*meshes) if skin_m is None else skin_m
        first = np.cumsum([0, *(len(mesh.faces) for mesh in meshes)])
        self.first = dict(zip(map(id, meshes), first, strict=False))
        width = 7 if crease_rad > 0.0 else 4
        memory = np.empty(3 * width * first[-1] + 4)  # 4 x 3 numbers lie in two cache lines if they start at 32 bytes
        memory = memory[-memory.ctypes.data // 8 % 4 :][: 3 * width * first[-1]]
        self.corners_m = memory.reshape(-1, width, 3)
        with ThreadPoolExecutor(1) as beside:  # Embree and compiled code release the GIL
            built = [beside.submit(Search, mesh.vertices_m, mesh.faces, self.skin_m) for mesh in meshes]
            for mesh, start in zip(meshes, first, strict=False):
                rows = self.corners_m[start : start + len(mesh.faces)]
                pack_faces(mesh.vertices_m, mesh.faces, mesh.neighbours.beyond, rows)
                if crease_rad > 0.0:
                    rows[:, 4:] = corner_normals(mesh, crease_rad)
            self.searches = {id(mesh): search.result() for mesh, search in zip(meshes, built, strict=True)}

    @cached_property
    def forest(self) -> "Forest":
        """Trees of all meshes, built when first used."""
        return Forest(self)


@native
def pack_faces(
    vertices_m: NDArray[np.float64], faces: NDArray[np.int32], beyond: NDArray[np.int32], rows: NDArray[np.float64]
) -> None:
    """Write the corners of faces (f, 3) and the faces across their edges to `rows`, see `World.corners_m`."""
    for face in range(len(faces)):
        for k in range(3):
            for axis in range(3):
                rows[face, k, axis] = vertices_m[faces[face, k], axis]
            rows[face, 3, k] = beyond[face, k]


class Forest:
    """The trees of the meshes of `Shapes`, for a tool with a tip radius.

    Attributes:
        tree, tree_face: see `World`.
        place: (first row of `tree`, leaves, first row of `tree_face`, faces) of each mesh, by the identity of the mesh.
    """

    def __init__(self, shapes: Shapes | None) -> None:
        """`shapes`: the packed meshes; None for an empty forest."""
        nodes, faces = [np.zeros((0, 8), np.float32)], [np.zeros(0, np.int32)]
        self.place = dict[int, tuple[int, int, int, int]]()
        if shapes is not None:
            for mesh in shapes.meshes:
                first = shapes.first[id(mesh)]
                corners_m = shapes.corners_m[first : first + len(mesh.faces), :3]
                tree, order = build_tree(corners_m, EDGE_OVERLAP * shapes.skin_m)
                self.place[id(mesh)] = sum(map(len, nodes)), len(tree) // 2, sum(map(len, faces)), len(order)
                nodes.append(tree)
                faces.append(order)
        self.tree, self.tree_face = np.concatenate(nodes), np.concatenate(faces)


_shapes: "WeakValueDictionary[tuple[object, ...], Shapes]" = WeakValueDictionary()


def shapes_of(bodies: "Sequence[Body]", crease_rad: float, skin_m: float | None = None) -> Shapes:
    """Return the packed meshes of bodies, cached as long as a world uses them."""
    meshes = list({id(body.mesh): body.mesh for body in bodies}.values())
    key = (crease_rad, skin_m, *map(id, meshes))
    found = _shapes.get(key)
    if found is None:
        found = _shapes[key] = Shapes(meshes, crease_rad, skin_m)
    return found


def build_world(bodies: "Sequence[Body]", crease_rad: float = 0.0, tip_radius_m: float = 0.0) -> World:
    """Pack the bodies of a scene.

    The records of the bodies hold addresses of search structures; the array of records keeps those alive. The search
    structures of deforming bodies are kept alive by their `Deformation`.

    Args:
        bodies: bodies of the scene.
        crease_rad: edges flatter than this angle are shaded (`hapscene.contact.shading`); 0 disables shading.
        tip_radius_m: radius of the tip of the tool; 0 for a point.
    """
    shapes = shapes_of(bodies, crease_rad)
    forest = shapes.forest if tip_radius_m > 0.0 else Forest(None)
    rows, balls = _owning_records(len(bodies), BODY, [shapes]), np.zeros((len(bodies), 4))
    _fill_bodies(rows, balls, bodies, shapes, forest, (0, 0, 0))
    proxy = records(1, PROXY)
    proxy.radius_m = tip_radius_m
    proxy.far_m = max(FAR_M, FAR_RATIO * 2.0 * float(balls[:, 3].max(initial=0.0)))
    proxy.crease_cos = math.cos(crease_rad) if crease_rad > 0.0 else NO_SHADE
    world = World(
        bodies=rows,
        corners_m=shapes.corners_m,
        ball_W_m=balls,
        near=np.zeros(NEAR_MAX + DROPPED, np.int64),
        moved=np.zeros(len(rows) + 1, np.int64),
        impulse=np.zeros((len(rows), 6)),
        ray=new_ray(),
        fronts_only=fronts_only(),
        proxy=proxy,
        ball=records(1 if tip_radius_m > 0.0 else 0, BALL),
        tree=forest.tree,
        tree_face=forest.tree_face,
    )
    near = pack_small_arrays([getattr(world, name) for name in HOT], [shapes])
    return world._replace(**dict(zip(HOT, near, strict=True)))


def _fill_bodies(
    rows: Records,
    balls: NDArray[np.float64],
    bodies: "Sequence[Body]",
    shapes: Shapes | None,
    forest: Forest,
    first: tuple[int, int, int],
    known: Mapping[int, Record] = MappingProxyType({}),
) -> None:
    """Fill the records of bodies and their bounding balls (b, 4).

    Args:
        rows, balls: arrays to fill.
        bodies: bodies of the scene, one for each row.
        shapes, forest: packed meshes of the bodies whose mesh is not in `known`, and their trees.
        first: first rows of these in `World.corners_m`, `World.tree` and `World.tree_face`.
        known: records of bodies that are in the world already, by the identity of their mesh.
    """
    for row, ball, body in zip(rows, balls, bodies, strict=True):
        key = id(body.mesh)
        if key in known:
            for name in OF_MESH:
                row[name] = known[key][name]
        else:
            assert shapes is not None
            search = shapes.searches[key]
            row.search, row.radius_m, row.skin_m = search.handle, search.radius_m, shapes.skin_m
            row.center_B_m = search.center_m
            row.face = first[0] + shapes.first[key]
            if key in forest.place:
                tree, row.leaf_count, face, row.tree_count = forest.place[key]
                row.tree, row.tree_face = first[1] + tree, first[2] + face
        row.two_sided = body.two_sided
        row.R_WB, row.p_WB_m = body.X_WB[:3, :3], body.X_WB[:3, 3]
        row.last_R_WB, row.last_p_WB_m = row.R_WB, row.p_WB_m
        ball[:3] = (row.R_WB * row.center_B_m).sum(axis=1) + row.p_WB_m
        ball[3] = row.radius_m + row.skin_m


FAR_FINER: Final = 100.0
"""Largest ratio of the skin of a world to the skin that an added body alone would have [1]."""


class Extension:
    """Adds bodies to a world: the constructor runs beside the loop, `apply` runs between two ticks.

    Meshes that are in the world in their original shape are shared.

    Args:
        world: present world.
        known: its bodies.
        bodies: bodies to add.
        crease_rad: see `build_world`.

    Raises:
        SceneError: a body is too large or too small for the skin of the world.
    """

    def __init__(self, world: World, known: "Sequence[Body]", bodies: "Sequence[Body]", crease_rad: float) -> None:
        skin_m = float(world.bodies[0].skin_m)
        for body in bodies:
            size_m = _size_of(body.mesh)
            if not SKIN_RATIO_MIN * size_m <= 1.01 * skin_m <= FAR_FINER * SKIN_RATIO * size_m:
                large = SKIN_RATIO_MIN * size_m > skin_m
                raise SceneError(
                    f"body {body.name!r} ({size_m:.3g} m) is too {'large' if large else 'small'} to be added to a "
                    "running scene: its size must be similar to that of the other bodies; add it before the start"
                )
        self._rows: dict[int, Record] = {}
        for row, body in zip(world.bodies, known, strict=True):
            if row.face_count == 0 and row.radius_m > 0.0:
                self._rows.setdefault(id(body.mesh), row)
        new = [body for body in bodies if id(body.mesh) not in self._rows]
        self._shapes = shapes_of(new, crease_rad, skin_m) if new else None
        self._bodies, self._before = bodies, world.corners_m
        self._corners_m = self._extended(world.corners_m)
        self._forest = self._shapes.forest if self._shapes and len(world.ball) > 0 else Forest(None)

    def _extended(self, corners_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return corners followed by those of the new meshes."""
        return np.concatenate((corners_m, self._shapes.corners_m)) if self._shapes else corners_m

    def apply(self, world: World) -> World:
        """Return the world with the new bodies and the present state of the others."""
        before, count = len(world.bodies), len(world.bodies) + len(self._bodies)
        corners_m = self._corners_m
        if world.corners_m is not self._before:  # room for shapes of a deforming body was added meanwhile
            corners_m = self._extended(world.corners_m)
        rows, balls = _owning_records(count, BODY, [*_owned_by(world.bodies), self._shapes]), np.zeros((count, 4))
        rows[:before], balls[:before] = world.bodies, world.ball_W_m
        for row in rows[:before]:
            if row.face_count > 0:  # deforming bodies may have taken new shapes since the constructor
                first, end = int(row.shape_face[0]), int(row.shape_face[-1] + row.face_count)
                corners_m[first:end] = world.corners_m[first:end]
        ends = len(world.corners_m), len(world.tree), len(world.tree_face)
        _fill_bodies(rows[before:], balls[before:], self._bodies, self._shapes, self._forest, ends, self._rows)
        moved, impulse = np.zeros(count + 1, np.int64), world.impulse
        moved[: before + 1] = world.moved
        if len(impulse) < count:
            impulse = np.zeros((count, 6))
            impulse[:before] = world.impulse
        world.proxy[0].near_count, world.proxy[0].near_margin_m = 0, 0.0  # forces a new list of nearby bodies
        return world._replace(
            bodies=rows,
            corners_m=corners_m,
            ball_W_m=balls,
            moved=moved,
            impulse=impulse,
            tree=np.concatenate((world.tree, self._forest.tree)),
            tree_face=np.concatenate((world.tree_face, self._forest.tree_face)),
        )


def skin_of(*meshes: "Mesh") -> float:
    """Return the one skin for all meshes of a scene [m].

    With different skins, a proxy that slides over one body would catch on the edge overlap of another. The skin follows
    the smallest body, unless the largest body is so large that float32 could not resolve that skin.
    """
    sizes_m = {id(mesh): _size_of(mesh) for mesh in meshes}.values()
    return max(SKIN_RATIO * min(sizes_m), SKIN_RATIO_MIN * max(sizes_m))


def _size_of(mesh: "Mesh") -> float:
    """Return the diagonal of the bounding box of all vertices [m]."""
    return float(np.linalg.norm([np.ptp(column) for column in mesh.vertices_m.T]))


def _owning_records(count: int, dtype: np.dtype[np.void], owned: "Sequence[object]") -> Any:
    """Return `records` that keep `owned` alive as long as a view of them exists."""
    memory = Owning(count * dtype.itemsize)
    memory.owned = owned
    return np.frombuffer(memory, dtype).view(np.recarray)


def _owned_by(rows: Any) -> "Sequence[object]":
    """Return what records keep alive, without the records themselves: a table that replaces them needs only this."""
    while isinstance(rows, np.ndarray):
        rows = rows.base
    owned: Sequence[object] = getattr(rows, "obj", rows).owned  # NumPy refers to the memory by a memoryview
    return owned
