"""Declarations in STEP files; `tests/nightly/scene` reads files with Open CASCADE."""

import numpy as np
import pytest

from hapscene.errors import MeshError
from hapscene.scene.step_file import declared_by, faces_in

STATEMENTS = """#1=CARTESIAN_POINT('a; #99 /* no comment */',(0.,0.,0.));
#2=VERTEX_POINT('',#1);
#3=ADVANCED_FACE('',(#2),$,.T. /* #98; in a comment */);
#4=ADVANCED_FACE('',(#2),$,.T.);
#5=CLOSED_SHELL('',(#3,#4));
"""


def promised(statements: str):
    return declared_by(
        f"ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\n{statements}ENDSEC;\nEND-ISO-10303-21;\n".encode(), "x"
    )


def test_intact_file() -> None:
    assert promised(STATEMENTS) == (2, True, [])
    assert not promised(STATEMENTS.replace("CLOSED_SHELL", "OPEN_SHELL")).is_closed
    assert not promised("").is_closed


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("#2=VERTEX_POINT('',#1);\n", ""),
        ("(#3,#4));", "(#3,#4)"),
        ("#4=ADV", "#3=ADV"),
        ("(#3,#4)", "(#3)"),
        ("#5=", "/* #5="),
        ("#4=ADVANCED_FACE('',(#2),", "#4=ADVANCED_FACE('',(#2,"),
    ],
    ids=["missing", "no end", "twice", "outside the shell", "comment without an end", "bracket"],
)
def test_damage_is_found(old: str, new: str) -> None:
    assert promised(STATEMENTS.replace(old, new)).damage


@pytest.mark.parametrize("content", [b"solid x", b"ISO-10303-21;\nHEADER;\n"])
def test_other_and_truncated_files_raise(content: bytes) -> None:
    with pytest.raises(MeshError, match="part"):
        declared_by(content, "part.step")


def test_faces_are_counted_by_their_vertices() -> None:
    one, two, three = [[0, 1, 2], [0, 2, 3]], [[4, 5, 6]], [[7, 8, 9], [9, 8, 10]]
    assert [faces_in(np.array(part)) for part in (one, one + two, one + two + three)] == [1, 2, 3]
