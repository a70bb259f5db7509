"""The computed swatches, compared with closed forms of their lines, corners and levels."""

import math
import re
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from hapscene.errors import SwatchError
from hapscene.surface.swatch import Swatch
from hapscene.surface.texture import Texture
from hapscene.swatches.library import add, computed_entries, load_swatch
from hapscene_swatches import compute

NAMES = [entry.name for entry in computed_entries()]
TIP_M, MASS_KG, STEEL_PA = 1.6e-3, 0.1, 212e9 / (1 - 0.293**2)


@cache
def texture(name: str) -> Texture:
    found = load_swatch(name).texture
    assert found is not None
    return found


def tool(
    f: NDArray[np.float64], force_N: float, contact_Pa: float, radius_m: float, loss: float
) -> NDArray[np.float64]:
    """Power transfer of a mass on a Hertzian contact and the 300 Hz resonance of the tool, damped by the hand."""
    k = 1 / (1 / (6 * contact_Pa**2 * radius_m * force_N) ** (1 / 3) + 1 / (MASS_KG * (600 * math.pi) ** 2))
    r = 2 * np.pi * f / math.sqrt(k / MASS_KG)
    return np.asarray((1 + (loss * r) ** 2) / ((1 - r**2) ** 2 + ((2 * 0.4 + loss) * r) ** 2))


def period_m(name: str) -> float:
    found = re.fullmatch(r"(?:grating|mesh|ribs)-([\d.]+)mm(?:-\d+um)?", name)
    assert found is not None
    return 1e-3 * float(found[1])


@pytest.mark.parametrize("name", [n for n in NAMES if n.startswith(("grating", "mesh", "ribs"))])
def test_periodic_profile_has_a_line_at_speed_over_period(name: str) -> None:
    """At the speeds of its models and between them, from 20 to 800 Hz."""
    for speed in np.geomspace(max(0.011, 20.0 * period_m(name)), 0.4, 25):
        line_Hz = speed / period_m(name)
        f = np.linspace(0.7, 1.3, 401) * line_Hz
        density = texture(name).density([0.7], [speed], frequency_Hz=f)[0]
        assert f[np.argmax(density)] == pytest.approx(line_Hz, rel=0.015)


@pytest.mark.parametrize("force_N", [0.25, 1.0, 3.0])
def test_level_of_gratings(force_N: float) -> None:
    """Shallow enough for the ball to reach its bottom: h (2π v/λ)²/√2, the tool's resonance, the force's bound.

    The patch grows with the force; the lighter stroke counts where the profile is flattened.
    """
    swatch, period, height = texture("grating-1mm-10um"), 1e-3, 5e-6
    acrylic = 1 / ((1 - 0.35**2) / 2.7e9 + 1 / STEEL_PA)
    # the ball's path is a parallel curve: to second order its middle rises by R h'²/2, a line at 2 v/λ
    heights = np.array([height, TIP_M * (2 * np.pi / period * height) ** 2 / 4])
    for speed in sorted(set(swatch.speed_m_s[swatch.variance_m2_s4 > 0.0]))[2:7]:
        f = np.array([1.0, 2.0]) * speed / period
        powers = []
        for lighter_N in (F for F in (0.25, 1.0, 3.0) if force_N >= F):
            patch = (0.75 * lighter_N * TIP_M / acrylic) ** (1 / 3)
            passed = tool(f, lighter_N, acrylic, TIP_M, 0.05) / (1 + math.pi / 4 * (2 * np.pi * f / speed * patch) ** 3)
            powers.append(float(np.sum((heights * (2 * np.pi * f) ** 2) ** 2 * passed) / 2))
        want = max(powers) / (1 + 2 * max(powers) * (MASS_KG / force_N) ** 2)
        assert swatch.power([force_N], [speed])[0] == pytest.approx(want, rel=0.15)


@pytest.mark.parametrize("name", NAMES)
def test_faster_or_harder_is_not_weaker(name: str) -> None:
    """Between the models and beyond them."""
    force, speed = np.meshgrid(np.geomspace(0.1, 5.0, 14), np.geomspace(0.01, 0.8, 30), indexing="ij")
    level_dB = 10 * np.log10(texture(name).power(force.ravel(), speed.ravel())).reshape(force.shape)
    assert np.diff(level_dB, axis=0).min() > -0.01 and np.diff(level_dB, axis=1).min() > -0.01


def test_shipped_swatches_are_up_to_date() -> None:
    assert set(NAMES) == set(compute.SURFACES) and len(NAMES) >= 24
    for name in ("grating-2mm-50um", "sandpaper-p120", "mesh-1mm", "rubber-soft"):
        made, known = compute.compute(name), load_swatch(name)
        assert (made.provenance, made.look, made.taps) == (known.provenance, known.look, known.taps)
        assert made.texture is not None and known.texture is not None
        assert_allclose(made.texture.lsf_rad, known.texture.lsf_rad, atol=2e-7)
        assert_allclose(made.texture.variance_m2_s4, known.texture.variance_m2_s4, rtol=1e-5)


def test_user_swatch_takes_precedence(monkeypatch, tmp_path) -> None:
    """A user swatch that is older than a computed one with the same name is used; new ones are rejected."""
    monkeypatch.setenv("HAPSCENE_LIBRARY", str(tmp_path))
    with pytest.raises(SwatchError, match="glass"):
        add(Swatch("glass"))
    entry = add(Swatch("mine", 123.0))
    index = tmp_path / "index.json"
    index.write_text(index.read_text(encoding="utf-8").replace('"mine"', '"glass"'), encoding="utf-8")
    text = (tmp_path / entry.file).read_text(encoding="utf-8")
    (tmp_path / entry.file).write_text(text.replace('"mine"', '"glass"'), encoding="utf-8")
    assert load_swatch("glass").stiffness_N_m == 123.0
    assert add(Swatch("glass", 124.0), replace=True).name == "glass"
