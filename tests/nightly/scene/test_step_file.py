"""STEP files: whole ones are read, damaged ones are told, and what crashes their parser is one sentence."""

import time

import pytest

pytest.importorskip("cascadio", reason="cascadio is not installed: pip install 'hapscene[step]'")
from hapscene.scene.step_file import promised_by


@pytest.mark.parametrize("beginning", ["/* ", "DATA;", "DATA(", "CLOSED_SHELL(", "CLOSED_SHELL()", "#1 ", "'", "#1=A("])
def test_beginnings_without_an_end_are_looked_through_once(beginning: str) -> None:
    text = f"ISO-10303-21;HEADER;ENDSEC;DATA;{beginning * (200_000 // len(beginning))}END-ISO-10303-21;"
    start_s = time.process_time()
    promised_by(text.encode(), "hostile.step")
    assert time.process_time() - start_s < 2.0
