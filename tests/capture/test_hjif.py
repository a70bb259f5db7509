"""MPEG haptics files, against the constraints of the published schema.

The schema (MPEGGroup/HapticJSONSchemas at commit e3b9aa67: one file each for the experience, perception, reference
device, channel, band, effect and keyframe) states no licence, so it is not copied: what it requires of the objects
that are written here is stated below in our own words, closed, so that a misspelt key fails. Beside it stand the
checks of the MPEG reference software's reader that are stricter (MPEGGroup/HapticReferenceSoftware at commit 73ffe9bb,
source/IOHaptics/src/IOJson.cpp: what `loadFile` asks of each object, and its semantic conformance checks). Older
versions of that reader want other names: mixing_weight for mixing_coefficient, tracks for channels.
"""

import json
import re
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from hapscene import cli
from hapscene.capture.fit.synthesis import synthesize
from hapscene.capture.io.hjif import as_hjif, export_hjif
from hapscene.errors import SwatchError
from hapscene.surface.swatch import PLAIN, Swatch
from hapscene.surface.taps import Taps
from hapscene.swatches.library import load_swatch


def closed(required: dict[str, Any], optional: dict[str, Any] | None = None) -> dict[str, Any]:
    properties = required | (optional or {})
    return {
        "type": "object",
        "properties": properties,
        "required": list(required),
        "additionalProperties": False,
    }


def listed(item: dict[str, Any], least: int = 0) -> dict[str, Any]:
    return {"type": "array", "items": item, "minItems": least}


TEXT = {"type": "string"}
COUNT = {"type": "integer", "minimum": 0}
POSITIVE = {"type": "number", "minimum": 0}
HERTZ = {"type": "integer", "minimum": 0, "maximum": 10000}  # the schema takes fractions, the reader does not
MASK = {"type": "integer", "minimum": 0, "maximum": 4294967295}

KEYFRAME = closed(
    {"relative_position": COUNT, "amplitude_modulation": {"type": "number", "minimum": -1, "maximum": 1}},
    {"frequency_modulation": HERTZ},
)
EFFECT = closed(
    {
        "effect_type": {"enum": ["Basis"]},
        "position": COUNT,
        "phase": {"type": "number", "minimum": 0, "maximum": 6.28318},
        "base_signal": {"enum": ["Sine", "Square", "Triangle", "SawToothUp", "SawToothDown"]},
        "keyframes": listed(KEYFRAME),
    }
)
BAND = closed(
    {
        "band_type": {"enum": ["WaveletWave", "VectorialWave", "Curve", "Transient"]},
        "lower_frequency_limit": HERTZ,
        "upper_frequency_limit": HERTZ,
        "effects": listed(EFFECT),
    },
    {"curve_type": {"enum": ["Linear", "Cubic", "Akima", "Bezier", "BSpline", "Unknown"]}},
)
CHANNEL = closed(
    {"id": COUNT, "description": TEXT, "gain": POSITIVE, "mixing_coefficient": POSITIVE, "bands": listed(BAND)}
    | {"body_part_mask": MASK},  # the reader asks for it
    {"reference_device_id": COUNT, "frequency_sampling": COUNT, "sample_count": COUNT},
)
DEVICE = closed(
    {"id": {"type": "integer", "minimum": 1}, "name": TEXT},
    {
        "body_part_mask": MASK,
        "minimum_frequency": POSITIVE,
        "maximum_frequency": POSITIVE,
        "maximum_amplitude": POSITIVE,
        "type": {"enum": ["LRA", "VCA", "ERM", "Piezo", "Unknown"]},
    },
)
PERCEPTION = closed(
    {
        "id": COUNT,
        "perception_modality": {"enum": ["Acceleration", "Vibrotactile", "Vibrotactile Texture"]},
        "description": TEXT,
        "avatar_id": COUNT,
        "effect_library": listed(EFFECT),
        "channels": listed(CHANNEL, 1),
    },
    {
        "reference_devices": listed(DEVICE),
        "unit_exponent": {"type": "integer"},
        "perception_unit_exponent": {"type": "integer"},
    },
)
EXPERIENCE = closed(
    {
        "version": {"type": "string", "pattern": "^[0-9]{4}(-[0-9])?$"},
        "profile": {"enum": ["Main", "Simple Parametric"]},
        "level": {"enum": [1, 2]},
        "date": {
            "type": "string",
            "pattern": r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d[+-]\d\d:\d\d$",
        },  # RFC 3339 and ISO 8601
        "description": TEXT,
        "avatars": listed({"type": "object"}),
        "perceptions": listed(PERCEPTION, 1),
        "timescale": {"type": "integer", "minimum": 1, "maximum": 48000},  # these two the reader asks for
        "syncs": listed({"type": "object"}),
    }
)


