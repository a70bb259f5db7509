"""STEP files: the declarations in their text, and the triangles that cascadio (Open CASCADE) makes of them.

cascadio reads a damaged file as a smaller one, and may crash on it. It therefore runs in a separate process
(`hapscene.io.confined`), and its messages and its result are compared with the text: references without a target,
incomplete statements, faces of shells without triangles, closed shells that come back open.
"""

import importlib.util
import re
import tempfile
from collections.abc import Mapping
from typing import Any, BinaryIO, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import FormatError, MeshError
from hapscene.io.confined import confined
from hapscene.io.files import MEMORY_FREE_B, refusing

__all__ = ["faces_in", "promised_by", "step_glb"]

MEMORY_RATIO: Final = 60
"""Memory that Open CASCADE may take for each byte of a file [1]: it takes some 25."""

GLB_MAX_B: Final = 1_000_000_000
"""Most that is taken of it [bytes]: 20 million faces. A short file may say a body that has many more."""

SAID_MAX: Final = 200
"""How much of what it says is told [characters]."""

TIME_S: Final = (10.0, 20e-6)
"""Most time that it may take for any file [s], and for each byte more [s]: it takes a tenth of that."""


class Promised(NamedTuple):
    """What the text of a STEP file promises, and, in words, what is wrong with it and what is odd."""

    face_count: int
    is_closed: bool
    damage: list[str]
    doubts: list[str]


def step_glb(content: bytes, where: str) -> tuple[bytes, list[str]]:
    """A STEP file as GLB, in metres, and what the parser says is wrong with it, in words.

    Raises:
        MeshError: it holds no surface, or cannot be read.
    """
    if importlib.util.find_spec("cascadio") is None:
        raise MeshError(f"{where}: STEP files need one more package: pip install 'hapscene[step]'")
    with refusing(MeshError, where), tempfile.TemporaryFile() as file:
        file.write(content)
        file.seek(0)
        answer = confined(
            read_step,
            file,
            by="Open CASCADE",
            memory_B=MEMORY_FREE_B + MEMORY_RATIO * len(content),
            output_B=GLB_MAX_B,
            time_s=TIME_S[0] + TIME_S[1] * len(content),
            imports=["cascadio"],
        )
    said = _complaints(answer.said)
    return answer.arrays["glb"].tobytes(), [f"Open CASCADE says {said!r}"] if said else []


def read_step(file: BinaryIO) -> Mapping[str, NDArray[Any]]:
    """In the process: a STEP file as the bytes of a GLB."""
    import cascadio

    # its threads would each take memory; the triangles are the same
    glb = cascadio.to_glb_bytes(file.read(), use_parallel=False)
    if not glb:
        raise FormatError("not a readable STEP file, or without a surface in it")
    return {"glb": np.frombuffer(glb, np.uint8)}


def faces_in(triangles: NDArray[Any]) -> int:
    """How many faces of a STEP file are in triangles (n, 3) of one of its parts: each has vertices of its own."""
    high = np.maximum.accumulate(triangles.max(axis=1))
    low = np.minimum.accumulate(triangles.min(axis=1)[::-1])[::-1]
    return 1 + int(np.count_nonzero(high[:-1] < low[1:]))


def _complaints(said: str) -> str:
    """The errors among what Open CASCADE prints: "Unresolved Reference : Fails Count : 5"."""
    errors = [line.partition("ERR")[2].strip(" *") for line in said.splitlines() if "ERR" in line]
    return "; ".join(" ".join(line.split()) for line in errors)[:SAID_MAX]


# The text. ISO 10303-21: statements `#12 = NAME(…);` in sections; strings in '…', a quote in them doubled. No pattern
# looks for an end from each of many beginnings: that would take hours for a hostile file.


