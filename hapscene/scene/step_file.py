"""STEP files: the declarations in their text, and triangulation by cascadio (Open CASCADE).

cascadio silently skips damaged parts of a file and may crash. It therefore runs in a separate process
(`hapscene.io.confined`), and its messages and its result are compared with the text of the file: references without a
target, incomplete statements, faces of shells without triangles, closed shells that come back open.
"""

import importlib.util
import re
import tempfile
from collections.abc import Mapping
from typing import BinaryIO, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import FormatError, MeshError
from hapscene.io.confined import confined
from hapscene.io.files import MEMORY_FREE_B, refusing

__all__ = ["declared_by", "faces_in", "step_glb"]

MEMORY_RATIO: Final = 60
"""Maximum memory of Open CASCADE for each byte of a file [1]; it uses about 25."""

GLB_MAX_B: Final = 1_000_000_000
"""Maximum size of the result [bytes]: 20 million faces. A short file can describe a body with many more."""

SAID_MAX: Final = 200
"""Maximum length of its messages [characters]."""

TIME_S: Final = (10.0, 20e-6)
"""Maximum time for any file [s], plus time for each byte [s]; it uses about a tenth."""


class Declared(NamedTuple):
    """Declarations in the text of a STEP file, and descriptions of its damage."""

    face_count: int
    is_closed: bool
    damage: list[str]


def step_glb(content: bytes, where: str) -> tuple[bytes, list[str]]:
    """Convert a STEP file to GLB in metres; also return descriptions of errors that the parser reported.

    Raises:
        MeshError: the file has no surface or cannot be read, or cascadio is not installed.
    """
    if importlib.util.find_spec("cascadio") is None:
        raise MeshError(f"{where}: STEP files need another package: pip install 'hapscene[step]'")
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
    errors = _errors(answer.output)
    return answer.arrays["glb"].tobytes(), [f"Open CASCADE reports {errors!r}"] if errors else []


def read_step(file: BinaryIO) -> Mapping[str, NDArray[np.generic]]:
    """Convert a STEP file to the bytes of a GLB file; runs in the separate process."""
    import cascadio

    # single-threaded: each thread would take more memory, and the result is the same
    glb = cascadio.to_glb_bytes(file.read(), use_parallel=False)
    if not glb:
        raise FormatError("not a valid STEP file, or it contains no surface")
    return {"glb": np.frombuffer(glb, np.uint8)}


def faces_in(triangles: NDArray[np.generic]) -> int:
    """Count the STEP faces in triangles (n, 3) of one part: each face has separate vertices."""
    high = np.maximum.accumulate(triangles.max(axis=1))
    low = np.minimum.accumulate(triangles.min(axis=1)[::-1])[::-1]
    return 1 + int(np.count_nonzero(high[:-1] < low[1:]))


def _errors(output: str) -> str:
    """Extract the errors from the output of Open CASCADE, such as "Unresolved Reference : Fails Count : 5"."""
    errors = [line.partition("ERR")[2].strip(" *") for line in output.splitlines() if "ERR" in line]
    return "; ".join(" ".join(line.split()) for line in errors)[:SAID_MAX]


# ISO 10303-21: sections of statements `#12 = NAME(…);` with strings in '…', in which a quote is doubled. No pattern
# searches for an end from each of many starts, which would take hours on a malicious file.


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


def declared_by(content: bytes, where: str) -> Declared:
    """Analyse the text of a STEP file. Raises MeshError: not a STEP file, or truncated."""
    if not content.lstrip().startswith(b"ISO-10303-21"):
        raise MeshError(f"{where}: not a valid STEP file: it must begin with ISO-10303-21")
    if b"END-ISO-10303-21" not in content[-1000:]:
        raise MeshError(f"{where}: truncated: a STEP file must end with END-ISO-10303-21")
    text = _NO_CODE.sub(b"''", content)
    parts = [(_DATA.search(part), part) for part in _END.split(text)[:-1]]
    sections = [part[data.end() :].split(b";") for data, part in parts if data]
    statements = [statement for section in sections for statement in section[:-1]]
    damage = []
    if b"END-ISO-10303-21" not in text[-1000:]:
        damage.append("an unterminated comment")
    incomplete = sum(
        not _WHOLE.fullmatch(statement) or statement.count(b"(") != statement.count(b")") or statement.count(b"=") > 1
        for statement in statements
    ) + sum(bool(section[-1].strip()) for section in sections)
    if incomplete:
        damage.append(f"{incomplete:,} incomplete statements")
    defined, named = (_numbers(pattern, text) for pattern in (_DEFINED, _NAMED))
    if twice := len(defined) - len(known := np.unique(defined)):
        damage.append(f"{twice:,} duplicate statements")
    if gone := np.count_nonzero(~np.isin(np.unique(named), known)):
        damage.append(f"{gone:,} references to missing statements")
    found = [_SHELL.search(statement) for statement in statements if statement.rstrip().endswith(b")")]
    shells = [(shell[1], _numbers(_NAMED, shell[2])) for shell in found if shell]
    faces = np.unique(np.concatenate([*(of_shell for _, of_shell in shells), np.zeros(0, np.uint64)]))
    if lost := np.count_nonzero(~np.isin(_numbers(_FACE, text), faces)):
        damage.append(f"{lost:,} faces that belong to no shell")
    return Declared(len(faces), bool(shells) and not any(is_open for is_open, _ in shells), damage)


def _numbers(pattern: re.Pattern[bytes], text: bytes) -> NDArray[np.uint64]:
    """Return the statement numbers that a pattern matches; numbers too long for any real file become equal."""
    return np.fromiter((min(int(match[1][:19]), 2**63) for match in pattern.finditer(text)), np.uint64)
