"""The scene as the compiled contact reads it: bodies and meshes in flat arrays, and the proxy's own memory."""

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, NamedTuple
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from hapscene.compiled.block import by_pointer
from hapscene.compiled.native import native
from hapscene.constants import NEAR_MAX, PASSED_MAX, SKIN_RATIO, SKIN_RATIO_MIN
from hapscene.contact.embree import Search, fronts_only, new_ray
from hapscene.contact.shading import corner_normals
from hapscene.errors import SceneError
from hapscene.records import Owning, Records, pack_small_arrays, records

if TYPE_CHECKING:
    from hapscene.scene.body import Body
    from hapscene.scene.mesh import Mesh

__all__ = [
    "ASIDE",
    "BODY",
    "FACES_MAX",
    "HALF_TURN",
    "NO_SHADE",
    "PROXY",
    "SAVED",
    "SHAPES",
    "WAYS",
    "Growth",
    "Shapes",
    "World",
    "build_world",
    "crowd",
    "place_ball",
    "shapes_of",
    "skin_of",
]

ASIDE: Final = 4
"""First slot of the planes that were dropped in this tick."""

SAVED: Final = ASIDE + 6
"""First slot of the planes that held the proxy before an edge was crossed. About a vertex of a scan lie 6 faces."""

SLOTS: Final = SAVED + 3
"""Slots for planes in all."""

FACES_MAX: Final = 16
"""Most edges that are followed over in one tick [count]."""

SHAPES: Final = 3
"""Shapes of a body that is given others [count]: one that is felt, one that is to be, and one that is being written."""

WAYS: Final = 14
"""Rays from the proxy along which faces of a body are looked for that changes its shape [count]: along the axes, and
between three of them. No direction is further than 28° from one."""

BODY: Final = np.dtype(
    [
        ("search", "i8"),  # address of the search structure
        ("center_B_m", "f8", (3,)),  # origin of the search structure's frame
        ("radius_m", "f8"),  # of the ball around it that holds the mesh
        ("skin_m", "f8"),  # distance the proxy keeps while it is searched for
        ("face", "i8"),  # the first row in World.corners_m of the shape it has
        ("mesh_row", "i8"),  # the mesh's first row in World.beyond
        ("two_sided", "i8"),  # 1: both sides of a face hold, 0: only its outside
        ("moved", "i8"),  # 1 where the pose is not that of the last tick
        ("passed", "i8"),  # not 0 while the tool was let in: 1 from the outside of a face, −1 from its back
        ("lead_s", "f8"),  # how long it is still led, see `hapscene.contact.deformation`,
        ("lead_W_m", "f8", (3,)),  # and how far it is meanwhile from where it is posed
        ("R_WB", "f8", (3, 3)),
        ("p_WB_m", "f8", (3,)),
        ("was_R_WB", "f8", (3, 3)),  # pose in the last tick
        ("was_p_WB_m", "f8", (3,)),
        # of a body that is given other shapes, which it takes in turn
        ("next", "i8"),  # 1 + the next such body, 0 for the last
        ("shape_felt", "i8"),  # which it has, from 1; 0 that of its mesh
        ("shape_posted", "i8"),  # which it is to have from the next tick on
        ("shape_taking", "i8"),  # which a tick is about to take
        ("shape_search", "i8", (SHAPES,)),
        ("shape_center_B_m", "f8", (SHAPES, 3)),
        ("shape_radius_m", "f8", (SHAPES,)),
        ("shape_face", "i8", (SHAPES,)),
        ("face_count", "i8"),
        ("shape_ticks", "i8"),  # since it took the last one
    ],
    align=True,
)

