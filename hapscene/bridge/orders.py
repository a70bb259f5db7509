"""Orders of clients, received over UDP or WebSocket in client coordinates, and executed one at a time.

They run in a separate thread, so that an order that takes long, such as adding a body, does not delay FRAME packets.
"""

import inspect
import warnings
from base64 import b64decode
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from threading import Lock
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from hapscene.bridge.conventions import Convention
from hapscene.bridge.packets import VERSION, PacketError
from hapscene.constants import DEFAULT_GRIP
from hapscene.errors import HapsceneError, MeshError, SceneError, SwatchError, no_such
from hapscene.geometry import numbers
from hapscene.io.files import Json
from hapscene.loop.servo import BODY_ROOM, Servo
from hapscene.scene.mesh import Mesh

__all__ = ["Orders"]

FACE_MAX: Final = 10_000_000
"""Most faces that clients can add in total [count]; removed bodies keep their memory."""


T = TypeVar("T")


class Orders:
    """Executes the orders of clients on a servo.

    Args:
        servo: the servo; it must be entered before the first order.

    Attributes:
        names: present bodies by their numbers; replaced by a new dict after each change.
        grips: grip of the hand of each tool, which follows the aim.
        impulse_offset: (room, 6) offset that is added to the impulse of a body since the last start to get its total.
        freed: names of the bodies that can be pushed.
        counts: number of messages by result.
        lock: held while a FRAME is processed, and during changes that a FRAME must not see incomplete.
    """

    def __init__(self, servo: Servo) -> None:
        self.servo = servo
        self.names = {number: body.name for number, body in enumerate(servo.scene.bodies)}
        self.grips = [DEFAULT_GRIP] * servo.tools
        self.impulse_offset = np.zeros((len(self.names) + BODY_ROOM, 6))
        self.freed: set[str] = set()
        self.counts: Counter[str] = Counter()
        self.lock = Lock()
        self._faces_left = FACE_MAX
        self._thread = ThreadPoolExecutor(1, "orders")

    def __enter__(self) -> "Orders":
        return self

    def __exit__(self, *error: object) -> None:
        self._thread.shutdown(cancel_futures=True)

    def submit(self, to: Convention, read: Callable[[], Json], encode: Callable[[dict[str, Json]], T]) -> "Future[T]":
        """Queue an order of a client.

        Args:
            to: coordinate convention of the client.
            read: returns the order, or raises PacketError.
            encode: makes the answer from the result with `done` or `error`.
        """
        return self._thread.submit(lambda: encode(self._run(to, read)))

    def _run(self, to: Convention, read: Callable[[], Json]) -> dict[str, Json]:
        try:
            return self.carry_out(to, read())
        except PacketError as error:
            self.counts["no orders"] += 1
            return {"error": str(error)}
        except Exception:  # a defect of the server
            self.counts["failed"] += 1
            return {"error": "internal error of the server in this order"}

    def carry_out(self, to: Convention, order: dict[str, Json]) -> dict[str, Json]:
        """Execute an order immediately, and return the result; never raises for an invalid order."""
        self.counts["orders"] += 1
        given = dict(order)
        name = given.pop("order", None)
        do = ORDERS.get(name) if isinstance(name, str) else None
        if do is None:
            return {"error": f"unknown order {name!r:.40}; expected one of: {', '.join(ORDERS)}"}
        with warnings.catch_warnings(record=True) as noted:
            warnings.simplefilter("always")
            try:
                result = {"done": name} | (do(self, to, **given) or {})
            except HapsceneError as error:
                return {"error": f"{error!s:.1000}"}
            except (ArithmeticError, AttributeError, LookupError, MemoryError, TypeError, ValueError):
                fields = ", ".join([*inspect.signature(do).parameters][2:]) or "no fields"
                return {"error": f"order {name!r}: a field is missing or invalid; expected: {fields}"}
        notes = [f"{note.message!s:.1000}" for note in noted if issubclass(note.category, UserWarning)]
        return result | ({"notes": notes} if notes else {})

    def welcome(self) -> dict[str, Json]:
        """The first message to a client."""
        return {
            "version": VERSION,
            "bodies": [self.names.get(number, "") for number in range(len(self.servo.scene.bodies))],
            "swatches": [swatch.name for swatch in self.servo.scene.swatches],
            "tick_s": self.servo.tick_s,
            "tools": self.servo.tools,
            "tip_radius_m": self.servo.tip_radius_m,
        }

    def total(self, number: int) -> NDArray[np.float64]:
        """Total impulse (6,) of all tools on a body; a removed body keeps its total."""
        total: NDArray[np.float64] = self.impulse_offset[number].copy()
        if number in self.names:
            total += np.concatenate(self.servo.impulse(self.names[number]))
        return total

    def given(self) -> NDArray[np.float64]:
        """Impulses (room, 6) of all tools on the bodies since the start of the servo."""
        given = np.zeros_like(self.impulse_offset)
        for number, name in self.names.items():
            given[number] = np.concatenate(self.servo.impulse(name))
        return given

    def tool(self, number: Json) -> int:
        """The number of a tool that a client sent.

        Raises:
            PacketError: there is no such tool.
        """
        if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number < self.servo.tools:
            raise PacketError(
                f"tool {number!r:.20}: expected an integer from 0 to {self.servo.tools - 1}; `hapscene serve --tools` "
                "sets how many there are"
            )
        return number

    def withdraw(self, tool: int) -> None:
        """Let the tool of a client that has left touch nothing, if other clients may be there."""
        if self.servo.tools > 1:
            self._thread.submit(self.servo.withdraw, tool=tool)

    def fix_all(self) -> None:
        """Fix all bodies, so that they cannot be pushed."""
        for name in self.freed:
            self.servo.set_mass(name, np.inf, inertia_B_kg_m2=(1.0, 1.0, 1.0))
        self.freed.clear()

    # --- the orders; their arguments come from a client, and may be of any type

    def _start(self, to: Convention, p: Json, grip: Json = DEFAULT_GRIP, tool: Json = 0) -> None:
        number = self.tool(tool)
        with self.lock:
            given = self.servo.start(to.position(p), str(grip), tool=number if self.servo.tools > 1 else None)
            self.grips[number] = str(grip)
            self.impulse_offset += given  # the servo restarts at 0; the totals continue

    def _pause(self, to: Convention) -> None:
        self.servo.pause()

    def _resume(self, to: Convention) -> None:
        self.servo.resume()

    def _tune(self, to: Convention, swatch: Json, numbers: Json) -> None:
        self.servo.tune(str(swatch), **_floats(numbers))

    def _tune_field(self, to: Convention, effect: Json, numbers: Json) -> None:
        self.servo.tune_field(str(effect), **_floats(numbers))

    def _free(self, to: Convention, body: Json, mass: Json, inertia: Json, com: Json = (0.0, 0.0, 0.0)) -> None:
        mass_kg, inertia_B = float(mass), to.inertia(numbers(inertia))
        with self.lock:
            self.servo.set_mass(str(body), mass_kg, inertia_B_kg_m2=inertia_B, com_B_m=to.position(com))
            self.freed.add(str(body))

    def _add(
        self,
        to: Convention,
        name: Json,
        vertices: Json = None,
        faces: Json = None,
        like: Json = None,
        swatch: Json = None,
        p: Json = (0.0, 0.0, 0.0),
        q: Json = (0.0, 0.0, 0.0, 1.0),
        two_sided: Json = False,
        clockwise: Json = False,
    ) -> dict[str, Json]:
        if (like is None) == (vertices is None or faces is None):
            raise SceneError("expected either vertices and faces, or 'like', the name of a body with the same shape")
        if like is None:
            mesh = Mesh(to.position(_rows(vertices, "<f4")), _face_indices(faces)[:, :: -1 if clockwise else 1])
            if len(mesh.faces) > self._faces_left:
                raise MeshError(f"clients can add {FACE_MAX:,} faces in total; {self._faces_left:,} are left")
        else:
            mesh = self.servo.scene.bodies[self._number(like)].mesh
        wears = None if swatch is None else _named(swatch)
        body = self.servo.add(mesh, name, swatch=wears, pose=to.pose(p, q), two_sided=bool(two_sided))
        self._faces_left -= len(mesh.faces) if like is None else 0
        number = len(self.servo.scene.bodies) - 1
        self.names = self.names | {number: body.name}
        return {"body": number}

    def _remove(self, to: Convention, body: Json) -> None:
        number = self._number(body)
        with self.lock:
            self.impulse_offset[number] = self.total(number)
            self.names = {at: name for at, name in self.names.items() if at != number}
            self.freed.discard(body)
        self.servo.remove(body)

    def _paint(self, to: Convention, body: Json, swatch: Json, faces: Json = None) -> dict[str, Json]:
        scene = self.servo.scene.copy()
        scene.bodies = [scene.bodies[number] for number in self.names]
        count = scene.paint(body, _named(swatch), faces)
        self.servo.repaint(scene)
        return {"faces": count}

    def _deform(self, to: Convention, body: Json, vertices: Json) -> None:
        self._number(body)
        self.servo.deform(body, to.position(_rows(vertices, "<f4")))

    def _bodies(self, to: Convention) -> dict[str, Json]:
        bodies = self.servo.scene.bodies
        return self.welcome() | {"faces": [len(body.mesh.faces) for body in bodies]}

    def _counts(self, to: Convention) -> dict[str, Json]:
        return {"counts": dict(self.counts)}

    def _number(self, body: Json) -> int:
        found = next((number for number, name in self.names.items() if name == body), None)
        if found is None:
            raise SceneError(no_such("body", f"{body!s:.100}", self.names.values()))
        return found


