"""What is compiled is kept on disk, where nobody else may write; damaged, it is compiled anew."""

import importlib
import os
import shutil
import sys
from collections.abc import Callable
from copy import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import config, from_dtype
from numba.core.itanium_mangler import mangle_type

from hapscene import native as module
from hapscene.native import INTERPRETED, compiling_told, inlined, native

pytestmark = pytest.mark.skipif(INTERPRETED, reason="nothing is compiled: NUMBA_DISABLE_JIT")

SOURCE = "def twice(x):\n    return 2.0 * x\n"
POSIX = pytest.mark.skipif(sys.platform == "win32", reason="no such permissions there")


@pytest.fixture
def twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], Any]:
    """Compiles a function of a file as a new process would, its cache in the folder `cache`."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "cache"))
    (tmp_path / "compiled_source.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(tmp_path)

    def compiled() -> Any:
        module._folder.cache_clear()
        monkeypatch.delitem(sys.modules, "compiled_source", raising=False)
        function: Any = native(importlib.import_module("compiled_source").twice)
        assert function(21.0) == 42.0
        return function

    return compiled


def kept_files(tmp_path: Path) -> list[Path]:
    return [file for file in (tmp_path / "cache").rglob("*.nb?")]


def hits(function: Any) -> int:
    return sum(function.stats.cache_hits.values())


def test_what_is_compiled_is_kept(twice: Callable[[], Any], tmp_path: Path) -> None:
    assert hits(twice()) == 0 and hits(twice()) == 1
    assert sorted(file.suffix for file in kept_files(tmp_path)) == [".nbc", ".nbi"]


def test_what_is_inlined_does_the_same_by_itself_and_in_a_caller() -> None:
    """By itself it can be called too: `learn` of a handle is."""

    def doubled(x: float) -> float:
        return 2.0 * x

    part = inlined(doubled)
    assert part(21.0) == native(lambda x: part(x) + part(x))(10.5) == 42.0


def folder_instead(file: Path) -> None:
    file.unlink()
    file.mkdir()


DAMAGE: dict[str, Callable[[Path], object]] = {
    "empty": lambda file: file.write_bytes(b""),
    "truncated": lambda file: file.write_bytes(file.read_bytes()[:-100]),
    "garbage": lambda file: file.write_bytes(os.urandom(3000)),
    "a byte of code": lambda file: file.write_bytes(
        (data := file.read_bytes())[: len(data) // 2] + bytes([data[len(data) // 2] ^ 1]) + data[len(data) // 2 + 1 :]
    ),
    "zeros at the end": lambda file: file.write_bytes(file.read_bytes()[:-512] + bytes(512)),
    "a folder": folder_instead,
    "gone": Path.unlink,
}


@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
@pytest.mark.parametrize("damage", DAMAGE)
def test_what_is_damaged_is_compiled_anew(twice: Callable[[], Any], tmp_path: Path, damage: str, suffix: str) -> None:
    twice()
    (file,) = (file for file in kept_files(tmp_path) if file.suffix == suffix)
    DAMAGE[damage](file)
    assert hits(twice()) == 0
    assert hits(twice()) == (0 if damage == "a folder" else 1)


@POSIX
@pytest.mark.parametrize("place", ["", "hapscene", "hapscene/version"])
def test_where_others_may_write_nothing_is_kept(
    twice: Callable[[], Any], tmp_path: Path, place: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    twice()
    assert [f.stat().st_mode & 0o777 for f in (tmp_path / "cache" / "hapscene").iterdir()] == [0o700]
    (version,) = (tmp_path / "cache" / "hapscene").iterdir()
    open_to_all = version if place.endswith("version") else tmp_path / "cache" / place
    open_to_all.chmod(0o777)
    module._warn_once.cache_clear()
    with pytest.warns(RuntimeWarning, match=f"{open_to_all.name} can be written by others; .*NUMBA_CACHE_DIR"):
        assert hits(twice()) == 0
    open_to_all.chmod(0o1777 if not place else 0o755)  # as /tmp
    assert hits(twice()) == 1


@POSIX
@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root gives files away")
def test_another_users_folder_is_not_trusted(twice: Callable[[], Any], tmp_path: Path) -> None:
    twice()
    shutil.chown(tmp_path / "cache" / "hapscene", 65534)
    module._warn_once.cache_clear()
    with pytest.warns(RuntimeWarning, match="hapscene can be written by others"):
        assert hits(twice()) == 0


def test_compiling_is_told_once(twice: Callable[[], Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(module, "_told", False)
    said: list[str] = []
    with compiling_told(said.append):
        twice()  # somebody else's, which is soon done
        assert said == []
        monkeypatch.setattr(module, "_HERE", tmp_path)
        twice()  # kept
        assert said == []
        for file in kept_files(tmp_path):
            file.unlink()
        twice()
        module._tell_compiling()
    assert said == ["compiling, once; half a minute to two … "]


def test_code_for_a_record_is_named_by_its_layout_whatever_was_compiled_before() -> None:
    long, short = (from_dtype(np.dtype([("k", np.float64, (n,)), ("gain", np.float64)])) for n in (45, 29))
    elsewhere = copy(short)
    elsewhere._code = long._code  # as in a process that met the short one at that place
    assert mangle_type(elsewhere) == mangle_type(short) != mangle_type(long)
