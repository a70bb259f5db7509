"""A format read, apart from how it is written: a scene from X3D that `hapscene.exchange.x3d` wrote.

Files come from strangers: no entity is expanded, no other file or address is opened, sizes are capped.
"""

import json
import math
import re
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import SceneError
from hapscene.exchange.gltf_read import read_bounded
from hapscene.exchange.swatch_payload import Reader, check_version, finite, hang_again, is_digest, restore, restore_fine
from hapscene.exchange.x3d import BODY, FIELDS, SWATCH, WORLD
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from hapscene.scene.scene_file import BODY_MAX
from hapscene.surface.swatch import Swatch

X3D_MAX_B: Final = 1_000_000_000
"""Largest X3D file that is read [bytes]: some 15 million faces."""

MARK_MAX: Final = 1_500_000
"""Most tags of a file, and most attributes [count], at some 150 bytes each in memory: 10,000 bodies of 8 swatches have
1.2 million."""


def read_x3d(path: Path) -> Scene:
    """The scene of an X3D file of ours.

    Raises:
        SceneError: not XML, not ours, damaged, too large, or of a later version.
        MeshError, SwatchError: a mesh or a swatch in it is broken.
    """
    root = _parsed(path)
    version = next((m.get("content") for m in root.iter("meta") if m.get("name") == "hapscene_version"), None)
    if root.tag != "X3D" or version is None:
        raise SceneError(
            f"{path}: not an X3D file of hapscene: its head has no meta hapscene_version; other X3D files "
            "are not read: convert them to GLB, and import that"
        )
    check_version(path, int(version) if version.isdecimal() and len(version) < 10 else version)
    reader = _Reader(path, root)
    world = reader.defined.get(WORLD)
    scene = Scene()
    if world is None:
        raise SceneError(f"{path}: no body in it: expected a Transform of DEF {WORLD!r} around all")
    for place in world.iterchildren("Transform"):
        if len(scene.bodies) == BODY_MAX:
            raise SceneError(f"{path}: more than {BODY_MAX:,} bodies")
        reader.add_body(scene, place)
    if not scene.bodies:
        raise SceneError(f"{path}: no body in it: expected a Transform for each within that of DEF {WORLD!r}")
    for shape in world.iterchildren("Shape"):  # of a swatch that no face wears
        scene.swatch_index(reader.swatch(reader.child(shape, "Appearance")))
    for body, (text, parent) in zip(scene.bodies, reader.more, strict=True):
        hang_again(path, scene, body, None if parent is None else unquoted(parent))
        if text is not None:
            try:
                told = json.loads(unquoted(text))
            except (ValueError, RecursionError):
                told = None
            restore_fine(path, scene, body, told)
    return scene


