"""Imports swatches from files of the Penn Haptic Texture Toolkit (HaTT): texture models at 10 kHz, and taps.

Culbertson, López Delgado & Kuchenbecker 2014, "One Hundred Data-Driven Haptic Texture Models and Open-Source Methods
for Rendering on 3D Objects", IEEE Haptics Symposium.

The swatch uses the triangles and line spectral frequencies of the file, interpolates the variance as the toolkit does
(interpolation "hatt"), and takes the friction coefficient as both static and dynamic. The files contain no stiffness
and no damping; the swatch has the default values. ARMA models (the 1 kHz files of the toolkit) are not supported.

The renderer of the toolkit is silent below 0.05 mm/s and 0.05 N. The files do not contain these thresholds, and the
swatch does not have them.
"""

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import numpy as np
import scipy
from numpy.typing import NDArray

from hapscene.capture.io.streams import Array
from hapscene.errors import HapsceneError, SwatchError
from hapscene.io.files import read_bytes, refusing
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_file import SUFFIX, save_swatch
from hapscene.surface.taps import Taps
from hapscene.surface.texture import MODEL_MAX, Texture

__all__ = ["import_hatt", "import_many", "read_models"]

TAP_RATE_HZ: Final = 1000.0
"""Sample rate of the recorded taps [Hz]; the files do not state it."""

LICENCE: Final = (
    "Not stated in the file. Files of the Penn Haptic Texture Toolkit are for non-profit research, "
    "and may not be passed on without Penn's approval."
)


# The XML may come from an untrusted source: files with a DOCTYPE (and so with entities) are refused, sizes are limited.

BYTES_MAX: Final = 8 * 1024 * 1024
"""Largest file that is read [bytes]. The files of the toolkit have 20 to 300 kB."""

NODE_MAX: Final = 800_000
"""Approximate largest number of elements and attributes of a file; each needs 125 bytes in memory, 4 in the file."""


class _Xml:
    """An XML element whose errors name the file and the position in it."""

    def __init__(self, path: Path, element: ElementTree.Element, place: str = "") -> None:
        self.path, self.element, self.place = path, element, place

    def error(self, where: str, expected: str, found: str) -> SwatchError:
        place = ", ".join(filter(None, (self.place, where)))
        return SwatchError(f"{self.path}: {place}: expected {expected}, found {found}")

    def children(self, name: str) -> "list[_Xml]":
        """Child elements of a name."""
        found = [_Xml(self.path, child, f"<{name}> {i}") for i, child in enumerate(self.element.findall(name), 1)]
        if not 1 <= len(found) <= MODEL_MAX:
            raise self.error(f"<{name}>", f"1 to {MODEL_MAX} elements", f"{len(found)}")
        return found

    def text(self, name: str) -> str:
        """Text of a child element; empty if there is no such child."""
        return self.element.findtext(name, "").strip()

    def numbers(self, name: str) -> Array:
        """Numbers in the text of a child element and of its own children; name "." for this element."""
        found = self.element.find(name)
        texts = [] if found is None else " ".join(found.itertext()).split()
        try:
            values = np.array(texts, dtype=np.float64)
        except ValueError:
            values = np.array([np.nan])
        if not np.all(np.abs(values) <= 1e100):
            raise self.error(f"<{name}>", "finite numbers", repr(" ".join(texts)[:40]))
        return values

    def positive(self, name: str, default: float | None = None) -> float:
        """Number in a child element, which must be 0 or more; `default` if the element is missing."""
        values = self.numbers(name)
        if default is not None and not len(values):
            return default
        if len(values) != 1 or values[0] < 0.0:
            raise self.error(f"<{name}>", "a number, 0 or more", repr(self.text(name)[:40]))
        return float(values[0])