PROXY: Final = np.dtype(
    [
        ("p_W_m", "f8", (3,)),  # the proxy, a skin off every face that holds it
        ("count", "i8"),  # planes that hold it, 0 to 3; a fourth while one is added
        ("near_at_W_m", "f8", (3,)),  # where the tool was when the bodies near it were listed
        ("near_room_m", "f8"),  # how far the nearest body that is not listed was from there
        ("near_count", "i8"),  # bodies close enough to be met in this tick, as far as they are asked
        ("crowded", "i8"),  # 1 where there were more
        ("refused", "i8"),  # 1 where a body was given an invalid pose in this tick
        ("reshaped", "i8"),  # 1 + the first body that is given other shapes, 0 for none
        ("passed_count", "i8"),  # how many of `passed`
        ("aside", "i8"),  # how many planes were dropped in this tick
        ("held", "i8"),  # result: 1 while the tool is inside a surface
        ("by", "i8"),  # result: which plane pushes most
        ("p_WP_m", "f8", (3,)),  # result: the proxy on the surface itself; at the tool where it touches nothing
        ("crease_cos", "f8"),  # planes count as one round surface down to this cosine; `NO_SHADE` without shading
        ("push_m", "f8", (4,)),  # result of `nearest`: how hard each plane pushes
        ("short_m", "f8", (4,)),  # scratch of `nearest`: how far the tool is behind each plane
        # slots 0 to 2: the planes that hold the proxy; 3: one just met; from ASIDE on: those dropped in this tick; from
        # SAVED on: those that held it before an edge was crossed
        ("nhat_W", "f8", (SLOTS, 3)),  # plane i: nhat · x = offset, nhat on the proxy's side
        ("offset_m", "f8", (SLOTS,)),
        ("skin_m", "f8", (SLOTS,)),
        ("body", "i8", (SLOTS,)),
        ("face", "i8", (SLOTS,)),
        ("side", "f8", (SLOTS,)),  # +1 where nhat is the face's own normal, −1 where it is turned (two-sided)
        ("met", "i8", (SLOTS,)),  # 1: the face was met by a ray from where the proxy is, 2: it was taken back
        ("crossed", "i8", (FACES_MAX, 3)),  # edges, as the faces are followed: body, 3 face + edge, side
        ("gram", "f8", (4, 4)),  # scratch of `nearest`: products of the normals
        ("passed", "i8", (PASSED_MAX,)),  # bodies that let the tool in, the last one last
        ("seen", "i8", (WAYS,)),  # faces around the proxy where a body takes another shape, −1 for none
        ("seen_side", "f8", (WAYS,)),  # 1 before them, −1 behind
    ],
    align=True,
)

NO_SHADE: Final = 2.0
"""Cosine of the crease angle where nothing is shaded [1]: that of no angle."""

HALF_TURN: Final = 0.01
"""Squared cosine of half the angle a body turns in a tick below which it is looked at wherever it is [1]."""


CROWD_SAMPLE: Final = 1000
"""Bodies in whose middle it is counted how many overlap [count]: 0.2 s among 10,000."""


@by_pointer
class World(NamedTuple):
    """Everything the contact reads and writes. `near` lists the bodies that a tick has to look at."""

    bodies: Records  # (b,) BODY
    # (f, 3, 3) corners in the body's frame, mesh after mesh: side by side, a face is one read; with shading (f, 6, 3),
    # the corners and their normals: in an array of their own they cost every tick 0.06 µs, asked for or not
    corners_m: NDArray[np.float64]
    beyond: NDArray[np.int32]  # (f, 3) the face of the mesh across each edge, see `Neighbours`
    ball_W_m: NDArray[np.float64]  # (b, 4) centre and radius of the ball in which a body can be met in this tick
    near: NDArray[np.int64]  # (b,), at most NEAR_MAX and those that hold the proxy
    moved: NDArray[np.int64]  # (b + 1,) how many bodies have moved in this tick, and which
    impulse: NDArray[np.float64]  # (b, 6) given to each by the tool since the reset [N·s], and about its origin [N·m·s]
    ray: NDArray[np.float32]
    fronts_only: NDArray[np.uint64]  # how to cast a ray that passes through faces from behind
    proxy: Records  # (1,) PROXY


HOT: Final = ("proxy", "bodies", "ray", "near", "moved", "impulse", "ball_W_m", "fronts_only")
"""What a tick touches of a world wherever the tool is."""


@native
def place_ball(body: np.record, ball: NDArray[np.float64]) -> float:
    """Move a body's ball (4,) to its present pose; returns how much nearer that can bring it to anything [m].

    While the body moves, the ball is as large as a sweep in its frame asks for: larger by the way of its centre, and,
    since a chord cuts a circle, divided by the cosine of half the angle it turns.
    """
    if body.radius_m < 0.0:  # it was removed: nothing comes near it any more
        ball[3] = body.radius_m
        return 0.0
    c, R, was = body.center_B_m, body.R_WB, body.was_R_WB
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
        radius = (radius + way) / math.sqrt(half2) if half2 > HALF_TURN else math.inf
    grown = radius - ball[3]
    ball[3] = radius
    return float(way + grown)


