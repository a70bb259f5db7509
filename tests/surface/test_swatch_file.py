"""Swatches on disk: back to the bit, and nothing bad gets in."""

import json
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapscene.dsp.ar_filter import ar_from_reflection
from hapscene.errors import SwatchError
from hapscene.surface import swatch_file
from hapscene.surface.gain_modulation import GainModulation
from hapscene.surface.swatch import PLAIN, Swatch
from hapscene.surface.swatch_file import SwatchWarning, save_swatch, swatch_from_json, swatch_to_json
from hapscene.surface.taps import TAP_ROWS, Taps
from hapscene.surface.texture import Texture
from hapscene.swatches.library import load_swatch, shipped_swatches


def make_swatch(seed: int = 0) -> Swatch:
    rng = np.random.default_rng(seed)
    a = ar_from_reflection(rng.uniform(-0.5, 0.5, (3, 12)))
    texture = Texture.from_models(
        1e4 / 3, rng.uniform(1, 2, 3), rng.uniform(0.1, 0.2, 3), a=a, variance_m2_s4=rng.uniform(0, 1, 3), warp=2 / 3,
        exponents=rng.uniform(0, 2, 2), modulation=GainModulation([0.3, 1 / 3], [7.0, 0.0], [0.0, 1e3 / 7]),
    )  # fmt: skip
    waves = rng.standard_normal((2, 5))
    taps = Taps([0.1, 1 / 3], rng.uniform(0, 9, 2), rng.uniform(50, 200, 2), rng.uniform(50, 200, 2), waves, 1e4 / 3)
    return Swatch(
        "Eiche №1", 1000 / 3, 0.1, 0.3, 0.2, texture, taps, (0.1, 1 / 3, 1.0), "“made up”\n", "MIT", {"x": {"y": 0.1}},
        {"friction_dynamic": (0.1, 1 / 3)}, {"stiffness_N_m": "no “depth”"}, *rng.uniform(0, 1, 8), leaving=taps,
    )  # fmt: skip


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_files_are_lossless(seed: int) -> None:
    swatch = make_swatch(seed)
    again = swatch_from_json(swatch_to_json(swatch))
    assert again == swatch
    assert swatch_to_json(again) == swatch_to_json(swatch)


def test_saved_file_is_readable(tmp_path: Path) -> None:
    path = tmp_path / "oak.swatch"
    save_swatch(PLAIN, path)
    save_swatch(make_swatch(), path)
    assert load_swatch(path) == load_swatch(str(path)) == make_swatch()
    assert [p.name for p in tmp_path.iterdir()] == ["oak.swatch"]
    assert '"stiffness_N_m": 333.3333333333333,\n' in path.read_text(encoding="utf-8")


def test_version_1_is_read() -> None:
    content = json.loads(swatch_to_json(make_swatch()))
    for key in ("warp", "exponents", "life"):
        del content["texture"][key]
    plain = swatch_from_json(json.dumps(content))
    assert plain.texture is not None and plain.texture.modulation is None and plain.texture.warp == 0.0
    content["version"], content["texture"]["excitation"] = 1, [-1.0, 0.0, 1.0]
    assert swatch_from_json(json.dumps(content)) == plain


@pytest.mark.parametrize("name", ["oak.json", "no/oak.swatch"])
def test_a_file_that_cannot_be_written(tmp_path: Path, name: str) -> None:
    with pytest.raises(SwatchError, match="oak"):
        save_swatch(PLAIN, tmp_path / name)


@pytest.mark.parametrize("name", ["missing.swatch", ".", "a\0b.swatch", "x" * 10_000 + ".swatch"])
def test_a_file_that_cannot_be_read(tmp_path: Path, name: str) -> None:
    with pytest.raises(SwatchError):
        load_swatch(tmp_path / name)


def test_unreadable_text_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(SwatchError, match="provenance"):
        save_swatch(Swatch("long", provenance="a" * (swatch_file.TEXT_MAX + 1)), tmp_path / "long.swatch")
    assert not list(tmp_path.iterdir())


def test_shipped_swatches_have_provenance() -> None:
    assert {"wood", "paper", "leather", "epoxy"} <= set(shipped_swatches())
    for name in shipped_swatches():
        swatch = load_swatch(name)
        assert swatch.name == name
        assert swatch.texture is not None and swatch.taps is not None
        assert "commit" in swatch.provenance and "Assumed" in swatch.provenance and swatch.licence


def edit(path: tuple[str | int, ...], value: object) -> str:
    """The text of a good swatch with one value changed."""
    content = json.loads(swatch_to_json(make_swatch()))
    place = content
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return json.dumps(content)


