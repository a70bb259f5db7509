"""X3D (ISO/IEC 19775) with the surface nodes of H3D: a Shape for each swatch on each body.

    Transform W (turns z up into X3D's y up)
      Transform (pose) per body: MetadataSet "hapscene body"
        Shape per swatch: Appearance (Material, FrictionalSurface), IndexedTriangleSet over the body's one Coordinate
      Shape per swatch that no face wears: Appearance, no geometry

`FrictionalSurface` and `SmoothSurface` (no friction) are H3D's own nodes, not part of X3D: other players skip or
refuse them. With useRelativeValues="false" H3D takes SI units: stiffness in N/m, damping in N s/m. (Its own default
is relative: 1 is the stiffest that the device can be.) What the nodes have no field for stays out; the swatch's name
and the hash of its file, in the Appearance's metadata, find the whole swatch in the library.

Numbers are written so that they come back to the bit.
"""

import json
import math
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene import __version__
from hapscene.errors import SceneError
from hapscene.exchange.swatch_payload import VERSION, cut_alike, digest_of, fine_told
from hapscene.files import write_whole
from hapscene.scene.body import Body
from hapscene.scene.scene import Scene

BODY, SWATCH = "hapscene body", "hapscene swatch"
"""Names of the MetadataSets."""

WORLD: Final = "hapscene_W"
"""DEF of the Transform around all bodies."""

FIELDS: Final = {
    "stiffness": "stiffness_N_m",
    "damping": "damping_Ns_m",
    "staticFriction": "friction_static",
    "dynamicFriction": "friction_dynamic",
}
"""A swatch's number for each field of H3D's surface nodes."""


def write_x3d(scene: Scene, path: Path) -> list[Path]:
    """Write a scene as X3D.

    Raises:
        SceneError: the file cannot be written.
    """
    from lxml import etree

    root = etree.Element("X3D", profile="Interchange", version="3.3")
    head = etree.SubElement(root, "head")
    etree.SubElement(head, "meta", name="generator", content=f"hapscene {__version__}")
    etree.SubElement(head, "meta", name="hapscene_version", content=str(VERSION))
    turn = f"1 0 0 {-math.pi / 2!r}"
    world = etree.SubElement(etree.SubElement(root, "Scene"), "Transform", DEF=WORLD, rotation=turn)
    seen: dict[Any, str] = {}
    for body in scene.bodies:
        _add_body(world, scene, body, seen)
    for index in range(1, len(scene.swatches)):  # those that no face wears; number 0, plain, is in every scene
        if ("swatch", index) not in seen:
            _add_appearance(etree.SubElement(world, "Shape"), scene, index, seen)
    write_whole(path, etree.tostring(root, encoding="UTF-8", xml_declaration=True, pretty_print=True), SceneError)
    return [path]


def _add_body(world: Any, scene: Scene, body: Body, seen: dict[Any, str]) -> None:
    from lxml import etree

    translation, rotation = _text(body.X_WB[:3, 3]), _text(np.array(axis_angle(body.X_WB[:3, :3])))
    place = etree.SubElement(world, "Transform", translation=translation, rotation=rotation)
    texts = {"name": quoted(body.name)}
    if body.parent is not None:
        texts["parent"] = quoted(body.parent)
    if (fine := fine_told(scene, body)) is not None:
        texts["fine"] = quoted(json.dumps(fine))
    _add_metadata(place, BODY, String=texts, Boolean={"two_sided": str(body.two_sided).lower()})
    for index in np.unique(body.face_swatch):
        key = (*cut_alike(body), body.two_sided, index)
        if key in seen:
            etree.SubElement(place, "Shape", USE=seen[key])
            continue
        seen[key] = f"P{len(seen)}"
        shape = etree.SubElement(place, "Shape", DEF=seen[key])
        _add_appearance(shape, scene, int(index), seen)
        corners, solid = _text(body.mesh.faces[body.face_swatch == index].ravel()), str(not body.two_sided).lower()
        faces = etree.SubElement(shape, "IndexedTriangleSet", index=corners, normalPerVertex="false", solid=solid)
        if id(body.mesh) in seen:
            etree.SubElement(faces, "Coordinate", USE=seen[id(body.mesh)])
        else:
            seen[id(body.mesh)] = f"C{len(seen)}"
            etree.SubElement(faces, "Coordinate", DEF=seen[id(body.mesh)], point=_text(body.mesh.vertices_m.ravel()))


def _add_appearance(shape: Any, scene: Scene, index: int, seen: dict[Any, str]) -> None:
    from lxml import etree

    key = ("swatch", index)
    if key in seen:
        etree.SubElement(shape, "Appearance", USE=seen[key])
        return
    seen[key] = f"S{index}"
    swatch = scene.swatches[index]
    look = etree.SubElement(shape, "Appearance", DEF=seen[key])
    _add_metadata(look, SWATCH, String={"name": quoted(swatch.name), "sha256": quoted(digest_of(swatch))})
    etree.SubElement(look, "Material", diffuseColor=_text(np.array(swatch.albedo_rgb)))
    numbers = swatch.own_numbers
    fields = {field: repr(numbers[name]) for field, name in FIELDS.items()}
    kind = "FrictionalSurface"
    if swatch.friction_static == 0.0:
        kind, fields = "SmoothSurface", {field: fields[field] for field in ("stiffness", "damping")}
    etree.SubElement(look, kind, **fields, useRelativeValues="false")


def _add_metadata(element: Any, name: str, **values: dict[str, str]) -> None:
    """A MetadataSet with values by their kind and name."""
    from lxml import etree

    about = etree.SubElement(element, "MetadataSet", name=name)
    for kind, told in values.items():
        for key, value in told.items():
            etree.SubElement(about, f"Metadata{kind}", containerField="value", name=key, value=value)


def _text(values: NDArray[Any]) -> str:
    return " ".join(map(repr, values.tolist()))


def quoted(text: str) -> str:
    """One string of an MFString."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def axis_angle(R: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """Axis (unit) and angle [rad] of a rotation (3, 3), by way of its quaternion; Shepperd 1978 picks the largest
    of the four components first, so that none is divided by what is near zero."""
    trace = float(np.trace(R))
    squares = np.array([*(1 + 2 * np.diag(R) - trace), 1 + trace])  # four times x², y², z², w²
    k = int(np.argmax(squares))
    if k == 3:
        q = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], squares[3]])
    else:
        i, j = (k + 1) % 3, (k + 2) % 3
        q = np.empty(4)
        q[k], q[i], q[j] = squares[k], R[i, k] + R[k, i], R[j, k] + R[k, j]
        q[3] = R[j, i] - R[i, j]
    sine = float(np.linalg.norm(q[:3]))
    if sine == 0.0:
        return 0.0, 0.0, 1.0, 0.0
    x, y, z = (q[:3] / sine).tolist()
    return x, y, z, 2.0 * math.atan2(sine, float(q[3]))