class Shapes:
    """The meshes of a scene, packed: what is searched, and the corners of their faces. Shared by all who touch them.

    Attributes:
        searches: one for each mesh, by its identity.
        first: the mesh's first row in `corners_m` and `beyond`, likewise.
        corners_m, beyond: as `World` has them.
        skin_m: for all of them.
    """

    def __init__(self, meshes: "Sequence[Mesh]", crease_rad: float, skin_m: float | None = None) -> None:
        self.meshes = list(meshes)  # keeps their identities theirs
        self.skin_m = skin_of(*meshes) if skin_m is None else skin_m
        first = np.cumsum([0, *(len(mesh.faces) for mesh in meshes)])
        self.first = dict(zip(map(id, meshes), first, strict=False))
        self.corners_m = np.empty((first[-1], 6 if crease_rad > 0.0 else 3, 3))
        with ThreadPoolExecutor(1) as beside:  # compiled code and Embree's hold no lock of Python's
            built = [beside.submit(Search, mesh.vertices_m, mesh.faces, self.skin_m) for mesh in meshes]
            beyond = [mesh.neighbours.beyond for mesh in meshes]
            self.beyond = beyond[0] if len(beyond) == 1 else np.concatenate(beyond)
            self.searches = {id(mesh): search.result() for mesh, search in zip(meshes, built, strict=True)}
        for mesh, start in zip(meshes, first, strict=False):
            rows = self.corners_m[start : start + len(mesh.faces)]
            np.take(mesh.vertices_m, mesh.faces, axis=0, out=rows[:, :3], mode="clip")  # "raise" would take a copy
            if crease_rad > 0.0:
                rows[:, 3:] = corner_normals(mesh, crease_rad)


_shapes: "WeakValueDictionary[tuple[Any, ...], Shapes]" = WeakValueDictionary()


def shapes_of(bodies: "Sequence[Body]", crease_rad: float, skin_m: float | None = None) -> Shapes:
    """The meshes of bodies, packed once for as long as anybody uses them; with a skin of their own, or one given."""
    meshes = list({id(body.mesh): body.mesh for body in bodies}.values())
    key = (crease_rad, skin_m, *map(id, meshes))
    found = _shapes.get(key)
    if found is None:
        found = _shapes[key] = Shapes(meshes, crease_rad, skin_m)
    return found


def build_world(bodies: "Sequence[Body]", crease_rad: float = 0.0) -> World:
    """Pack the bodies of a scene; the world's bodies, whose records hold addresses of what is searched, keep it alive.

    Of bodies that are given other shapes their `Deformation`s do.

    Edges flatter than `crease_rad` are shaded (`hapscene.contact.shading`), at 0 none.
    """
    shapes = shapes_of(bodies, crease_rad)
    rows, balls = _owning_records(len(bodies), BODY, shapes), np.zeros((len(bodies), 4))
    _place(rows, balls, bodies, shapes, (0, 0))
    proxy = records(1, PROXY)
    proxy.crease_cos = math.cos(crease_rad) if crease_rad > 0.0 else NO_SHADE
    world = World(
        bodies=rows,
        corners_m=shapes.corners_m,
        beyond=shapes.beyond,
        ball_W_m=balls,
        near=np.zeros(min(len(rows), NEAR_MAX + ASIDE), np.int64),
        moved=np.zeros(len(rows) + 1, np.int64),
        impulse=np.zeros((len(rows), 6)),
        ray=new_ray(),
        fronts_only=fronts_only(),
        proxy=proxy,
    )
    near = pack_small_arrays([getattr(world, name) for name in HOT], shapes)
    return world._replace(**dict(zip(HOT, near, strict=True)))


def _place(
    rows: Records,
    balls: NDArray[np.float64],
    bodies: "Sequence[Body]",
    shapes: Shapes | None,
    first: tuple[int, int],
    like: Mapping[int, Any] = MappingProxyType({}),
) -> None:
    """Fill the records of bodies, and their balls (b, 4).

    Their shapes are those of the records `like` has by mesh, or else of `shapes`, whose first rows in `corners_m` and
    `beyond` are `first`.
    """
    for row, ball, body in zip(rows, balls, bodies, strict=True):
        key = id(body.mesh)
        if key in like:
            row.search, row.radius_m, row.skin_m = like[key].search, like[key].radius_m, like[key].skin_m
            row.center_B_m, row.face, row.mesh_row = like[key].center_B_m, like[key].face, like[key].mesh_row
        else:
            assert shapes is not None
            search = shapes.searches[key]
            row.search, row.radius_m, row.skin_m = search.handle, search.radius_m, shapes.skin_m
            row.center_B_m = search.center_m
            row.face, row.mesh_row = (start + shapes.first[key] for start in first)
        row.two_sided = body.two_sided
        row.R_WB, row.p_WB_m = body.X_WB[:3, :3], body.X_WB[:3, 3]
        row.was_R_WB, row.was_p_WB_m = row.R_WB, row.p_WB_m
        ball[:3] = (row.R_WB * row.center_B_m).sum(axis=1) + row.p_WB_m
        ball[3] = row.radius_m + row.skin_m


FAR_FINER: Final = 100.0
"""How much finer a skin a body may ask for that is added to a world, whose skin stays [1]."""


