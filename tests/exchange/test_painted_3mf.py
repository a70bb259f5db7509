"""3MF as it is written, for others too, and the materials of anybody's as they are read."""

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh

from hapscene.exchange import export_scene, import_scene
from hapscene.scene.mesh_file import load_mesh
from hapscene.scene.region import Sphere
from hapscene.scene.scene import Scene

CORE = "http://schemas.microsoft.com/3dmanufacturing"


def test_others_find_closed_objects_at_their_places(tmp_path: Path) -> None:
    scene = Scene()
    X = trimesh.transformations.rotation_matrix(1.0, (1, 2, 3))
    X[:3, 3] = 0.1, 0.2, 0.3
    scene.add(trimesh.creation.box((0.04, 0.03, 0.02)), name='a "box" <&>', unit="m", pose=X)
    scene.add(trimesh.creation.icosphere(radius=0.02), name="ball", unit="m", swatch="wood")
    scene.paint('a "box" <&>', "leather", Sphere((0.0, 0.0, 0.01), 0.005), finest_m=1e-3)
    export_scene(scene, tmp_path / "a.3mf")
    loaded = trimesh.load_scene(tmp_path / "a.3mf", process=False)
    assert loaded.units == "meter"
    shapes = loaded.geometry
    assert set(shapes) == {'a "box" <&>', "ball"} and all(shape.is_watertight for shape in shapes.values())
    box = shapes['a "box" <&>'].copy()
    assert len(box.faces) > 100
    box.apply_transform(loaded.graph['a "box" <&>'][0])
    assert box.volume == pytest.approx(0.04 * 0.03 * 0.02) and box.center_mass == pytest.approx([0.1, 0.2, 0.3])
    back = import_scene(tmp_path / "a.3mf").bodies[0]
    assert set(back.mesh.group_names) == {'a "box" <&>/plain', 'a "box" <&>/leather', "ball/wood"}
    assert back.mesh.colour_rgb is not None and len(np.unique(back.mesh.colour_rgb, axis=0)) == 3


def model(triangles: str, resources: str = "", of_object: str = "") -> bytes:
    """A tetrahedron in mm, in a 3MF file."""
    corners = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in [(0, 0, 0), (9, 0, 0), (0, 9, 0), (0, 0, 9)])
    text = (
        f'<model unit="millimeter" xmlns="{CORE}/core/2015/02" xmlns:m="{CORE}/material/2015/02"><resources>{resources}'
        f'<object id="7" name="tetra" type="model" {of_object}><mesh><vertices>{corners}</vertices>'
        f'<triangles>{triangles}</triangles></mesh></object></resources><build><item objectid="7"/></build></model>'
    )
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("3D/3dmodel.model", text)
    return packed.getvalue()


BASES = (
    '<basematerials id="1"><base name="wood" displaycolor="#102030"/><base name="b" displaycolor="#FF0000FF"/>'
    '</basematerials><m:colorgroup id="2"><m:color color="#00ff00"/></m:colorgroup>'
)


@pytest.mark.parametrize(
    ("marks", "of_object", "names", "colours"),
    [
        (['pid="1" p1="0"', 'pid="1" p1="1"', ""], 'pid="1" pindex="1"', "wood b b", [0x10, 0xFF, 0xFF]),
        (['pid="2" p1="0"'] * 3, "", "", [0, 0, 0]),
        ([""] * 3, "", "", None),
        (['pid="1" p1="99"', 'pid="8" p1="0"', 'pid="1" p1="x"'], "", "", None),
        (['p1="0"', 'p1="-1"', f'p1="{"9" * 4000}"'], 'pid="1"', "wood - -", None),
    ],
)
def test_materials_of_anybody(
    marks: list[str], of_object: str, names: str, colours: list[int] | None, tmp_path: Path
) -> None:
    corners = ((0, 2, 1), (0, 1, 3), (1, 2, 3))
    triangles = "".join(
        f'<triangle v1="{a}" v2="{b}" v3="{c}" {mark}/>' for (a, b, c), mark in zip(corners, marks, strict=True)
    )
    (tmp_path / "a.3mf").write_bytes(model(triangles, BASES, of_object))
    mesh = load_mesh(tmp_path / "a.3mf")
    found = [mesh.group_names[i] for i in mesh.group]
    assert found == [f"tetra/{name}" if name != "-" else "tetra" for name in names.split() or "---"]
    assert (None if mesh.colour_rgb is None else mesh.colour_rgb[:, 0].tolist()) == colours
