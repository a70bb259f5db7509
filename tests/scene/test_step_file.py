"""STEP files: whole ones are read, damaged ones are told, and what crashes their parser is one sentence."""

import itertools
import json
import re
import warnings
from pathlib import Path

import pytest

pytest.importorskip("cascadio", reason="cascadio is not installed: pip install 'hapscene[step]'")

from hapscene.cli import main
from hapscene.errors import MeshError
from hapscene.scene.mesh import MeshWarning
from hapscene.scene.mesh_file import load_mesh
from hapscene.scene.scene import Scene, load_scene
from hapscene.scene.step_file import promised_by

pytestmark = pytest.mark.nightly

PRODUCT = """\
#1=APPLICATION_CONTEXT('design');
#2=APPLICATION_PROTOCOL_DEFINITION('international standard','automotive_design',2000,#1);
#3=PRODUCT_CONTEXT('',#1,'mechanical');
#4=PRODUCT('box','box; it''s #99','',(#3) /* #98; is nobody */);
#5=PRODUCT_DEFINITION_FORMATION('','',#4);
#6=PRODUCT_DEFINITION_CONTEXT('part definition',#1,'design');
#7=PRODUCT_DEFINITION('design','',#5,#6);
#8=PRODUCT_DEFINITION_SHAPE('','',#7);
#9=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.));
#10=(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.));
#11=(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT());
#12=UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-05),#9,'distance_accuracy_value','');
#13=(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT((#12))
GLOBAL_UNIT_ASSIGNED_CONTEXT((#9,#10,#11))REPRESENTATION_CONTEXT('',''));"""

STYLE = "FILL_AREA_STYLE_COLOUR('',{}) FILL_AREA_STYLE('',({})) SURFACE_STYLE_FILL_AREA({}) SURFACE_SIDE_STYLE('',({}))"
STYLE += " SURFACE_STYLE_USAGE(.BOTH.,{}) PRESENTATION_STYLE_ASSIGNMENT(({}))"


def box_step(coloured: bool = False) -> str:
    """A cube of 10 mm; one face may be red."""
    lines = PRODUCT.replace(";\n#", ";\r#").split("\r")

    def put(text: str) -> str:
        lines.append(f"#{len(lines) + 1}={text};")
        return f"#{len(lines)}"

    def point(p: tuple[float, ...]) -> str:
        return put(f"CARTESIAN_POINT('',({10.0 * p[0]},{10.0 * p[1]},{10.0 * p[2]}))")

    def direction(d: tuple[float, ...]) -> str:
        return put(f"DIRECTION('',({float(d[0])},{float(d[1])},{float(d[2])}))")

    corners = list(itertools.product((0, 1), repeat=3))
    vertex = {corner: put(f"VERTEX_POINT('',{point(corner)})") for corner in corners}
    edges: dict[tuple[tuple[int, ...], ...], str] = {}

    def edge(a: tuple[int, ...], b: tuple[int, ...]) -> str:
        if (b, a) in edges:
            return put(f"ORIENTED_EDGE('',*,*,{edges[b, a]},.F.)")
        along = direction(tuple(y - x for x, y in zip(a, b, strict=True)))
        vector = put(f"VECTOR('',{along},1.)")
        line = put(f"LINE('',{point(a)},{vector})")
        edges[a, b] = put(f"EDGE_CURVE('',{vertex[a]},{vertex[b]},{line},.T.)")
        return put(f"ORIENTED_EDGE('',*,*,{edges[a, b]},.T.)")

    faces = []
    for axis, side in itertools.product(range(3), (0, 1)):
        u, v = ((axis + 1) % 3, (axis + 2) % 3)[:: 1 if side else -1]
        ring = []
        for at in ((0, 0), (1, 0), (1, 1), (0, 1)):
            corner = [side] * 3
            corner[u], corner[v] = at
            ring.append(tuple(corner))
        loop = put("EDGE_LOOP('',({}))".format(",".join(edge(ring[k], ring[(k + 1) % 4]) for k in range(4))))
        out, first = ([float(i == k) for i in range(3)] for k in (axis, u))
        frame = f"{point(ring[0])},{direction(tuple(x * (2 * side - 1) for x in out))},{direction(tuple(first))}"
        place = put(f"AXIS2_PLACEMENT_3D('',{frame})")
        plane = put(f"PLANE('',{place})")
        bound = put(f"FACE_OUTER_BOUND('',{loop},.T.)")
        faces.append(put(f"ADVANCED_FACE('',({bound}),{plane},.T.)"))
    shell = put(f"CLOSED_SHELL('',({','.join(faces)}))")
    solid = put(f"MANIFOLD_SOLID_BREP('',{shell})")
    put(f"SHAPE_DEFINITION_REPRESENTATION(#8,{put(f'ADVANCED_BREP_SHAPE_REPRESENTATION($,({solid}),#13)')})")
    if coloured:
        style = put("COLOUR_RGB('',1.,0.,0.)")
        for text in STYLE.split():
            style = put(text.format(style))
        item = put(f"STYLED_ITEM('color',({style}),{faces[0]})")
        put(f"MECHANICAL_DESIGN_GEOMETRIC_PRESENTATION_REPRESENTATION('',({item}),#13)")
    head = "FILE_DESCRIPTION((''),'2;1');\nFILE_NAME('','',(''),(''),'','','');\nFILE_SCHEMA(('AUTOMOTIVE_DESIGN'));"
    data = "\n".join(lines)
    return f"ISO-10303-21;\nHEADER;\n{head}\nENDSEC;\nDATA;\n{data}\nENDSEC;\nEND-ISO-10303-21;\n"


