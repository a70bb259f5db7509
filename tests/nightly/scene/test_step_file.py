"""STEP files with Open CASCADE: intact, damaged and crashing files."""

import time
import warnings
from pathlib import Path

import pytest

pytest.importorskip("cascadio", reason="cascadio is not installed: pip install 'hapscene[step]'")

from hapscene.cli import main
from hapscene.errors import MeshError
from hapscene.scene.mesh import MeshWarning
from hapscene.scene.mesh_file import load_mesh
from hapscene.scene.step_file import declared_by
from tests.nightly.fuzz import formats

BOX = (
    formats.step()["x.step"]
    .decode()
    .replace("'cube','cube','',(#58)", "'box; it''s #99','',(#58) /* #98; is undefined */")
)
"""A cube of 9 mm."""

STYLE = """#65=COLOUR_RGB('',1.,0.,0.);
#66=FILL_AREA_STYLE_COLOUR('',#65);
#67=FILL_AREA_STYLE('',(#66));
#68=SURFACE_STYLE_FILL_AREA(#67);
#69=SURFACE_SIDE_STYLE('',(#68));
#70=SURFACE_STYLE_USAGE(.BOTH.,#69);
#71=PRESENTATION_STYLE_ASSIGNMENT((#70));
#72=STYLED_ITEM('color',(#71),#15);
#73=MECHANICAL_DESIGN_GEOMETRIC_PRESENTATION_REPRESENTATION('',(#72),#54);
"""

FACE, PLANE, END = "#29=FACE_SURFACE('',(#24),#28,.T.);\n", "#14=PLANE('',#13);\n", ";\nENDSEC;\nEND-"
CRASHING = BOX.replace("#3,#4,#8,#7", "#3,#11,#8,#7")
"""A corner is a direction, and Open CASCADE crashes."""

DAMAGED = {
    "missing statement": BOX.replace(PLANE, ""),
    "truncated statement": BOX.replace(PLANE, PLANE[:-4]),
    "no end of the last": BOX.replace(END, END[1:]),
    "number given twice": BOX.replace(PLANE, PLANE.replace("#14", "#7")),
    "face outside the shell": BOX.replace("#22,#29,", "#22,"),
    "face not read": BOX.replace(FACE, FACE.replace("FACE_SURFACE", "FACE_SXRFACE")),
}


@pytest.fixture
def step(tmp_path: Path):
    def write(text: str) -> Path:
        (tmp_path / "box.step").write_text(text)
        return tmp_path / "box.step"

    return write


def test_intact_file(step, capfd) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mesh = load_mesh(step(BOX))
    assert len(mesh.faces) == 12 and mesh.bounds_m.ravel().tolist() == pytest.approx([0, 0, 0, 0.009, 0.009, 0.009])
    assert capfd.readouterr() == ("", "")


def test_colours_are_groups(step) -> None:
    mesh = load_mesh(step(BOX.replace(END, ";\n" + STYLE.rstrip(";\n") + END)))
    assert len(mesh.group_names) == 2
    assert set(map(tuple, mesh.colour_rgb.tolist())) == {(160, 160, 160), (255, 0, 0)}


@pytest.mark.parametrize("name", DAMAGED)
def test_damaged_file_raises(name: str, step) -> None:
    text = DAMAGED[name]
    assert text != BOX
    with pytest.raises(MeshError, match="damaged"):
        load_mesh(step(text))


def test_open_shell_warns(step) -> None:
    with pytest.warns(MeshWarning):
        load_mesh(step(BOX.replace("#1,#2,#4,#3", "#1,#2,#4,#4")))


@pytest.mark.parametrize("words", [["check"], ["touch"]])
def test_crash_of_the_parser_is_one_error(words: list[str], step, capfd, monkeypatch, tmp_path) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([words[0], str(step(CRASHING)), *words[1:]]) == 2
    out, err = capfd.readouterr()
    assert "SIGSEGV" in err and err.count("\n") == 1
    assert out.count("\n") <= 1 and "\x1b" not in out + err


@pytest.mark.parametrize("beginning", ["/* ", "DATA;", "DATA(", "CLOSED_SHELL(", "CLOSED_SHELL()", "#1 ", "'", "#1=A("])
def test_malicious_text_takes_linear_time(beginning: str) -> None:
    text = f"ISO-10303-21;HEADER;ENDSEC;DATA;{beginning * (200_000 // len(beginning))}END-ISO-10303-21;"
    start_s = time.process_time()
    declared_by(text.encode(), "hostile.step")
    assert time.process_time() - start_s < 2.0