class Growth:
    """A world of more bodies: their searches are built while the old one is used, and `take` comes between two ticks.

    What is there already in its first shape is shared.

    Args:
        world: as it is.
        known: its bodies.
        bodies: that come behind them.
        crease_rad: as `build_world` has it.

    Raises:
        SceneError: a body so large, or so small, that it asks for a far coarser or finer search.
    """

    def __init__(self, world: World, known: "Sequence[Body]", bodies: "Sequence[Body]", crease_rad: float) -> None:
        skin_m = float(world.bodies[0].skin_m)
        for body in bodies:
            size_m = _size_of(body.mesh)
            if not SKIN_RATIO_MIN * size_m <= 1.01 * skin_m <= FAR_FINER * SKIN_RATIO * size_m:
                large = SKIN_RATIO_MIN * size_m > skin_m
                raise SceneError(
                    f"body {body.name!r} is far too {'large' if large else 'small'} to be added to what is touched "
                    "already: have it in the scene from the start"
                )
        self._rows: dict[int, Any] = {}
        for row, body in zip(world.bodies, known, strict=True):
            if row.face_count == 0 and row.radius_m > 0.0:
                self._rows.setdefault(id(body.mesh), row)
        new = [body for body in bodies if id(body.mesh) not in self._rows]
        self._shapes = shapes_of(new, crease_rad, skin_m) if new else None
        self._bodies, self._before = bodies, world.corners_m
        self._corners_m = self._longer(world.corners_m)
        self._beyond = np.concatenate((world.beyond, self._shapes.beyond)) if self._shapes else world.beyond

    def _longer(self, corners_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Corners, and behind them those of what is new."""
        return np.concatenate((corners_m, self._shapes.corners_m)) if self._shapes else corners_m

    def take(self, world: World) -> World:
        """The world with them, all else as it is now."""
        before, count = len(world.bodies), len(world.bodies) + len(self._bodies)
        corners_m = self._corners_m
        if world.corners_m is not self._before:  # it has got room for other shapes meanwhile
            corners_m = self._longer(world.corners_m)
        rows, balls = _owning_records(count, BODY, (world.bodies, self._shapes)), np.zeros((count, 4))
        rows[:before], balls[:before] = world.bodies, world.ball_W_m
        for row in rows[:before]:
            if row.face_count > 0:  # and other shapes
                first, end = int(row.shape_face[0]), int(row.shape_face[-1] + row.face_count)
                corners_m[first:end] = world.corners_m[first:end]
        ends = len(world.corners_m), len(world.beyond)
        _place(rows[before:], balls[before:], self._bodies, self._shapes, ends, self._rows)
        moved, impulse = np.zeros(count + 1, np.int64), world.impulse
        moved[: before + 1] = world.moved
        if len(impulse) < count:
            impulse = np.zeros((count, 6))
            impulse[:before] = world.impulse
        world.proxy[0].near_count, world.proxy[0].near_room_m = 0, 0.0  # which are near is looked up anew
        near = np.zeros(min(count, NEAR_MAX + ASIDE), np.int64)
        return world._replace(
            bodies=rows,
            corners_m=corners_m,
            beyond=self._beyond,
            ball_W_m=balls,
            near=near,
            moved=moved,
            impulse=impulse,
        )


def crowd(world: World) -> tuple[int, int]:
    """How many bodies overlap by their balls, where most do, and the body in whose middle that is."""
    p, radius = world.ball_W_m[:, :3], world.ball_W_m[:, 3]
    at = np.arange(0, len(p), math.ceil(len(p) / CROWD_SAMPLE))
    counts = [int(np.count_nonzero(((p - p[k]) ** 2).sum(axis=1) <= radius**2)) for k in at]
    return max(counts), int(at[np.argmax(counts)])


def skin_of(*meshes: "Mesh") -> float:
    """One skin for all meshes of a scene [m], or a proxy that glides over one would catch on the overlap of another.

    As fine as the smallest body asks for, unless the largest is so much larger that float32 would not hold it.
    """
    sizes_m = {id(mesh): _size_of(mesh) for mesh in meshes}.values()
    return max(SKIN_RATIO * min(sizes_m), SKIN_RATIO_MIN * max(sizes_m))


def _size_of(mesh: "Mesh") -> float:
    """Diagonal of the box that holds all vertices [m]."""
    return float(np.linalg.norm([np.ptp(column) for column in mesh.vertices_m.T]))


def _owning_records(count: int, dtype: np.dtype[Any], owned: Any) -> Any:
    """`records` that keep `owned` alive as long as any view of them is there."""
    memory = Owning(count * dtype.itemsize)
    memory.owned = owned
    return np.frombuffer(memory, dtype).view(np.recarray)
