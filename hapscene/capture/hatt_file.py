"""The XML files of the Penn Haptic Texture Toolkit (HaTT), as plain arrays in SI units.

Culbertson, López Delgado & Kuchenbecker 2014, "One Hundred Data-Driven Haptic Texture Models and Open-Source Methods
for Rendering on 3D Objects", IEEE Haptics Symposium. Liberal in what is read (white space, order of elements, missing
pictures, numbers in one text or in `value` elements), precise in what is refused: the file, the element, what was
expected.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.capture.streams import Array
from hapscene.constants import ORDER_MAX
from hapscene.dsp.ar_filter import ar_from_lsf, lsf_from_ar
from hapscene.errors import FormatError, SwatchError
from hapscene.files import read_bytes, refusing
from hapscene.surface.texture import MODEL_MAX

# An XML file from a stranger, read element by element with errors that name the place.
#
# No entity is expanded, no other file or address is opened, sizes are capped.


BYTES_MAX: Final = 8 * 1024 * 1024
"""Largest file that is read [bytes]. Those of the Penn toolkit have 20 to 300 kB."""

NODE_MAX: Final = 800_000
"""Most elements and attributes of a file [count], about: one takes 125 bytes in memory, and 4 in the file. A file of
numbers alone, of the largest size, has fewer. libxml2 reads it in our process: fuzzed for years, it is given nothing to
open, to expand or to fill the memory with."""


class XmlElement:
    """An element of a file, read with errors that name the file and the place in it."""

    def __init__(self, path: Path, element: Any, place: str = "") -> None:
        self.path, self.element, self.place = path, element, place

    def error(self, where: str, expected: str, found: str) -> SwatchError:
        return SwatchError(f"{self.path}: {self._at(where)}: expected {expected}, found {found}")

    def _at(self, where: str) -> str:
        return ", ".join(filter(None, (self.place, where)))

    def _named(self, name: str) -> list[Any]:
        return [child for child in self.element if element_name(child) == name]

    def children(self, name: str) -> "list[XmlElement]":
        return [XmlElement(self.path, child, f"<{name}> {i}") for i, child in enumerate(self._named(name), 1)]

    def text(self, name: str) -> str | None:
        found = self._named(name)
        return " ".join("".join(found[0].itertext()).split()) if found else None

    def number(self, name: str) -> float | None:
        """The number in the element of that name, or None where that is missing or empty."""
        text = self.text(name)
        return None if not text else self._value(text, f"<{name}>")

    def required(self, name: str) -> float:
        value = self.number(name)
        if value is None:
            raise self.error(f"<{name}>", "a number", "nothing")
        return value

    def _value(self, text: str, where: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = np.nan
        if not np.isfinite(value) or abs(value) > 1e100:
            raise self.error(where, "a finite number", repr(text[:40]))
        return value

    def numbers(self, most: int) -> Array:
        """The numbers of the element: one in each `value`, or all in its text."""
        values = self._named("value")
        texts = ["".join(v.itertext()).strip() for v in values] or "".join(self.element.itertext()).split()
        if len(texts) > most:
            raise self.error("", f"at most {most} numbers", f"{len(texts)}")
        return np.array([self._value(text, f"value {i}") for i, text in enumerate(texts, 1)])

    def listed(self, name: str, most: int = 4096) -> Array:
        """The numbers of the element of that name; none where it is missing."""
        found = self._named(name)
        return XmlElement(self.path, found[0], self._at(f"<{name}>")).numbers(most) if found else np.empty(0)


def read_xml(path: Path, root: str) -> XmlElement:
    """The root element of a file, if it has that name."""
    source = XmlElement(path, _parsed(path))
    if element_name(source.element) != root:
        raise source.error("the root element", f"<{root}>", f"<{element_name(source.element)}>")
    return source


def root_name(path: str | Path) -> str:
    """The name of a file's root element: "modelSet" or "tapSet" in files of the Penn toolkit."""
    return element_name(_parsed(Path(path)))


def _parsed(path: Path) -> Any:
    """The root element of a file, as `read_tree` gives it."""
    return read_tree(path, BYTES_MAX, SwatchError)


