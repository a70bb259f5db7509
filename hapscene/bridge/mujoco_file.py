"""Loading of MuJoCo files, which may be untrusted: MuJoCo compiles them in a separate process (`hapscene.io.confined`).

MuJoCo crashes on a height field of 2³¹ rows, and `<replicate count="1000000000">` never ends. The process imports
this module, which therefore imports little.
"""

import importlib.util
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Final
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import FormatError, SceneError
from hapscene.io.confined import confined
from hapscene.io.files import refusing

if TYPE_CHECKING:
    import mujoco

__all__ = ["check_installed", "load_model"]

MEMORY_MAX_B: Final = 4_000_000_000
"""Memory limit for compiling a file, and for the model [bytes]."""

TIME_MAX_S: Final = 30.0
"""Time limit for compiling a file [s]; most take less than one."""

COPIES_MAX: Final = 100_000
"""Maximum number of copies that nested <replicate> elements make [count]: MuJoCo compiles 2,500 per second."""


def load_model(path: str | os.PathLike[str]) -> "mujoco.MjModel":
    """Load a `mujoco.MjModel` from an MJCF or URDF file.

    Raises:
        SceneError: MuJoCo is not installed, or refuses the file.
    """
    where = os.fspath(path)
    check_installed(f"{where}: ")
    import mujoco

    limits: Any = {"memory_B": MEMORY_MAX_B, "output_B": MEMORY_MAX_B, "time_s": TIME_MAX_S, "imports": ["mujoco"]}
    with refusing(SceneError, where):
        try:
            with Path(path).open("rb") as file:
                made = confined(compile_model, file, where, by="MuJoCo", **limits).arrays["model"]
        except OSError as error:
            raise SceneError(f"cannot be read: {error.strerror}") from None
    return mujoco.MjModel.from_binary_path("model.mjb", {"model.mjb": made.tobytes()})


def compile_model(file: BinaryIO, path: str) -> Mapping[str, NDArray[np.generic]]:
    """Compile a model to MuJoCo's binary format, in the separate process. File names in it are relative to its own
    folder."""
    import mujoco

    _check_copies(file)
    try:
        model = mujoco.MjModel.from_xml_path(path)
    except (ValueError, RuntimeError) as error:
        raise FormatError(f"error of MuJoCo: {' '.join(str(error).split())!r}") from None
    made = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, made)
    return {"model": made}


def _check_copies(file: BinaryIO) -> None:
    """Raise FormatError if the <replicate> elements of a file make too many copies."""
    copies = [1]  # of the elements that are open, from the outermost to the innermost
    try:
        for event, element in ElementTree.iterparse(file, events=("start", "end")):
            if event == "end":
                copies.pop()
                continue
            count = element.get("count", "1").strip() if element.tag == "replicate" else "1"
            copies.append(copies[-1] * int(count[:20]) if count.isdecimal() else copies[-1])
            if copies[-1] > COPIES_MAX:
                raise FormatError(f"<replicate> makes {copies[-1]:,} copies; expected at most {COPIES_MAX:,}")
    except ElementTree.ParseError:
        return  # MuJoCo reports it


def check_installed(where: str) -> None:
    """Raise SceneError if MuJoCo is not installed."""
    if importlib.util.find_spec("mujoco") is None:
        raise SceneError(f"{where}MuJoCo is not installed; run: pip install 'hapscene[mujoco]'")