BAD = {
    "truncated": (swatch_to_json(make_swatch())[:2000], "line"),
    "binary": (b"\x80\x04\x95\xff\x00", ""),
    "deep": ("[" * 200_000, ""),
    "list": ("[1, 2]", "format"),
    "later version": (edit(("version",), 5), "version 5"),
    "no version": (edit(("version",), None), "version"),
    "NaN": (edit(("damping_Ns_m",), float("nan")), "NaN"),
    "overflow": (swatch_to_json(PLAIN).replace("500.0", "1e999"), "stiffness_N_m"),
    "huge integer": (swatch_to_json(PLAIN).replace("500.0", "9" * 5000), ""),
    "400 digits": (edit(("stiffness_N_m",), 10**400), "stiffness_N_m"),
    "half of a surrogate pair": (edit(("\ud800",), 1), ""),
    "unknown key": (edit(("stifness_N_m",), 1.0), "stifness_N_m"),
    "long key": (edit(("x\n" * 1000,), 1.0), ""),
    "unknown texture key": (edit(("texture", "ar"), []), "texture"),
    "twice": ('{"format": "hapscene swatch", "version": 1, "name": "a", "name": "b"}', "'name'"),
    "no name": ('{"format": "hapscene swatch", "version": 1}', "name"),
    "colour": (edit(("albedo_rgb",), [1, 1]), "albedo_rgb"),
    "effect": (edit(("effects", "x\n"), {}), "effects"),
    "long text": (edit(("licence",), "a" * (swatch_file.TEXT_MAX + 1)), "licence"),
    "unstable": (edit(("texture", "lsf_rad", 1, 0), 3.0), "model 1"),
    "ragged": (edit(("texture", "lsf_rad", 1), [1.0]), "texture.lsf_rad"),
    "triangle fraction": (edit(("texture", "triangles", 0, 0), 0.5), "triangles[0][0]"),
    "waves without rate": (
        edit(("taps",), {k: [1.0] for k in TAP_ROWS} | {"wave_m_s2": [[1.0]]}),
        "wave_rate_Hz",
    ),
    "interval": (edit(("intervals", "stiffness_N_m"), [2.0, 1.0]), "intervals.stiffness_N_m"),
    "reasons": (edit(("absent",), {str(i): "" for i in range(5000)}), "absent"),
}


@pytest.mark.parametrize("case", BAD)
def test_an_invalid_file_is_one_line_that_names_the_file_and_the_field(case: str, tmp_path: Path) -> None:
    text, field = BAD[case]
    path = tmp_path / "bad.swatch"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(SwatchError) as caught:
        load_swatch(path)
    assert str(path) in str(caught.value) and field in str(caught.value)
    assert len(str(caught.value)) < 300 + len(str(path)) and "\n" not in str(caught.value)


def test_a_file_that_is_too_large_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "large.swatch"
    with path.open("wb") as f:
        f.truncate(1 << 33)  # sparse
    with pytest.raises(SwatchError):
        load_swatch(path)
    monkeypatch.setattr(swatch_file, "BYTES_MAX", 100)
    save_swatch(PLAIN, path)
    with pytest.raises(SwatchError):
        load_swatch(path)


def test_tool_and_tip_need_version_4() -> None:
    swatch = replace(make_swatch(), tool="steel probe", tip="3.2 mm ball")
    text = swatch_to_json(swatch)
    assert '"version": 4' in text and swatch_from_json(text) == swatch
    assert '"version": 2' in swatch_to_json(make_swatch()) and '"tool"' not in swatch_to_json(make_swatch())
    assert swatch_from_json(swatch_to_json(make_swatch())).tool == ""
    for bad in ("a\nb", "x" * 201):
        with pytest.raises(SwatchError, match="tip"):
            replace(PLAIN, tip=bad)


@pytest.mark.parametrize("kind", ["state", "layers"])
def test_regimes_and_layers_are_ignored_with_a_warning(kind: str) -> None:
    swatch = replace(make_swatch(), tool="steel probe")
    content = json.loads(swatch_to_json(swatch))
    texture = json.loads(json.dumps(content["texture"]))
    if kind == "state":
        content["texture"] |= {"dwell_s": [1.0, 0.2], "other": texture}
    else:
        content["texture"] |= {"layer_by": "axis", "layer_at_rad": [0.1, 1.0], "layers": [texture, texture]}
        content["effects"]["lpc_texture"] = {"angle_deg": 30.0}
    with pytest.warns(SwatchWarning) as warned:
        again = swatch_from_json(json.dumps(content))
    assert len(warned) == 1
    with warnings.catch_warnings(action="error"):
        assert swatch_from_json(swatch_to_json(swatch)) == swatch
        assert swatch_from_json(swatch_to_json(replace(swatch, texture=None))).texture is None
    assert again.texture == swatch.texture
    assert "angle_deg" not in again.effects.get("lpc_texture", {})