def read_tree(path: Path, most_B: int, error: type[FormatError]) -> Any:
    """The root element of a file of that size at most, parsed without entities, network or huge trees.

    Raises:
        FormatError: of the type that is given: it cannot be read, or is not such a file.
    """
    from lxml import etree

    with refusing(error):
        data = read_bytes(path, most_B, "file of the toolkit")
    if b"<!DOCTYPE" in data.replace(b"\0", b""):  # before the parser sees it, in UTF-16 too
        raise error(f"{path}: has a DOCTYPE, which files of the toolkit have not; it is not read")
    most = NODE_MAX * most_B // BYTES_MAX
    if data.count(b"<") + data.count(b"=") > most:
        raise error(f"{path}: more than {most:,} elements, which no file of the toolkit has")
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, huge_tree=False, load_dtd=False, remove_comments=True, remove_pis=True
    )
    try:
        root = etree.fromstring(data, parser)
    except (etree.XMLSyntaxError, ValueError) as fault:
        raise error(f"{path}: not XML: {' '.join(str(fault).split())[:200]}") from None
    if root is None or root.getroottree().docinfo.doctype:
        raise error(f"{path}: has a DOCTYPE or nothing in it; it is not read")
    return root


def element_name(element: Any) -> str:
    """An element's name without its namespace; "" for what is no element."""
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


ROUNDING_RAD: Final = 1e-5
"""How far ARlsf may be from the frequencies of ARcoeff before it is said [rad]. The files round them to 1e-6."""

_SPEED: Final = {"mm/s": 1e-3, "cm/s": 1e-2, "m/s": 1.0}
_ACCELERATION: Final = ("m/s^2", "m/s2", "m/s²", "m/s/s", "m/s^{2}")
_NEWTON: Final = ("n", "newton", "newtons")


@dataclass(frozen=True)
class HattModels:
    """A models file: m models of AR order p and MA order q, t triangles.

    The toolkit renders y(t) = gain (e(t) + Σ c_k e(t−k)) − Σ a_k y(t−k), e of that variance, and blends the line
    spectral frequencies of a and of c, the variance and the gain, each by itself.
    """

    material: str
    rate_Hz: float
    friction: float | None
    force_N: Array
    speed_m_s: Array
    triangles: NDArray[np.int32]
    ar_lsf_rad: Array
    ma_lsf_rad: Array
    variance_m2_s4: Array
    gain: Array
    notes: tuple[str, ...]


@dataclass(frozen=True)
class HattTaps:
    """A taps file: k transients of n samples at 1 kHz, by ascending approach speed."""

    approach_m_s: Array
    acceleration_m_s2: Array


def read_models(path: str | os.PathLike[str]) -> HattModels:
    """The models of a Models_X.xml.

    Raises:
        SwatchError: not such a file, incomplete, or a number that is out of range.
    """
    source = read_xml(Path(path), "modelSet")
    rate_Hz = source.required("SampleRate")
    if not 100.0 <= rate_Hz <= 1e6:
        raise source.error("<SampleRate>", "100 to 1000000 Hz", f"{rate_Hz:g}")
    _check_unit(source, "AccelUnits", _ACCELERATION)
    _check_unit(source, "ForceUnits", _NEWTON)
    metre = _SPEED.get((source.text("SpeedUnits") or "mm/s").lower().replace(" ", ""))
    if metre is None:
        raise source.error("<SpeedUnits>", "mm/s", repr(source.text("SpeedUnits")))
    notes: list[str] = []
    models = _ordered(source)
    filters = [_filters(model, notes) for model in models]
    for model, (ar, ma) in zip(models, filters, strict=True):
        if (len(ar), len(ma)) != (len(filters[0][0]), len(filters[0][1])):
            raise model.error("", f"{len(filters[0][0])} ARlsf as in model 1", f"{len(ar)}")
    speed, force = _place(source, models, "speedMod", "speedList"), _place(source, models, "forceMod", "forceList")
    variance = np.array([model.required("var") for model in models])
    gain = np.array([1.0 if gain is None else gain for gain in (model.number("gain") for model in models)])
    for name, values in (("var", variance), ("speedMod", speed), ("forceMod", force)):
        for model, value in zip(models, values, strict=True):
            if value < 0.0:
                raise model.error(f"<{name}>", "0 or more", f"{value:g}")
    for name, values in (("maxSpeed", speed), ("maxForce", force)):
        stated = source.number(name)
        if stated is not None and abs(stated - values.max()) > 1e-3 * values.max():
            notes.append(f"{name} says {stated:g}, the models reach {values.max():g}: clamped at the latter")
    triangles = _triangles(source, force, speed, notes)
    ar, ma = (np.stack(side) for side in zip(*filters, strict=True))
    surface = _material(source), rate_Hz, source.number("mu")
    return HattModels(*surface, force, speed * metre, triangles, ar, ma, variance, gain, tuple(notes))