def _read_xml(path: Path, name: str) -> _Xml:
    """Parses a file and returns its root element, which must have the name.

    Raises:
        SwatchError: the file cannot be read, is not XML, or has another root element.
    """
    with refusing(SwatchError):
        data = read_bytes(path, BYTES_MAX, "file of the toolkit")
    if b"<!DOCTYPE" in data.replace(b"\0", b""):  # checked before parsing; the replacement covers UTF-16
        raise SwatchError(f"{path}: contains a DOCTYPE; expected a file of the toolkit, which has none")
    if data.count(b"<") + data.count(b"=") > NODE_MAX:
        raise SwatchError(f"{path}: more than {NODE_MAX:,} elements; expected a file of the toolkit")
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError, LookupError) as fault:
        raise SwatchError(f"{path}: not XML: {' '.join(str(fault).split())[:200]}") from None
    source = _Xml(path, root)
    if root.tag != name:
        raise source.error("the root element", f"<{name}>", f"<{root.tag}>")
    return source


# Models.

_SPEED: Final = {"mm/s": 1e-3, "cm/s": 1e-2, "m/s": 1.0}
_ACCELERATION: Final = {"m/s^2": 1.0, "m/s2": 1.0, "m/s²": 1.0, "m/s/s": 1.0, "m/s^{2}": 1.0}
_FORCE: Final = {"n": 1.0, "newton": 1.0, "newtons": 1.0}


@dataclass(frozen=True)
class HattModels:
    """Content of a models file: m AR models of order p at forces and speeds, and t triangles between them."""

    material: str
    rate_Hz: float
    friction: float | None
    force_N: Array
    speed_m_s: Array
    triangles: NDArray[np.int32]
    ar_lsf_rad: Array
    """(m, p) line spectral frequencies"""
    variance_m2_s4: Array
    """(m,) variance of the excitation, gain included"""


def read_models(path: str | os.PathLike[str]) -> HattModels:
    """Reads the models of a Models_X.xml file.

    Raises:
        SwatchError: the file is not a models file, is incomplete, contains ARMA models or a number out of range.
    """
    source = _read_xml(Path(path), "modelSet")
    rate_Hz = source.positive("SampleRate")
    if not 100.0 <= rate_Hz <= 1e6:
        raise source.error("<SampleRate>", "100 to 1000000 Hz", f"{rate_Hz:g}")
    _unit(source, "AccelUnits", _ACCELERATION)
    _unit(source, "ForceUnits", _FORCE)
    models = sorted(source.children("model"), key=lambda model: model.positive("modNum", 0.0))
    lsf = [_frequencies(model) for model in models]
    for model, own in zip(models, lsf, strict=True):
        if len(own) != len(lsf[0]):
            raise model.error("", f"{len(lsf[0])} ARlsf as in model 1", f"{len(own)}")
    speed, force, variance = (
        np.array([model.positive(name) for model in models]) for name in ("speedMod", "forceMod", "var")
    )
    gain = np.array([model.positive("gain", 1.0) for model in models])
    triangles = _triangles(source, force, speed)
    text = source.text("material") or source.path.stem.removeprefix("Models_")
    material = "".join(c if c.isprintable() else " " for c in text).strip()[:200] or "unnamed"
    friction = source.positive("mu") if len(source.numbers("mu")) else None
    places = force, speed * _unit(source, "SpeedUnits", _SPEED), triangles
    return HattModels(material, rate_Hz, friction, *places, np.stack(lsf), gain**2 * variance)


def _unit(source: _Xml, name: str, known: dict[str, float]) -> float:
    """SI factor of the unit in a child element; by default that of the first known unit."""
    unit = source.text(name).lower().replace(" ", "") or next(iter(known))
    if unit not in known:
        raise source.error(f"<{name}>", next(iter(known)), repr(unit[:40]))
    return known[unit]


def _frequencies(model: _Xml) -> Array:
    """Line spectral frequencies (p,) of a model."""
    if len(model.numbers("MAlsf")) or len(model.numbers("MAcoeff")) > 1:
        raise model.error("<MAcoeff>", "an AR model, as in the 10 kHz files of the toolkit", "an ARMA model")
    lsf = model.numbers("ARlsf")
    if not len(lsf) or not np.all(np.diff(lsf, prepend=0.0, append=np.pi) > 0.0):
        raise model.error("<ARlsf>", "ascending numbers between 0 and π", "others")
    return lsf