ORDERS: Final[dict[str, Callable[..., dict[str, Json] | None]]] = {
    "start": Orders._start,
    "pause": Orders._pause,
    "resume": Orders._resume,
    "tune": Orders._tune,
    "tune_field": Orders._tune_field,
    "free": Orders._free,
    "add": Orders._add,
    "remove": Orders._remove,
    "paint": Orders._paint,
    "deform": Orders._deform,
    "bodies": Orders._bodies,
    "counts": Orders._counts,
}


def _floats(given: Json) -> dict[str, float]:
    return {str(name): float(value) for name, value in given.items()}


def _named(swatch: Json) -> str:
    """Check the name of a swatch; clients cannot make the server read a file."""
    if not isinstance(swatch, str) or swatch.endswith(".swatch") or {"/", "\\"} & {*swatch}:
        raise SwatchError(f"swatch {swatch!r:.60}: expected the name of a swatch, not a file")
    return swatch


def _rows(given: Json, packed: str) -> NDArray[np.float64]:
    """Numbers (n, 3), from lists, or from little-endian Base64, which is twenty times as fast."""
    if isinstance(given, str):
        given = np.frombuffer(b64decode(given, validate=True), packed).reshape(-1, 3)
    return numbers(given)


def _face_indices(faces: Json) -> NDArray[np.int32]:
    """Vertex indices (m, 3) of faces."""
    read = _rows(faces, "<u4")
    whole = np.isfinite(read).all() and (read == np.floor(read)).all() and (np.abs(read) < 2**31).all()
    if read.ndim != 2 or not whole:
        raise MeshError("faces: expected integers (m, 3), indices of vertices from 0")
    return read.astype(np.int32)