BOX = box_step()


def of(kind: str, which: int = 0) -> str:
    """A statement of that kind."""
    return re.findall(rf"#\d+={kind}\(.*;", BOX)[which]


def named_in(statement: str, which: int) -> str:
    return re.findall(r"#\d+\b", statement)[which]


SHELL, FACE, PLANE = of("CLOSED_SHELL"), of("ADVANCED_FACE", 2), of("PLANE")
VECTOR, VERTEX = of("VECTOR"), of("VERTEX_POINT")
CRASHING = BOX.replace(VECTOR, VECTOR.replace(named_in(VECTOR, 1), named_in(VERTEX, 1)))
"""A vector has a point for a direction, and Open CASCADE falls over it."""

DAMAGED = {
    "a statement is gone": (BOX.replace(PLANE + "\n", ""), "others name, and are not there: 1"),
    "a statement is cut": (BOX.replace(PLANE, PLANE[:-4]), "not whole: 1"),
    "its end is gone": (BOX.replace(PLANE + "\n", PLANE[:-1] + "\n"), "not whole: 1"),
    "the last has no end": (BOX.replace(";\nENDSEC;\nEND-", "\nENDSEC;\nEND-"), "not whole: 1"),
    "a number is another's": (BOX.replace(PLANE, PLANE.replace(named_in(PLANE, 0), "#7", 1)), "twice: 1"),
    "a face is of no shell": (BOX.replace(SHELL, SHELL.replace("," + named_in(SHELL, 3), "")), "faces of no shell: 1"),
    "a face is none": (BOX.replace(FACE, FACE.replace("ADVANCED_FACE", "ADVANCED_FXCE")), "faces without .*: 1 of 6"),
    "the parser says so": (BOX.replace("VERTEX_POINT", "VERTEX^POINT", 1), "Open CASCADE says|not whole"),
}  # fmt: skip


@pytest.fixture
def step(tmp_path: Path):
    def write(text: str) -> Path:
        (tmp_path / "box.step").write_text(text)
        return tmp_path / "box.step"

    return write


def test_a_whole_file_is_read_without_a_word(step, capfd) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mesh = load_mesh(step(BOX))
    assert len(mesh.faces) == 12 and mesh.bounds_m.ravel().tolist() == pytest.approx([0, 0, 0, 0.01, 0.01, 0.01])
    assert capfd.readouterr() == ("", "")