def read_taps(path: str | os.PathLike[str]) -> HattTaps:
    """The taps of a Taps_X.xml, ascending by speed; of several at one speed the first is kept.

    Raises:
        SwatchError: not such a file, incomplete, or a number that is out of range.
    """
    source = read_xml(Path(path), "tapSet")
    taps = source.children("tap")
    _check_count(source, "numTap", "tap", len(taps))
    speeds = [tap.number("tapSpeed") for tap in taps]
    listed = source.listed("speedList")
    if None in speeds and len(listed) == len(taps):
        speeds = [float(v) for v in listed]
    waves = [tap.listed("tapAccel", 100_000) for tap in taps]
    for tap, speed, wave in zip(taps, speeds, waves, strict=True):
        if speed is None or speed <= 0.0:
            raise tap.error("<tapSpeed>", "mm/s above 0", "nothing" if speed is None else f"{speed:g}")
        if len(wave) < 4 or len(wave) != len(waves[0]):
            expected = "4 numbers or more" if len(waves[0]) < 4 else f"{len(waves[0])} numbers as in tap 1"
            raise tap.error("<tapAccel>", expected, f"{len(wave)}")
    approach, first = np.unique(1e-3 * np.array(speeds, dtype=np.float64), return_index=True)
    return HattTaps(approach, np.stack(waves)[first])


def _check_unit(source: XmlElement, name: str, known: tuple[str, ...]) -> None:
    unit = source.text(name)
    if unit and unit.lower().replace(" ", "") not in known:
        raise source.error(f"<{name}>", known[0], repr(unit[:40]))


def _check_count(source: XmlElement, name: str, element: str, count: int) -> None:
    """A file that was cut, or put together wrongly, says another number than it holds."""
    stated = source.number(name)
    if stated is not None and stated != count:
        raise source.error(f"<{name}>", f"the number of <{element}> elements, {count}", f"{stated:g}")
    if not 1 <= count <= MODEL_MAX:
        raise source.error(f"<{element}>", f"1 to {MODEL_MAX} elements", f"{count}")


def _material(source: XmlElement) -> str:
    text = source.text("material") or source.path.stem.removeprefix("Models_")
    return "".join(c if c.isprintable() else " " for c in text).strip()[:200] or "unnamed"


def _ordered(source: XmlElement) -> list[XmlElement]:
    """The model elements by their modNum, where those are 1 … m; else as they stand."""
    models = source.children("model")
    _check_count(source, "numMod", "model", len(models))
    numbers = [model.number("modNum") or 0.0 for model in models]
    if sorted(numbers) != list(range(1, len(models) + 1)):
        return models
    return [models[i] for i in np.argsort(numbers)]


def _place(source: XmlElement, models: list[XmlElement], name: str, listing: str) -> Array:
    """Speed or force of each model: in the model, or in the list of all; both must agree."""
    inside = [model.number(name) for model in models]
    listed = source.listed(listing)
    if len(listed) not in (0, len(models)):
        raise source.error(f"<{listing}>", f"{len(models)} numbers, one for each model", f"{len(listed)}")
    if not len(listed):
        return np.array([model.required(name) for model in models])
    for model, value, other in zip(models, inside, listed, strict=True):
        if value is not None and abs(value - other) > 1e-3 * max(1.0, abs(value)):
            raise model.error(f"<{name}>", f"{other:g} as in <{listing}>", f"{value:g}")
    return np.array([listed[i] if value is None else value for i, value in enumerate(inside)])


