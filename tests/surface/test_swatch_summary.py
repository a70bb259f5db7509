"""The summary of a swatch: each figure beside its label."""

import re

import pytest

from hapscene.dsp.ar_filter import power_gain
from hapscene.surface.gain_modulation import GainModulation
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_summary import figures, lines, phrases
from hapscene.surface.taps import Taps
from hapscene.surface.texture import Texture

A = [[1.0, -0.5], [1.0, 0.3]]
TEXTURE = Texture.from_models(
    5000.0, [0.5, 0.8], [0.02, 0.05], a=A, variance_m2_s4=16.0 / power_gain(A, 0.25), warp=0.25,
    exponents=(0.5, 2.0), modulation=GainModulation([0.3], [20.0], [400.0]),
)  # fmt: skip
TAPS = Taps([0.05, 0.2], [3.0, 12.0], [100.0, 250.0], [50.0, 50.0])
FULL = Swatch(
    "oak", 650.0, 1.5, 0.42, 0.31, TEXTURE, TAPS, (0.25, 0.5, 0.75), "two\n lines", "MIT",
    {"puncture": {"drag_N": 0.25}}, {"friction_static": (0.4, 0.44)},
    {"stiffness_N_m": "no depth", "friction_dynamic.interval": "one stroke", "texture.level": "no accelerometer"},
    adhesion_N=0.125, adhesion_range_m=5e-4, leaving=TAPS, tool="probe", tip="3.2 mm ball",
)  # fmt: skip


def numbers_of(swatch: Swatch) -> list[tuple[str, list[float]]]:
    found = [
        (line[2:13].strip(), re.findall(r"(?<![\w/^.])-?\d+(?:\.\d+)?(?:e-?\d+)?", line[13:])) for line in lines(swatch)
    ]
    return [(label, [float(number) for number in numbers]) for label, numbers in found[2:]]


def test_every_figure_of_a_full_swatch() -> None:
    assert numbers_of(FULL) == [
        ("stiffness", [650.0]), ("damping", [1.5]), ("friction", [0.42, 95.0, 0.4, 0.44]), ("", [0.31]),
        ("adhesion", [0.125]), ("", [0.0005]),
        ("roughness", [4.0, 0.8, 0.05]), ("texture", [4.0, 1.0, 5000.0, 0.8, 0.05, 0.25]), ("", [2.6, 20.0, 400.0]),
        ("", [10.0]), ("taps", [2.0, 0.05, 0.2, 0.1, 6.0, 150.0]), ("leaving", [2.0, 0.05, 0.2]),
        ("colour", [0.25, 0.5, 0.75, 0.0, 1.0]), ("puncture", [0.25]),
        ("tool", []), ("tip", [3.2]), ("provenance", []), ("licence", []),
    ]  # fmt: skip
    text = lines(FULL)
    for reason in FULL.absent.values():
        assert sum(reason in line for line in text) == 1
    assert text[0].startswith("oak: ") and text[1] == "" and "two lines" in text[-2] and text[-1].endswith("MIT")


def test_figures_and_words_of_other_swatches() -> None:
    """At 1 N and 0.1 m/s, or the largest of the texture; nothing that is absent is described."""
    wide = Texture.from_models(1e3, [2.0], [0.4], a=[[1.0, 0.0]], variance_m2_s4=[16.0])
    assert figures(Swatch("wide", texture=wide))["roughness_m_s2"] == pytest.approx(2.0)  # a quarter of the power
    assert [phrase.figure for phrase in phrases(FULL)][1:] == [
        "4 m/s² at 0.8 N, 0.05 m/s", "µ 0.31, 0.42 at rest", "6 m/s², 150 Hz at 0.1 m/s"
    ]  # fmt: skip
    bare = Swatch("bare", absent={name: "?" for name in ("taps", "texture", "friction_dynamic")}, provenance="\x1b[2J")
    assert [phrase.word.endswith("not measured") for phrase in phrases(bare)] == [False, True, True, True]
    labels = ["stiffness", "damping", "friction", "", "texture", "taps", "colour", "provenance", "licence"]
    assert [label for label, _ in numbers_of(bare)] == labels and not any("\x1b" in line for line in lines(bare))
