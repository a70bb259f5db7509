"""Swatches in files of other formats."""

from dataclasses import replace
from pathlib import Path

import pytest

from hapscene.errors import SceneError, SwatchError
from hapscene.exchange.swatch_payload import (
    ExchangeWarning,
    check_version,
    digest_of,
    is_digest,
    known_swatch,
    restore,
)
from hapscene.surface.swatch import PLAIN, Swatch
from hapscene.surface.swatch_file import save_swatch, swatch_to_json
from hapscene.swatches import library
from hapscene.swatches.library import load_swatch

FILE = Path("desk.ply")


def restored(swatch: Swatch, text: str | None = None) -> Swatch | str:
    return restore(FILE, swatch.name, digest_of(swatch), text)


def test_identical_swatch_of_the_library_is_used() -> None:
    assert restored(load_swatch("wood")) == "wood"
    assert restored(PLAIN) is PLAIN


def test_swatch_added_later_is_found(own_library: Path) -> None:
    mine = replace(load_swatch("wood"), name="mine", stiffness_N_m=321.0)
    with pytest.warns(ExchangeWarning, match="mine"):
        assert restored(mine) is PLAIN
    library.add(mine)
    assert restored(mine) == "mine"


def test_embedded_swatch_takes_precedence() -> None:
    other = replace(load_swatch("wood"), stiffness_N_m=321.0)
    back = restored(other, swatch_to_json(other))
    assert isinstance(back, Swatch) and swatch_to_json(back) == swatch_to_json(other)
    with pytest.warns(ExchangeWarning, match="wood"):
        assert restored(other) == "wood"


def test_name_never_opens_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    mine = replace(load_swatch("wood"), name="x")
    save_swatch(mine, tmp_path / "x.swatch")
    assert known_swatch("x") is None
    monkeypatch.setattr("hapscene.exchange.swatch_payload.load_swatch", lambda name: mine)
    for name in ("x.swatch", "./x", str(tmp_path / "x.swatch"), "..\\x"):
        assert known_swatch(name) is None


@pytest.mark.parametrize("text", ["{}", swatch_to_json(PLAIN)])
def test_invalid_swatch_raises(text: str) -> None:
    with pytest.raises(SwatchError, match="odd"):
        restore(FILE, "odd", "0" * 64, text)


@pytest.mark.parametrize("version", [0, "1", None, 1.5, True, 2, 10**30])
def test_invalid_version_raises(version: object) -> None:
    with pytest.raises(SceneError):
        check_version(FILE, version)
    check_version(FILE, 1.0)


def test_a_digest_has_64_digits() -> None:
    assert [is_digest(text) for text in ("0a" * 32, "0a" * 31, "0A" * 32, 5, None)] == [True, *4 * [False]]