def check(content: dict[str, Any]) -> None:
    """The schema, and what the reference reader checks across objects."""
    jsonschema.Draft7Validator(EXPERIENCE).validate(content)
    assert int(content["version"][:4]) >= 2023
    ids = [p["id"] for p in content["perceptions"]]
    assert len(set(ids)) == len(ids)
    for perception in content["perceptions"]:
        assert perception["avatar_id"] == 0 or perception["avatar_id"] in [a["id"] for a in content["avatars"]]
        channels = [channel["id"] for channel in perception["channels"]]
        assert len(set(channels)) == len(channels)
        devices = [device["id"] for device in perception.get("reference_devices", [])]
        assert len(set(devices)) == len(devices) and len(perception["channels"]) <= 128
        for device in perception.get("reference_devices", []):
            assert device["minimum_frequency"] <= device["maximum_frequency"]
        for channel in perception["channels"]:
            assert {"gain", "mixing_coefficient", "body_part_mask", "bands"} <= channel.keys()
            assert channel["reference_device_id"] in devices and len(channel["bands"]) <= 7
            for band in channel["bands"]:
                assert band["lower_frequency_limit"] <= band["upper_frequency_limit"]
                assert (band["band_type"] == "Curve") == ("curve_type" in band)
                positions = [effect["position"] for effect in band["effects"]]
                assert positions == sorted(positions)
                for effect in band["effects"]:
                    at = [keyframe["relative_position"] for keyframe in effect["keyframes"]]
                    assert at == sorted(set(at)) and at[0] == 0


@pytest.mark.parametrize("name", ["wood", "epoxy"])
def test_valid_and_the_signal_itself(tmp_path: Path, name: str) -> None:
    path = tmp_path / "x.hjif"
    swatch = load_swatch(name)
    export_hjif(swatch, path, force_N=1.0, speed_m_s=0.1, seconds=0.5, seed=3)
    content = json.loads(path.read_text(encoding="utf-8"))
    check(content)
    texture, taps = content["perceptions"]
    full = texture["reference_devices"][0]["maximum_amplitude"]
    (effect,) = texture["channels"][0]["bands"][0]["effects"]
    played = full * np.array([k["amplitude_modulation"] for k in effect["keyframes"]])
    rate_Hz = content["timescale"]
    signal = synthesize(swatch, np.full(5000, 1.0), np.full(5000, 0.1), rate_Hz=rate_Hz, seed=3)
    np.testing.assert_allclose(played, signal, atol=1e-6 * full)
    assert [k["relative_position"] for k in effect["keyframes"]] == list(range(5000))
    assert taps["channels"][0]["bands"][0]["band_type"] == "Transient"
    assert swatch.licence in content["description"] and "1 N and 0.1 m/s" in texture["description"]


def test_taps_as_transients() -> None:
    taps = Taps([0.1, 0.2], [4.0, 10.0], [90.0, 120.4], [50.0, 60.0])
    content = as_hjif(Swatch("steel", taps=taps), 0.0, 0.0, 1.0)
    check(content)
    (perception,) = content["perceptions"]
    effects = perception["channels"][0]["bands"][0]["effects"]
    t_s = np.linspace(0, 0.1, 200_001)
    peaks = [
        np.max(tap[0] * np.exp(-tap[2] * t_s) * np.sin(2 * np.pi * tap[1] * t_s)) for tap in map(taps.at, (0.1, 0.2))
    ]
    full = perception["reference_devices"][0]["maximum_amplitude"]
    assert full == pytest.approx(max(peaks), rel=1e-6)
    assert [full * e["keyframes"][0]["amplitude_modulation"] for e in effects] == pytest.approx(peaks, rel=1e-5)
    assert [e["keyframes"][0]["frequency_modulation"] for e in effects] == [90, 120]
    assert [e["position"] for e in effects] == [0, 5000]
    both = as_hjif(Swatch("steel", taps=taps, leaving=taps), 0.0, 0.0, 1.0)
    check(both)
    first = [p["channels"][0]["bands"][0]["effects"][0]["position"] for p in both["perceptions"]]
    assert first == [0, 10_000] and "leaving at 0.1, 0.2 m/s" in both["perceptions"][1]["description"]


def test_the_seed_determines_the_noise() -> None:
    wood = load_swatch("wood")
    default, zero, one = (as_hjif(wood, 1.0, 0.1, 0.1, **seed) for seed in ({}, {"seed": 0}, {"seed": 1}))
    assert default == zero != one


def test_a_silent_texture_is_valid() -> None:
    check(as_hjif(load_swatch("wood"), 0.0, 0.1, 0.1))


def test_invalid_arguments_are_refused(tmp_path: Path) -> None:
    wood = load_swatch("wood")
    for message, change in {
        "texture": {"swatch": PLAIN},
        "expected .hjif": {"path": tmp_path / "x.json"},
        "cannot be written": {"path": tmp_path / "no" / "x.hjif"},
        "seconds": {"seconds": 1e9},
        "rate_Hz": {"rate_Hz": 96000.0},
        "force_N": {"force_N": -1.0},
        "speed_m_s": {"speed_m_s": float("nan")},
    }.items():
        asked: dict[str, Any] = {
            "swatch": wood,
            "path": tmp_path / "x.hjif",
            "force_N": 1,
            "speed_m_s": 0.1,
            "seconds": 0.1,
        }
        with pytest.raises(SwatchError, match=re.escape(message)):
            export_hjif(**(asked | change))
    assert not list(tmp_path.iterdir())


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "wood.hjif"
    assert cli.main(["convert", "wood", str(out)]) == 0
    assert "wood.hjif" in capsys.readouterr().out
    content = json.loads(out.read_text(encoding="utf-8"))
    check(content)
    assert content["timescale"] == 10000