def test_colours_of_faces_are_groups(step) -> None:
    mesh = load_mesh(step(box_step(coloured=True)))
    assert mesh.group_names == ("box/mat_0", "box") or set(mesh.group_names) == {"box; it's #99/mat_0", "box; it's #99"}
    assert sorted(map(tuple, set(map(tuple, mesh.colour_rgb.tolist())))) == [(160, 160, 160), (255, 0, 0)]


@pytest.mark.parametrize("name", DAMAGED)
def test_what_is_damaged_is_told_and_taken_if_asked_for(name: str, step) -> None:
    text, told = DAMAGED[name]
    assert text != BOX
    with pytest.raises(MeshError, match=rf"the file is damaged: .*(?:{told}).*--accept-damaged"):
        load_mesh(step(text))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            assert len(load_mesh(step(text), accept_damaged=True).faces) <= 12
            assert re.search(rf"the file is damaged: .*(?:{told}).*; what is left is taken", str(caught[0].message))
        except MeshError as error:  # or nothing is left, or the parser falls over it
            assert re.search("failed on it|nothing is left", str(error))


def test_a_file_promises_a_closed_body_by_its_shells_alone() -> None:
    """Not where one is open, and not where there is none."""
    whole = box_step()
    assert promised_by(whole.encode(), "box.step").is_closed
    for other in (whole.replace("CLOSED_SHELL", "OPEN_SHELL"), whole.replace("CLOSED_SHELL", "A_SHELL")):
        assert other != whole and not promised_by(other.encode(), "box.step").is_closed


def test_a_closed_shell_that_comes_back_open_is_told(step) -> None:
    text = BOX.replace(VERTEX, VERTEX.replace(named_in(VERTEX, 1), named_in(of("VERTEX_POINT", 1), 1)))
    with pytest.warns(
        MeshWarning, match="may be damaged, and its shape another: points, edges and bounds of nothing: 1"
    ):
        load_mesh(step(text))


@pytest.mark.parametrize("words", [["check"], ["check", "--json"], ["touch"], ["paint", "--no-browser"]])
def test_what_its_parser_crashes_on_is_one_sentence(words: list[str], step, capfd, monkeypatch, tmp_path) -> None:
    if words[0] == "paint":
        pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")
    monkeypatch.chdir(tmp_path)
    assert main([words[0], str(step(CRASHING)), *words[1:]]) == 2
    out, err = capfd.readouterr()
    assert "Open CASCADE failed on it (SIGSEGV): the file is damaged" in err and err.count("\n") == 1
    assert out.count("\n") <= 1 and "\x1b" not in out + err


def test_json_stays_json_while_the_parser_complains(step, capfd) -> None:
    text = BOX.replace(FACE + "\n", "")
    assert main(["check", str(step(text)), "--json", "--accept-damaged"]) in (0, 1)
    out, err = capfd.readouterr()
    assert json.loads(out)["face_count"] == 10
    assert "faces without triangles" in err or "not there: 1" in err


def test_a_scene_of_a_damaged_mesh_is_opened_as_it_was_saved(step, tmp_path) -> None:
    with pytest.warns(MeshWarning, match="is damaged"):
        mesh = load_mesh(step(BOX.replace(FACE + "\n", "")), accept_damaged=True)
    scene = Scene()
    scene.add(mesh)
    scene.save(tmp_path / "box.scene.json")
    with pytest.warns(MeshWarning, match="is damaged"):
        assert load_scene(tmp_path / "box.scene.json").bodies[0].mesh.digest == mesh.digest


def test_a_comment_that_does_not_end_is_damage() -> None:
    promised = promised_by(re.sub(r"(ENDSEC;\s*END-ISO)", r"/* \1", box_step()).encode(), "box.step")
    assert "a comment that does not end" in promised.damage
