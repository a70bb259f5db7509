"""X3D from strangers."""

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hapscene.errors import HapsceneError, SceneError
from hapscene.exchange import export_scene, import_scene
from hapscene.scene.scene import Scene

pytestmark = pytest.mark.filterwarnings("ignore::hapscene.exchange.swatch_payload.ExchangeWarning")


@pytest.fixture
def file(make_scene: Callable[[int], Scene], tmp_path: Path) -> Path:
    return export_scene(make_scene(0), tmp_path / "small.x3d")[0]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("<X3D ", '<!DOCTYPE X3D [<!ENTITY a "aa">]><X3D ', "DOCTYPE"),
        ("<X3D ", '<!DOCTYPE X3D SYSTEM "file:///etc/passwd"><X3D ', "DOCTYPE"),
        ("</X3D>", "", "not XML"),
        ("X3D", "X4D", "no meta hapscene_version"),
        ('"hapscene_version"', '"other"', "no meta hapscene_version"),
        ('"hapscene_version" content="1"', '"hapscene_version" content="2"', "update hapscene"),
        ('"hapscene_version" content="1"', '"hapscene_version" content="²"', "whole number"),
        ("hapscene_W", "elsewhere", "no body in it"),
        ('"hapscene body"', '"nobody"', "no MetadataSet 'hapscene body'"),
        ('rotation="0.2', 'rotation="nan 0.2', "must be 4 numbers"),
        ('translation="', 'translation="x ', "must be 3 numbers"),
        ('index="', 'index="1.5 ', "must be numbers"),
        ('index="', 'index="7 ', "triples"),
        ('index="', 'index="0 1 99999 ', "names vertex 99999"),
        ('index="', 'index="99999999999999999999 0 1 ', "must be numbers"),
        ('point="', 'point="1 2 1e999 ', "not finite"),
        ('point="', 'point="1 2 ten ', "must be numbers"),
        ('USE="P0"', 'USE="S1"', "no Shape with DEF 'S1'"),
        ('useRelativeValues="false"', 'useRelativeValues="true"', "N/m alone"),
        ("SmoothSurface", "MagneticSurface", "no FrictionalSurface or SmoothSurface"),
        ('<SmoothSurface stiffness="', '<SmoothSurface stiffness="1e400 ', "must be 1 numbers"),
        ('diffuseColor="', 'diffuseColor="1 ', "must be 3 numbers"),
        ('"hapscene swatch"', '"other"', "no MetadataSet 'hapscene swatch'"),
        ('name="sha256"', 'name="sha1"', "expected the swatch's sha256"),
        ("<Coordinate ", "<Coordinates ", "no Coordinate"),
    ],
)
def test_what_is_refused_and_why(old: str, new: str, message: str, file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    assert old in text
    changed = text.replace(old, new) if old in ("X3D", "SmoothSurface", "<Coordinate ") else text.replace(old, new, 1)
    if old == "<Coordinate ":
        changed = changed.replace("</Coordinate>", "</Coordinates>")
    file.write_text(changed, encoding="utf-8")
    with pytest.raises(HapsceneError, match=message):
        import_scene(file)


def test_entities_are_refused_in_utf16_too(file: Path) -> None:
    text = '<?xml version="1.0" encoding="UTF-16"?><!DOCTYPE X3D [<!ENTITY a "aa">]><X3D>&a;</X3D>'
    file.write_bytes(text.encode("utf-16"))
    with pytest.raises(SceneError, match="DOCTYPE"):
        import_scene(file)


def test_a_file_of_tags_alone_is_not_built(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hapscene.exchange.x3d_read.MARK_MAX", 1000)
    file.write_text("<X3D>" + "<a/>" * 1000 + "</X3D>")
    with pytest.raises(SceneError, match="1,002 tags; at most 1,000"):
        import_scene(file)
    file.write_text("<X3D " + " ".join(f"a{i}=''" for i in range(1001)) + "/>")
    with pytest.raises(SceneError, match="1,001 attributes"):
        import_scene(file)


def test_a_small_file_cannot_ask_for_much(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hapscene.exchange.swatch_payload.FACE_MAX", 5000)
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace('<Shape USE="P0"/>', '<Shape USE="P0"/>' * 2000), encoding="utf-8")
    with pytest.raises(SceneError, match="more than 10,000 faces"):
        import_scene(file)


def test_damaged_files_are_refused_in_words(file: Path) -> None:
    good = file.read_bytes()
    rng = np.random.default_rng(5)
    refused = 0
    for _ in range(60):
        bad = np.frombuffer(good, np.uint8).copy()
        bad[rng.integers(0, len(bad), rng.integers(1, 10))] = rng.integers(0, 256)
        file.write_bytes(bad.tobytes()[: int(rng.integers(1, len(bad))) if rng.random() < 0.2 else None])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                import_scene(file)
            except HapsceneError:
                refused += 1
    assert refused > 20
