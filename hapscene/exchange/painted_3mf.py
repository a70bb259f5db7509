"""3MF, for slicers and printers: an object for each body at its place, closed as it is, a base material on each face.

trimesh writes no materials, so the model is written here; it is read as any 3MF file (`hapscene.scene.mesh_file`).
"""

import io
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final
from xml.sax.saxutils import quoteattr

import numpy as np

from hapscene import __version__
from hapscene.errors import SceneError
from hapscene.exchange.cut_faces import cut_faces
from hapscene.files import write_whole
from hapscene.scene.body import Body
from hapscene.scene.scene import Scene

_HEAD: Final = '<?xml version="1.0" encoding="UTF-8"?>\n'
_PACKAGE: Final = "http://schemas.openxmlformats.org/package/2006"
_CORE: Final = "http://schemas.microsoft.com/3dmanufacturing"

_PARTS: Final = {
    "[Content_Types].xml": f'{_HEAD}<Types xmlns="{_PACKAGE}/content-types"><Default Extension="rels" '
    'ContentType="application/vnd.openxmlformats-package.relationships+xml"/><Default Extension="model" '
    'ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>',
    "_rels/.rels": f'{_HEAD}<Relationships xmlns="{_PACKAGE}/relationships"><Relationship Target="/3D/3dmodel.model" '
    f'Id="model" Type="{_CORE}/2013/01/3dmodel"/></Relationships>',
}


def write_3mf(scene: Scene, path: Path) -> list[Path]:
    """Write a scene as 3MF, in metres.

    Raises:
        SceneError: the file cannot be written.
    """
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in {**_PARTS, "3D/3dmodel.model": "".join(_model(scene))}.items():
            archive.writestr(zipfile.ZipInfo(name), text, zipfile.ZIP_DEFLATED)  # without the date
    write_whole(path, packed.getvalue(), SceneError)
    return [path]


def _model(scene: Scene) -> Iterator[str]:
    yield f'{_HEAD}<model unit="meter" xmlns="{_CORE}/core/2015/02">\n'
    yield f'<metadata name="Application">hapscene {__version__}</metadata>\n<resources>\n<basematerials id="1">\n'
    for swatch in scene.swatches:
        colour = "".join(f"{round(255 * c):02X}" for c in swatch.albedo_rgb)
        yield f'<base name={quoteattr(swatch.name)} displaycolor="#{colour}"/>\n'
    yield "</basematerials>\n"
    for number, body in enumerate(scene.bodies, 2):
        yield from _object(number, body)
    yield "</resources>\n<build>\n"
    for number, body in enumerate(scene.bodies, 2):
        rows = " ".join(map(repr, body.X_WB[:3].T.ravel().tolist()))  # of a row vector's matrix
        yield f'<item objectid="{number}" transform="{rows}"/>\n'
    yield "</build>\n</model>\n"


def _object(number: int, body: Body) -> Iterator[str]:
    vertices_m, faces, swatch = cut_faces(body)
    most = np.bincount(swatch).argmax()
    yield f'<object id="{number}" name={quoteattr(body.name)} type="model" pid="1" pindex="{most}">\n'
    yield "<mesh>\n<vertices>\n"
    yield from (f'<vertex x="{x!r}" y="{y!r}" z="{z!r}"/>\n' for x, y, z in vertices_m.tolist())
    yield "</vertices>\n<triangles>\n"
    rows = np.column_stack([faces, swatch]).tolist()
    yield from (f'<triangle v1="{a}" v2="{b}" v3="{c}" pid="1" p1="{worn}"/>\n' for a, b, c, worn in rows)
    yield "</triangles>\n</mesh>\n</object>\n"