def _triangles(source: _Xml, force: Array, speed: Array) -> NDArray[np.int32]:
    """Triangles (t, 3) of the file as indices from 0, without degenerate ones."""
    elements = source.children("tri")
    rows = [tri.numbers(".") for tri in elements]
    for tri, row in zip(elements, rows, strict=True):
        if len(row) != 3 or np.any(row != np.round(row)) or row.min() < 1 or row.max() > len(force):
            raise tri.error("", f"three model numbers from 1 to {len(force)}", f"{row.tolist()}"[:60])
    triangles = np.array(rows, dtype=np.int32) - 1
    top = force.max() * speed.max()
    if not top > 0.0:
        raise source.error("the models", "a model at a force and a speed above 0", "no such model")
    f, s = force[triangles], speed[triangles]
    doubled = np.abs((f[:, 1] - f[:, 0]) * (s[:, 2] - s[:, 0]) - (f[:, 2] - f[:, 0]) * (s[:, 1] - s[:, 0]))
    share = 0.5 * float(doubled.sum()) / top
    if abs(share - 1.0) > 0.01:
        raise source.error("<tri>", "triangles that cover the plane of force and speed exactly once", f"{share:.0%}")
    return np.asarray(triangles[doubled > 1e-6 * top])


# Taps.


def read_taps(path: str | os.PathLike[str]) -> tuple[Array, Array]:
    """Reads approach speeds (k,) [m/s], ascending, and transients (k, n) [m/s²] at 1 kHz from a Taps_X.xml file.

    If several taps have the same speed, the first is used.

    Raises:
        SwatchError: the file is not a taps file, is incomplete, or contains a number out of range.
    """
    source = _read_xml(Path(path), "tapSet")
    taps = source.children("tap")
    waves = [tap.numbers("tapAccel") for tap in taps]
    speeds = [tap.positive("tapSpeed") for tap in taps]
    for tap, speed, wave in zip(taps, speeds, waves, strict=True):
        if speed == 0.0:
            raise tap.error("<tapSpeed>", "mm/s above 0", "0")
        if len(wave) < 4 or len(wave) != len(waves[0]):
            raise tap.error("<tapAccel>", f"{max(4, len(waves[0]))} numbers", f"{len(wave)}")
    approach, first = np.unique(1e-3 * np.array(speeds, dtype=np.float64), return_index=True)
    return approach, np.stack(waves)[first]


def _decaying_sinusoid(wave: Array) -> tuple[float, float, float]:
    """Least-squares fit of A exp(−βt) sin(2πft): amplitude [m/s²], frequency [Hz] and decay [1/s]."""
    peak = float(np.abs(wave).max())
    t_s = np.arange(len(wave)) / TAP_RATE_HZ
    if peak == 0.0:
        return 0.0, TAP_RATE_HZ / 10, TAP_RATE_HZ / 10

    def residual(p: Array) -> Array:
        return np.asarray(p[0] * np.exp(-p[2] * t_s) * np.sin(2.0 * np.pi * p[1] * t_s) - wave / peak)

    density = np.abs(np.fft.rfft(wave, 8 * len(wave)))
    loudest = float(np.argmax(density[1:]) + 1) * TAP_RATE_HZ / (8 * len(wave))
    bounds = ([-100.0, 1.0, 0.1], [100.0, TAP_RATE_HZ / 2, 5000.0])
    tries = [
        scipy.optimize.least_squares(residual, [sign, min(max(frequency, 2.0), 499.0), decay], bounds=bounds)
        for frequency in (loudest, 1.5 * loudest)
        for decay in (20.0, 150.0)
        for sign in (1.0, -1.0)
    ]
    best = min(tries, key=lambda fit: float(fit.cost))
    return peak * abs(float(best.x[0])), float(best.x[1]), float(best.x[2])


# Swatches.


