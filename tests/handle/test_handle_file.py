"""Handle files: written and read exactly, errors for invalid content."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from hapscene.errors import HandleError
from hapscene.handle.fit import Identification, IdentifiedGrip
from hapscene.handle.handle_file import describe_lines, handle_from_json, handle_to_json, load_handle, save_handle
from hapscene.handle.plant import Plant

GRIPS = (
    IdentifiedGrip("light", 151.2, 2.7, 0.9997, 0.87, {"k_u_N_m": (140.1, 163.0), "b_u_Ns_m": (2.6, 2.8)}),
    IdentifiedGrip("firm", 1 / 3, 12.0, 0.999, 0.9, {}, {"k_u_N_m": "noise", "b_u_Ns_m": "noise"}),
)
HANDLE = Identification(
    name="ours, № 1",
    plant=Plant(m_h_kg=0.1 + 0.2, amplifier_Hz=4321.0),
    grips=GRIPS,
    intervals={"m_h_kg": (0.29, 0.31), "amplifier_Hz": (4000.0, 4700.0)},
    absent={"m_c_kg": "one grip"},
    asymptote_kg=0.3,
    asymptote_Hz=(160.0, 320.0),
    delay_s=-1e-7,
    accelerometer_Hz=1600.0,
    rate_Hz=10_000.0,
    band_Hz=(10.0, 1000.0),
    misfit=1.01,
    provenance="measured on a Tuesday",
)


def changed(**values: Any) -> str:
    return json.dumps(json.loads(handle_to_json(HANDLE)) | values)


def plant_with(**values: Any) -> str:
    content = json.loads(handle_to_json(HANDLE))
    return json.dumps(content | {"plant": content["plant"] | values})


def test_a_file_is_read_exactly_as_written(tmp_path: Path) -> None:
    save_handle(HANDLE, tmp_path / "a.handle")
    assert load_handle(tmp_path / "a.handle") == HANDLE
    assert [file.name for file in tmp_path.iterdir()] == ["a.handle"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[]", "JSON object"),
        (changed(version=2), "later than 1"),
        (changed(name=3), "name"),
        (changed(misfit="1"), "misfit"),
        (changed(rate_Hz=0), "rate_Hz"),
        (changed(grips=[{}]), "name"),
        (plant_with(m_h_kg=-1.0), "m_h_kg"),
        (handle_to_json(HANDLE).replace("1.01", "NaN"), "NaN"),
        (handle_to_json(HANDLE).replace('"misfit"', '"name"'), "name"),
        ("[" * 20_000, "not a handle"),
    ],
)
def test_invalid_content_is_refused(text: str, words: str) -> None:
    with pytest.raises(HandleError, match=words):
        handle_from_json(text)


def test_a_handle_is_described_with_all_its_numbers() -> None:
    handle = replace(HANDLE, intervals=HANDLE.intervals | {"k_s_N_m": (250.0, 250.0)})
    found = re.findall(r"[ (](-?\d[\d.]*)", "\n".join(describe_lines(handle)[1:]))
    wanted = "300 290 310 15 250.000000 250.000000 250.000000 0.3 4321 4000 4700 1.000 0.87 151 140 163 2.70 2.60 2.80"
    assert " ".join(found) == f"{wanted} 0.999 0.90 0.3333 12 300 160 320 1600 0 6.6 5 1.01"
    for misfit, more in ((2.0, 0), (2.01, 1)):
        assert len(describe_lines(replace(handle, misfit=misfit))) == len(describe_lines(handle)) + more


def test_invalid_handles_are_not_written(tmp_path: Path) -> None:
    for handle, path in (
        (replace(HANDLE, misfit=float("nan")), "a.handle"),
        (replace(HANDLE, delay_s=1e20), "a.handle"),
        (HANDLE, "a.json"),
        (HANDLE, "none/a.handle"),
    ):
        with pytest.raises(HandleError):
            save_handle(handle, tmp_path / path)
    assert not list(tmp_path.iterdir())