def _parsed(path: Path) -> Any:
    """The root element of a file, parsed without entities or network."""
    from lxml import etree

    data = read_bounded(path)
    if len(data) > X3D_MAX_B:
        raise SceneError(f"{path}: {len(data):,} bytes; at most {X3D_MAX_B:,} are read")
    plain = data.replace(b"\0", b"") if b"\0" in data[:1000] else data  # UTF-16 too
    if b"<!DOCTYPE" in plain or b"<!ENTITY" in plain:
        raise SceneError(f"{path}: has a DOCTYPE, which files of hapscene have not; it is not read")
    for mark, kind in ((b"<", "tags"), (b"=", "attributes")):
        if (found := plain.count(mark)) > MARK_MAX:
            raise SceneError(f"{path}: {found:,} {kind}; at most {MARK_MAX:,} are read")
    parser = etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        huge_tree=True,  # long attributes: all vertices stand in one; entities, its danger, are none
        remove_comments=True,
        remove_pis=True,
    )
    try:
        root = etree.fromstring(data, parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        raise SceneError(f"{path}: not XML: {' '.join(str(error).split())[:200]}") from None
    if root is None or root.getroottree().docinfo.doctype:
        raise SceneError(f"{path}: has a DOCTYPE or nothing in it; it is not read")
    return root


class _Reader(Reader):
    """Elements by their DEF, and what was made of them."""

    def __init__(self, path: Path, root: Any) -> None:
        super().__init__(path)
        self.defined = {e.get("DEF"): e for e in root.iter() if e.get("DEF")}
        self.points: dict[Any, NDArray[np.float64]] = {}
        self.swatches: dict[Any, Swatch | str] = {}
        self.more: list[tuple[str | None, str | None]] = []  # of each body: what is painted finer, and its parent
        self.shapes: dict[tuple[Any, ...], tuple[Mesh, list[tuple[Any, int]]]] = {}

    def child(self, element: Any, *kinds: str) -> Any:
        """The first child of one of these kinds, or what it says to USE."""
        found = next(element.iterchildren(*kinds), None)
        if found is None:
            raise self.fail(f"line {element.sourceline}: <{element.tag}> has no {' or '.join(kinds)}")
        return self.used(found)

    def used(self, element: Any) -> Any:
        name = element.get("USE")
        if name is None:
            return element
        if name not in self.defined or self.defined[name].tag != element.tag:
            raise self.fail(f"line {element.sourceline}: no {element.tag} with DEF {name[:60]!r}")
        return self.defined[name]

    def numbers(self, element: Any, field: str, count: int) -> list[float]:
        words = element.get(field, "").replace(",", " ").split()
        try:
            if len(words) != count:
                raise ValueError
            return [finite(word) for word in words]
        except ValueError:
            raise self.fail(f"line {element.sourceline}: <{element.tag} {field}> must be {count} numbers") from None

    def array(self, element: Any, field: str, dtype: Any) -> NDArray[Any]:
        """Triples (n, 3) of a long field."""
        where = f"line {element.sourceline}: <{element.tag} {field}>"
        words = element.get(field, "").replace(",", " ").split()
        self.count(len(words) // 3)
        try:
            values = np.array(words, dtype=dtype)
        except (ValueError, OverflowError):
            raise self.fail(f"{where} must be numbers") from None
        if values.size % 3 or not values.size:
            raise self.fail(f"{where} must be triples of numbers, has {values.size}")
        return values.reshape(-1, 3)

    def metadata(self, element: Any, name: str) -> dict[str, str]:
        """The values in a MetadataSet of that name by their own names."""
        for found in element.iterchildren("MetadataSet"):
            if found.get("name") == name:
                return {e.get("name", ""): e.get("value", "") for e in found.iterchildren()}
        raise self.fail(f"line {element.sourceline}: <{element.tag}> has no MetadataSet {name!r}")

    def add_body(self, scene: Scene, place: Any) -> None:
        about = self.metadata(place, BODY)
        X_WB = np.eye(4)
        X_WB[:3, :3] = rotation(*self.numbers(place, "rotation", 4))
        X_WB[:3, 3] = self.numbers(place, "translation", 3)
        parts = tuple(self.used(shape) for shape in place.iterchildren("Shape"))
        if not parts:
            raise self.fail(f"line {place.sourceline}: the body has no Shape")
        if parts not in self.shapes:
            self.shapes[parts] = self.shape(parts)
        mesh, runs = self.shapes[parts]
        self.count(len(mesh.faces))
        two_sided = about.get("two_sided") == "true"
        body = scene.add(mesh, name=unquoted(about.get("name", "")), pose=X_WB, two_sided=two_sided)
        self.more.append((about.get("fine"), about.get("parent")))
        start = 0
        for look, count in runs:
            body.face_swatch[start : start + count] = scene.swatch_index(self.swatch(look))
            start += count

    def shape(self, parts: tuple[Any, ...]) -> tuple[Mesh, list[tuple[Any, int]]]:
        """The mesh of a body's Shapes, and the Appearance and number of faces of each."""
        sets = [self.child(part, "IndexedTriangleSet") for part in parts]
        coordinates = {self.child(faces, "Coordinate") for faces in sets}
        if len(coordinates) != 1:
            raise self.fail(f"line {parts[0].sourceline}: the Shapes of a body share one Coordinate")
        point = coordinates.pop()
        if point not in self.points:
            self.points[point] = self.array(point, "point", np.float64)
        faces = [self.array(one, "index", np.int64) for one in sets]
        looks = [self.child(part, "Appearance") for part in parts]
        runs = [(look, len(some)) for look, some in zip(looks, faces, strict=True)]
        return Mesh(self.points[point], np.concatenate(faces)), runs

    def swatch(self, look: Any) -> Swatch | str:
        if look not in self.swatches:
            about = self.metadata(look, SWATCH)
            surface = self.child(look, "FrictionalSurface", "SmoothSurface")
            if surface.get("useRelativeValues") != "false":
                raise self.fail(f'line {surface.sourceline}: stiffness is read in N/m alone: useRelativeValues="false"')
            smooth = surface.tag == "SmoothSurface"
            numbers = {
                name: 0.0 if smooth and "Friction" in field else self.numbers(surface, field, 1)[0]
                for field, name in FIELDS.items()
            }
            colour = self.numbers(self.child(look, "Material"), "diffuseColor", 3)
            sha256 = unquoted(about.get("sha256", ""))
            if not is_digest(sha256):
                raise self.fail(f"line {look.sourceline}: expected the swatch's sha256 in its MetadataSet")
            self.swatches[look] = restore(self.path, unquoted(about.get("name", "")), numbers, colour, sha256)
        return self.swatches[look]


def unquoted(text: str) -> str:
    """The one string of an MFString."""
    text = text.strip()
    return re.sub(r"\\(.)", r"\1", text[1:-1]) if len(text) > 1 and text[0] == text[-1] == '"' else text


def rotation(x: float, y: float, z: float, angle_rad: float) -> NDArray[np.float64]:
    """Matrix (3, 3) of an axis, of any length, and an angle [rad]: Rodrigues' formula."""
    length = math.hypot(x, y, z)
    if length == 0.0:
        return np.eye(3)
    n = np.array([x, y, z]) / length
    cross = np.array([[0.0, -n[2], n[1]], [n[2], 0.0, -n[0]], [-n[1], n[0], 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle_rad) * cross + (1.0 - math.cos(angle_rad)) * cross @ cross)