def import_hatt(models_xml: str | os.PathLike[str], taps_xml: str | os.PathLike[str] | None = None) -> Swatch:
    """Imports a swatch from a Models_X.xml file and, optionally, its Taps_X.xml file.

    Beyond the largest force and speed of the models, the texture stays constant.

    Raises:
        SwatchError: a file is missing, too large or incomplete, or describes an unstable model; the message names the
            file, the element and the expected value.
    """
    path = Path(models_xml)
    models = read_models(path)
    taps = None if taps_xml is None else _as_taps(*read_taps(taps_xml))
    files = path.name if taps_xml is None else f"{path.name} and {Path(taps_xml).name}"
    places = models.force_N, models.speed_m_s, models.triangles
    with refusing(SwatchError, path):
        return Swatch(
            models.material,
            friction_static=models.friction or 0.0,
            friction_dynamic=models.friction or 0.0,
            texture=Texture(models.rate_Hz, *places, models.ar_lsf_rad, models.variance_m2_s4, interpolation="hatt"),
            taps=taps,
            absent=_absent(models, taps),
            provenance=f"Imported from {files} (layout of the Penn Haptic Texture Toolkit).",
            licence=LICENCE,
        )


def _absent(models: HattModels, taps: Taps | None) -> dict[str, str]:
    """Reasons for the quantities that the files do not contain."""
    absent = dict.fromkeys(("stiffness_N_m", "damping_Ns_m"), "not part of the files of the toolkit")
    if models.friction is None:
        absent |= dict.fromkeys(("friction_static", "friction_dynamic"), "mu is missing in the models file")
    if taps is None:
        absent["taps"] = "no taps file was given"
    return absent


def _as_taps(approach_m_s: Array, waves_m_s2: Array) -> Taps:
    """Taps with the recorded transients and a decaying sinusoid fitted to each."""
    rows = np.array([_decaying_sinusoid(wave) for wave in waves_m_s2])
    return Taps(approach_m_s, rows[:, 0], rows[:, 1], rows[:, 2], waves_m_s2, TAP_RATE_HZ)


def import_many(files: Iterable[str | Path], folder: str | Path, say: Callable[[str], None]) -> list[str]:
    """Imports models files, with the taps files of the same name, as `folder`/<name>.swatch.

    An error in one file does not stop the import of the others.

    Args:
        files: XML files, and folders of XML files; `Models_X.xml` and `Taps_X.xml` form a pair.
        folder: output folder; it is created if it does not exist.
        say: called with a line of output for each swatch.

    Returns:
        An error for each models file that was not imported.

    Raises:
        SwatchError: two models files have the same name, or a taps file has no models file.
    """
    pairs, errors = _pairs(files), list[str]()
    Path(folder).mkdir(parents=True, exist_ok=True)
    for i, (models, taps) in enumerate(pairs, 1):
        path = Path(folder) / (_key(models) + SUFFIX)
        try:
            save_swatch(import_hatt(models, taps), path)
            say(f"{i}/{len(pairs)}  {models.name} → {path.name}")
        except HapsceneError as error:
            errors.append(str(error))
            say(f"{i}/{len(pairs)}  {models.name}: not imported")
    return errors


def _pairs(files: Iterable[str | Path]) -> list[tuple[Path, Path | None]]:
    """Pairs of a models file and its taps file or None, in the given order."""
    each = (sorted(file.glob("*.xml")) if file.is_dir() else [file] for file in map(Path, files))
    paths = dict.fromkeys(path for group in each for path in group)
    taps = {_key(path): path for path in paths if path.name.startswith("Taps_")}
    models = [path for path in paths if path not in taps.values()]
    if len({_key(path) for path in models}) < len(models):
        raise SwatchError("two models files have the same name: import them into two folders")
    pairs = [(path, taps.pop(_key(path), None)) for path in models]
    for key, path in taps.items():
        raise SwatchError(f"{path}: no matching Models_{key}.xml among the files")
    return pairs


def _key(path: Path) -> str:
    """Name of a file without the prefix Models_ or Taps_."""
    return path.stem.removeprefix("Models_").removeprefix("Taps_") or path.stem