_NO_CODE: Final = re.compile(rb"'[^']*'|/\*.*?(?:\*/|\Z)", re.DOTALL)
_DATA: Final = re.compile(rb"\bDATA\s*(?:\([^;]{0,1000}\))?\s*;")
_END: Final = re.compile(rb"\bENDSEC\s*;")
_WHOLE: Final = re.compile(rb"\s*#\d+\s*=\s*[A-Z0-9_!]*\s*\(.*\)\s*", re.DOTALL | re.IGNORECASE)
_DEFINED: Final = re.compile(rb"#(\d+)\s*=")
_NAMED: Final = re.compile(rb"#(\d+)(?!\d|\s*=)")
_SHELL: Final = re.compile(
    rb"\b(?:CLOSED_SHELL|(OPEN_SHELL|CONNECTED_FACE_SET))\s*\((.*)\)\s*\Z", re.DOTALL | re.IGNORECASE
)
_FACE: Final = re.compile(rb"#(\d+)\s*=\s*(?:ADVANCED_FACE|FACE_SURFACE)\b", re.IGNORECASE)
_PIECE: Final = re.compile(
    rb"#(\d+)\s*=\s*(?:CARTESIAN_POINT|VERTEX_POINT|EDGE_CURVE|ORIENTED_EDGE|EDGE_LOOP|FACE_\w*BOUND)\b", re.IGNORECASE
)


def promised_by(content: bytes, where: str) -> Promised:
    """Look through a STEP file's text.

    Raises:
        MeshError: it is no STEP file, or has been cut off.
    """
    if not content.lstrip().startswith(b"ISO-10303-21"):
        raise MeshError(f"{where}: not a readable STEP file: it must begin with ISO-10303-21")
    if b"END-ISO-10303-21" not in content[-1000:]:
        raise MeshError(f"{where}: the file is truncated: a STEP file ends with END-ISO-10303-21")
    text = _NO_CODE.sub(b"''", content)
    parts = [(_DATA.search(part), part) for part in _END.split(text)[:-1]]
    sections = [part[data.end() :].split(b";") for data, part in parts if data]
    statements = [statement for section in sections for statement in section[:-1]]
    damage, doubts = [], []
    if b"END-ISO-10303-21" not in text[-1000:]:
        damage.append("a comment that does not end")
    odd = sum(
        not _WHOLE.fullmatch(statement) or statement.count(b"(") != statement.count(b")") or statement.count(b"=") > 1
        for statement in statements
    ) + sum(bool(section[-1].strip()) for section in sections)
    if odd:
        damage.append(f"statements that are not whole: {odd:,}")
    defined, named = (_numbers(pattern, text) for pattern in (_DEFINED, _NAMED))
    if twice := len(defined) - len(known := np.unique(defined)):
        damage.append(f"statements that are there twice: {twice:,}")
    if gone := np.count_nonzero(~np.isin(np.unique(named), known)):
        damage.append(f"statements that others name, and are not there: {gone:,}")
    found = [_SHELL.search(statement) for statement in statements if statement.rstrip().endswith(b")")]
    shells = [(shell[1], _numbers(_NAMED, shell[2])) for shell in found if shell]
    faces = np.unique(np.concatenate([*(of_shell for _, of_shell in shells), np.zeros(0, np.uint64)]))
    if lost := np.count_nonzero(~np.isin(_numbers(_FACE, text), faces)):
        damage.append(f"faces of no shell: {lost:,}")
    if loose := np.count_nonzero(~np.isin(_numbers(_PIECE, text), named)):
        doubts.append(f"points, edges and bounds of nothing: {loose:,}")
    return Promised(len(faces), bool(shells) and not any(is_open for is_open, _ in shells), damage, doubts)


def _numbers(pattern: re.Pattern[bytes], text: bytes) -> NDArray[np.uint64]:
    """The numbers of statements that a pattern finds; those longer than any program writes are all the same."""
    return np.fromiter((min(int(match[1][:19]), 2**63) for match in pattern.finditer(text)), np.uint64)