def _filters(model: XmlElement, notes: list[str]) -> tuple[Array, Array]:
    """Line spectral frequencies (p,) of a model's denominator and (q,) of its numerator."""
    ar = _frequencies(model, "AR", notes)
    if not len(ar):
        raise model.error("<ARlsf>", "frequencies, or <ARcoeff>", "nothing")
    return ar, _frequencies(model, "MA", notes)


def _frequencies(model: XmlElement, kind: str, notes: list[str]) -> Array:
    """Frequencies of 'AR' or 'MA': those in the file, which the toolkit blends; of the coefficients, where bad.

    The coefficients have 20 decimals and the frequencies 6, which moves a resonance by less than 0.01 dB; what the
    toolkit plays is the latter.
    """
    lsf = model.listed(f"{kind}lsf", ORDER_MAX)
    coefficients = model.listed(f"{kind}coeff", ORDER_MAX + 1)
    usable = len(lsf) > 0 and bool(np.all(np.diff(lsf, prepend=0.0, append=np.pi) > 0.0))
    if len(coefficients) <= 1:
        if len(lsf) and not usable:
            raise model.error(f"<{kind}lsf>", "numbers that ascend within 0 and π", "others")
        return lsf
    if coefficients[0] != 1.0:
        raise model.error(f"<{kind}coeff>, value 1", "1", f"{coefficients[0]:g}")
    if len(lsf) not in (0, len(coefficients) - 1):
        raise model.error(f"<{kind}lsf>", f"{len(coefficients) - 1} numbers", f"{len(lsf)}")
    try:
        exact = lsf_from_ar(coefficients)
    except SwatchError:
        if not usable:
            expected = "a stable filter" if kind == "AR" else "zeros within the unit circle"
            raise model.error(f"<{kind}coeff>", expected, "none, and no usable frequencies") from None
        notes.append(f"{model.place}, {kind}coeff is unstable: {kind}lsf is used, as the toolkit does")
        return lsf
    if not usable:
        notes.append(f"{model.place}, {kind}lsf is missing or does not ascend: {kind}coeff is used")
        return exact
    off = np.abs(exact - lsf).max()
    if off > ROUNDING_RAD and np.abs(ar_from_lsf(lsf) - coefficients).max() > 1e-3:
        notes.append(
            f"{model.place}, {kind}lsf is {off:.2g} rad off {kind}coeff: {kind}lsf is used, as the toolkit does"
        )
    return lsf


def _triangles(source: XmlElement, force: Array, speed: Array, notes: list[str]) -> NDArray[np.int32]:
    """The file's triangles (t, 3), from 0, without those that have no area."""
    elements = source.children("tri")
    _check_count(source, "numTri", "tri", len(elements))
    rows = [tri.numbers(3) for tri in elements]
    for tri, row in zip(elements, rows, strict=True):
        if len(row) != 3 or np.any(row != np.round(row)) or row.min() < 1 or row.max() > len(force):
            raise tri.error("", f"three numbers of models, 1 to {len(force)}", f"{row.tolist()}"[:60])
    triangles = np.array(rows, dtype=np.int32) - 1
    top = force.max() * speed.max()
    if not top > 0.0:
        raise source.error("the models", "one at a force and a speed above 0", "none")
    area = np.abs(_doubled_area(force, speed, triangles)) / top
    kept = triangles[area > 1e-6]
    if len(kept) < len(triangles):
        notes.append(f"{len(triangles) - len(kept)} triangles without area are left out")
    covered = 0.5 * area.sum()
    if not len(kept) or abs(covered - 1.0) > 0.01:
        notes.append(f"the triangles cover {covered:.0%} of the plane of force and speed, not all of it once")
    if not len(kept):
        raise source.error("<tri>", "a triangle with an area", "none")
    return np.asarray(kept)


def _doubled_area(force: Array, speed: Array, triangles: NDArray[np.int32]) -> Array:
    """Twice the signed area (t,) of triangles over force and speed."""
    f, s = force[triangles], speed[triangles]
    return np.asarray((f[:, 1] - f[:, 0]) * (s[:, 2] - s[:, 0]) - (f[:, 2] - f[:, 0]) * (s[:, 1] - s[:, 0]))
