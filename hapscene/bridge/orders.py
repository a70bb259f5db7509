"""What clients may order, over UDP or WebSocket, in their own frame and unit; carried out one at a time.

In a thread of its own: a body that takes a second to be added holds up no FRAME.
"""

import inspect
import os
import warnings
from base64 import b64decode
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from threading import Lock
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from hapscene.bridge.conventions import Convention
from hapscene.bridge.packets import VERSION, PacketError
from hapscene.constants import DEFAULT_GRIP
from hapscene.errors import HapsceneError, MeshError, SceneError, SwatchError, no_such
from hapscene.geometry import numbers
from hapscene.loop.servo import BODY_ROOM, Servo
from hapscene.scene.mesh import Mesh

__all__ = ["Orders"]

FACE_MAX: Final = 10_000_000
"""Faces that clients may add in all [count]: what is removed keeps its memory."""


T = TypeVar("T")


class Orders:
    """The orders of a servo, and what they change of what its clients are told.

    Args:
        servo: entered before the first order.

    Attributes:
        names: the bodies that are there, by their numbers; another dict after each change.
        grip: of the hand that aims.
        before: (room, 6) what is added to a body's impulse since the last start to have its total.
        freed: names of the bodies that may be pushed.
        counts: messages by what became of them.
        moment: held while a FRAME is taken in, and by what no FRAME may see half done.
    """

    def __init__(self, servo: Servo) -> None:
        self.servo = servo
        self.names = {number: body.name for number, body in enumerate(servo.scene.bodies)}
        self.grip: str = DEFAULT_GRIP
        self.before = np.zeros((len(self.names) + BODY_ROOM, 6))
        self.freed: set[str] = set()
        self.counts: Counter[str] = Counter()
        self.moment = Lock()
        self._faces_left = FACE_MAX
        self._thread = ThreadPoolExecutor(1, "orders")

    def __enter__(self) -> "Orders":
        return self

    def __exit__(self, *error: object) -> None:
        self._thread.shutdown(cancel_futures=True)

    def submit(self, to: Convention, read: Callable[[], Any], tell: Callable[[dict[str, Any]], T]) -> "Future[T]":
        """Have an order of a client whose frame is `to` be read and done when its turn comes.

        Args:
            to: its frame.
            read: has the order, or raises PacketError.
            tell: makes the answer of `done` or `error`.
        """
        return self._thread.submit(lambda: tell(self._run(to, read)))

    def _run(self, to: Convention, read: Callable[[], Any]) -> dict[str, Any]:
        try:
            return self.carry_out(to, read())
        except PacketError as error:
            self.counts["no orders"] += 1
            return {"error": str(error)}
        except Exception:  # a fault of ours
            self.counts["failed"] += 1
            return {"error": "this order failed in the server"}

    def carry_out(self, to: Convention, order: dict[str, Any]) -> dict[str, Any]:
        """Do it now; whatever it holds, the answer is a sentence."""
        self.counts["orders"] += 1
        given = dict(order)
        name = given.pop("order", None)
        do = ORDERS.get(name) if isinstance(name, str) else None
        if do is None:
            return {"error": f"no order {name!r:.40}; there are: {', '.join(ORDERS)}"}
        with warnings.catch_warnings(record=True) as noted:
            warnings.simplefilter("always")
            try:
                told = {"done": name} | (do(self, to, **given) or {})
            except HapsceneError as error:
                return {"error": f"{error!s:.1000}"}
            except (ArithmeticError, AttributeError, LookupError, MemoryError, TypeError, ValueError):
                takes = ", ".join([*inspect.signature(do).parameters][2:]) or "nothing"
                return {"error": f"order {name!r} lacks something, or has it wrong; it takes: {takes}"}
        notes = [f"{note.message!s:.1000}" for note in noted if issubclass(note.category, UserWarning)]
        return told | ({"notes": notes} if notes else {})

    def welcome(self) -> dict[str, Any]:
        """What a client is told first."""
        return {
            "version": VERSION,
            "bodies": [self.names.get(number, "") for number in range(len(self.servo.scene.bodies))],
            "swatches": [swatch.name for swatch in self.servo.scene.swatches],
            "tick_s": self.servo.tick_s,
        }

    def total(self, number: int) -> NDArray[np.float64]:
        """What the tool has given a body in this session (6,); one that was removed keeps what it had."""
        total: NDArray[np.float64] = self.before[number].copy()
        if number in self.names:
            total += np.concatenate(self.servo.impulse(self.names[number]))
        return total

    def given(self) -> NDArray[np.float64]:
        """What the tool has given the bodies since the servo started (room, 6)."""
        given = np.zeros_like(self.before)
        for number, name in self.names.items():
            given[number] = np.concatenate(self.servo.impulse(name))
        return given

    def fix_all(self) -> None:
        """Nothing is pushed any more."""
        for name in self.freed:
            self.servo.set_mass(name, np.inf, inertia_B_kg_m2=(1.0, 1.0, 1.0))
        self.freed.clear()

    # --- the orders: what they are given is what a client said, of any type

    def _start(self, to: Convention, p: Any, grip: Any = DEFAULT_GRIP) -> None:
        with self.moment:
            given = self.given()
            self.servo.start(to.place(p), str(grip))
            self.grip = str(grip)
            self.before += given  # the servo begins at 0 again, the session's totals go on

    def _pause(self, to: Convention) -> None:
        self.servo.pause()

    def _resume(self, to: Convention) -> None:
        self.servo.resume()

    def _tune(self, to: Convention, swatch: Any, numbers: Any) -> None:
        self.servo.tune(str(swatch), **_floats(numbers))

    def _tune_field(self, to: Convention, effect: Any, numbers: Any) -> None:
        self.servo.tune_field(str(effect), **_floats(numbers))

    def _free(self, to: Convention, body: Any, mass: Any, inertia: Any, com: Any = (0.0, 0.0, 0.0)) -> None:
        mass_kg, inertia_B = float(mass), to.inertia(numbers(inertia))
        with self.moment:
            self.servo.set_mass(str(body), mass_kg, inertia_B_kg_m2=inertia_B, com_B_m=to.place(com))
            self.freed.add(str(body))

    def _add(
        self,
        to: Convention,
        name: Any,
        vertices: Any = None,
        faces: Any = None,
        like: Any = None,
        swatch: Any = None,
        p: Any = (0.0, 0.0, 0.0),
        q: Any = (0.0, 0.0, 0.0, 1.0),
        two_sided: Any = False,
        clockwise: Any = False,
    ) -> dict[str, Any]:
        if (like is None) == (vertices is None or faces is None):
            raise SceneError("to add a body, give vertices and faces, or like: the name of a body of the same shape")
        if like is None:
            mesh = Mesh(to.place(_rows(vertices, "<f4")), _whole(faces)[:, :: -1 if clockwise else 1])
            if len(mesh.faces) > self._faces_left:
                raise MeshError(f"clients may add {FACE_MAX:,} faces in all; {self._faces_left:,} are left")
        else:
            mesh = self.servo.scene.bodies[self._number(like)].mesh
        wears = None if swatch is None else _named(swatch)
        body = self.servo.add(mesh, name, swatch=wears, pose=to.pose(p, q), two_sided=bool(two_sided))
        self._faces_left -= len(mesh.faces) if like is None else 0
        number = len(self.servo.scene.bodies) - 1
        self.names = self.names | {number: body.name}
        return {"body": number}

    def _remove(self, to: Convention, body: Any) -> None:
        number = self._number(body)
        with self.moment:
            self.before[number] = self.total(number)
            self.names = {at: name for at, name in self.names.items() if at != number}
            self.freed.discard(body)
        self.servo.remove(body)

    def _paint(self, to: Convention, body: Any, swatch: Any, faces: Any = None) -> dict[str, Any]:
        self._number(body)
        scene = self.servo.scene.copy()
        scene.bodies = [scene.bodies[number] for number in self.names]
        count = scene.paint(body, _named(swatch), faces)
        self.servo.repaint(scene)
        return {"faces": count}

    def _deform(self, to: Convention, body: Any, vertices: Any) -> None:
        self._number(body)
        self.servo.deform(body, to.place(_rows(vertices, "<f4")))

    def _bodies(self, to: Convention) -> dict[str, Any]:
        bodies = self.servo.scene.bodies
        return self.welcome() | {"faces": [len(body.mesh.faces) for body in bodies]}

    def _counts(self, to: Convention) -> dict[str, Any]:
        return {"counts": dict(self.counts)}

    def _number(self, body: Any) -> int:
        found = next((number for number, name in self.names.items() if name == body), None)
        if found is None:
            raise SceneError(no_such("body", f"{body!s:.100}", self.names.values()))
        return found


ORDERS: Final[dict[str, Callable[..., dict[str, Any] | None]]] = {
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


def _floats(given: Any) -> dict[str, float]:
    return {str(name): float(value) for name, value in given.items()}


def _named(swatch: Any) -> str:
    """A swatch by its name: no file is read for a client."""
    if not isinstance(swatch, str) or swatch.endswith(".swatch") or {"/", "\\", os.sep} & {*swatch}:
        raise SwatchError(f"a swatch is said by its name, not {swatch!r:.60}")
    return swatch


def _rows(given: Any, packed: str) -> NDArray[np.float64]:
    """Numbers (n, 3), as lists or, which is read twenty times as fast, packed little-endian as Base64."""
    if isinstance(given, str):
        given = np.frombuffer(b64decode(given, validate=True), packed).reshape(-1, 3)
    return numbers(given)


def _whole(faces: Any) -> NDArray[np.int32]:
    """Indices (m, 3)."""
    read = _rows(faces, "<u4")
    whole = np.isfinite(read).all() and (read == np.floor(read)).all() and (np.abs(read) < 2**31).all()
    if read.ndim != 2 or not whole:
        raise MeshError("faces are three whole numbers each, (m, 3): places in the list of vertices, from 0")
    return read.astype(np.int32)
