"""Files of the Penn Haptic Texture Toolkit, compared with an independent implementation of its query."""

import shutil
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from hapscene import cli
from hapscene.capture.io.hatt import _decaying_sinusoid, import_hatt, import_many
from hapscene.errors import SwatchError
from hapscene.swatches.library import load_swatch

Array = NDArray[np.float64]


def polynomial(lsf: Array) -> Array:
    """Coefficients of line spectral frequencies, by the textbook: roots multiplied out, (P + Q)/2."""
    on_circle = np.exp(1j * lsf)
    odd, even = on_circle[0::2], on_circle[1::2]
    p = np.poly(np.concatenate([odd, odd.conj()])) if len(odd) else np.ones(1)
    q = np.poly(np.concatenate([even, even.conj()])) if len(even) else np.ones(1)
    if len(lsf) % 2 == 0:
        p, q = np.convolve(p, [1, 1]), np.convolve(q, [1, -1])
    else:
        q = np.convolve(q, [1, 0, -1])
    return np.real(p + q)[: len(lsf) + 1] / 2


@dataclass
class Toolkit:
    """The toolkit's query: its own reading of the XML, a plain search of the triangle, barycentric blends."""

    path: Path

    def __post_init__(self) -> None:
        root = ElementTree.parse(self.path).getroot()

        def rows(element: ElementTree.Element | None) -> list[float]:
            return [] if element is None else [float(v.text or "nan") for v in element.findall("value")]

        models = root.findall("model")
        self.speed = np.array([float(m.findtext("speedMod", "nan")) for m in models])
        self.force = np.array([float(m.findtext("forceMod", "nan")) for m in models])
        self.variance = np.array([float(m.findtext("var", "nan")) for m in models])
        self.ar = np.array([rows(m.find("ARlsf")) for m in models])
        self.triangles = [[int(v) - 1 for v in rows(tri)] for tri in root.findall("tri")]
        self.max_speed = float(root.findtext("maxSpeed", "nan"))
        self.max_force = float(root.findtext("maxForce", "nan"))

    def query(self, force_N: float, speed_m_s: float) -> tuple[Array, float]:
        """The coefficients of A and the excitation's variance."""
        x, y = min(1e3 * speed_m_s, self.max_speed), min(force_N, self.max_force)
        for triangle in self.triangles:
            corners = np.array([self.speed[triangle], self.force[triangle], np.ones(3)])
            if abs(np.linalg.det(corners)) < 1e-9:
                continue
            weight = np.linalg.solve(corners, [x, y, 1.0])
            if weight.min() >= -1e-12:
                break
        else:
            raise AssertionError("outside of all triangles")
        return polynomial(weight @ self.ar[triangle]), float(weight @ self.variance[triangle])


def values(name: str, numbers: Array, text: str = "{:.6f}") -> str:
    return f"<{name}>" + "".join(f"<value>{text.format(v)}</value>" for v in numbers) + f"</{name}>\n"


def filters(rng: np.random.Generator, count: int, pairs: int, low: float, high: float) -> list[Array]:
    """Return line spectral frequencies of random filters with root pairs of radius `low` to `high`."""
    found = []
    for angle in np.sort(rng.uniform(0.15, 2.9, (count, pairs)), axis=1):
        roots = rng.uniform(low, high, pairs) * np.exp(1j * (0.5 * angle + 0.5 * np.linspace(0.3, 2.7, pairs)))
        a = np.real(np.poly(np.concatenate([roots, roots.conj()])))
        longer = np.append(a, 0)
        angles = [np.angle(np.roots(longer + sign * longer[::-1])) for sign in (1, -1)]
        found.append(np.sort(np.concatenate([w[(w > 1e-6) & (w < np.pi - 1e-6)] for w in angles])))
    return found


def write_models(path: Path, seed: int, pairs: int = 8, side: int = 5) -> Path:
    """A made-up file in the toolkit's layout: an irregular plane, of very unlike models."""
    rng = np.random.default_rng(seed)
    speed, force = map(np.ravel, np.meshgrid(np.linspace(0, 237.5, side), np.linspace(0, 3.1, side)))
    inner = (speed > 0) & (speed < 237.5) & (force > 0) & (force < 3.1)
    speed, force = speed + inner * rng.uniform(-20, 20, speed.size), force + inner * rng.uniform(-0.2, 0.2, force.size)
    triangles = Delaunay(np.stack([speed / 237.5, force / 3.1], axis=1)).simplices + 1
    variance = 1e-4 * speed * force * rng.uniform(0.5, 2, speed.size)
    ar = filters(rng, speed.size, pairs, 0.7, 0.95)
    text = f'<?xml version="1.0" encoding="utf-8"?>\n<modelSet texture="0"><material>Made up {seed}</material>\n'
    text += "<AccelUnits>m/s^2</AccelUnits><SpeedUnits>mm/s</SpeedUnits><ForceUnits>N</ForceUnits>\n"
    text += f"<SampleRate>10000</SampleRate><mu>0.4</mu><numMod>{speed.size}</numMod>"
    text += f"<numTri>{len(triangles)}</numTri><maxSpeed>{speed.max():f}</maxSpeed><maxForce>{force.max():f}</maxForce>"
    text += values("speedList", speed) + values("forceList", force)
    text += "".join(values("tri", tri, "{:d}") for tri in triangles)
    text += f"<numARCoeff>{2 * pairs}</numARCoeff><numMACoeff>0</numMACoeff>"
    for i in range(speed.size):
        text += f"<model><modNum>{i + 1}</modNum>" + values("ARcoeff", polynomial(ar[i]), "{:.20f}")
        text += values("ARlsf", ar[i]) + values("MAcoeff", np.ones(1), "{:.20f}") + "<MAlsf/>"
        text += f"<var>{variance[i]:.10f}</var>"
        text += f"<speedMod>{speed[i]:f}</speedMod><forceMod>{force[i]:f}</forceMod></model>\n"
    path.write_text(text + "</modelSet>\n", encoding="utf-8")
    return path


def places(count: int) -> Array:
    """Forces and speeds: anywhere, on the far sides, beyond them."""
    rng = np.random.default_rng(1)
    inside = rng.uniform(0.01, 1, (count, 2)) * [3.1, 0.2375]
    edge = [[3.1, 0.1], [1.0, 0.2375], [3.1, 0.2375], [9.0, 0.1], [1.0, 2.0], [50.0, 50.0]]
    return np.concatenate([inside, edge])


@pytest.mark.parametrize(("seed", "pairs"), [(0, 7), (1, 8), (2, 10)])
def test_queries_equal_those_of_the_toolkit(tmp_path: Path, seed: int, pairs: int) -> None:
    path = write_models(tmp_path / "Models_x.xml", seed, pairs)
    reference, swatch = Toolkit(path), import_hatt(path)
    assert swatch.texture is not None and swatch.texture.rate_Hz == 10000 and swatch.texture.order == 2 * pairs
    asked = places(100)
    for (force_N, speed_m_s), a, ours in zip(asked, *swatch.texture.models(*asked.T), strict=True):
        theirs, variance = reference.query(force_N, speed_m_s)
        np.testing.assert_allclose(a, theirs, atol=1e-9)
        assert ours == pytest.approx(variance, rel=1e-9)


def test_the_example_files(shared: Path) -> None:
    folder = shared / "data" / "hatt_format"
    swatch = import_hatt(folder / "Models_example.xml", folder / "Taps_example.xml")
    reference = Toolkit(folder / "Models_example.xml")
    assert swatch.name == "Made-up Example" and swatch.friction_static == swatch.friction_dynamic == 0.31
    assert swatch.texture is not None and swatch.taps is not None
    np.testing.assert_array_equal(swatch.texture.triangles, reference.triangles)
    asked = places(100)
    for (force_N, speed_m_s), a, ours in zip(asked, *swatch.texture.models(*asked.T), strict=True):
        theirs, variance = reference.query(force_N, speed_m_s)
        np.testing.assert_allclose(a, theirs, atol=1e-9)
        assert ours == pytest.approx(variance, rel=1e-9)
    np.testing.assert_allclose(swatch.taps.approach_m_s, [0.01, 0.06, 0.2])
    np.testing.assert_allclose(swatch.taps.frequency_Hz, 180.0, rtol=1e-3)  # the file is made of one sinusoid
    np.testing.assert_allclose(swatch.taps.decay_1_s, 80.0, rtol=1e-3)
    assert swatch.taps.transient(0.06, 1000.0).shape == (100,) and "stiffness_N_m" in swatch.absent
    assert "not be passed on" in swatch.licence and "Models_example.xml" in swatch.provenance


def edited(text: str, *changes: tuple[str, str]) -> str:
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return text


def test_unusual_but_valid_files(tmp_path: Path) -> None:
    path = write_models(tmp_path / "Models_x.xml", 0)
    plain, text = import_hatt(path).texture, path.read_text(encoding="utf-8")
    assert plain is not None
    flat = "<tri><value>1</value><value>2</value><value>3</value></tri>\n<tri><value>4</value><value>4</value>"
    flat += "<value>5</value></tri>\n<tri>"
    degenerate = edited(text, ("<tri>", flat))
    odd = {
        "degenerate": degenerate,
        "spaces": text.replace("<value>", "<value>\n\t ").replace("</value>", "  </value>"),
        "comment": text.replace("<tri>", "<!-- a triangle --><tri>"),
        "no units": text.replace("<AccelUnits>m/s^2</AccelUnits><SpeedUnits>mm/s</SpeedUnits>", ""),
    }
    for name, other in odd.items():
        path.write_text(other, encoding="utf-8")
        texture = import_hatt(path).texture
        assert texture == plain, name
    path.write_text(text.replace("<mu>0.4</mu>", ""))
    swatch = import_hatt(path)
    assert swatch.friction_dynamic == 0 and "friction_dynamic" in swatch.absent


@pytest.mark.parametrize("tap", [(2.0, 120.0, 40.0), (-3.0, 60.0, 100.0), (1.0, 350.0, 150.0)])
def test_a_decaying_sinusoid_is_recovered(tap: tuple[float, float, float]) -> None:
    amplitude, frequency_Hz, decay_1_s = tap
    t_s = np.arange(300) / 1000.0
    found = _decaying_sinusoid(amplitude * np.exp(-decay_1_s * t_s) * np.sin(2.0 * np.pi * frequency_Hz * t_s))
    assert found == pytest.approx((abs(amplitude), frequency_Hz, decay_1_s))
    assert _decaying_sinusoid(0.0 * t_s) == (0.0, 100.0, 100.0)


BAD: dict[str, tuple[tuple[str, str], str]] = {
    "unit": (("mm/s</Speed", "furlong</Speed"), r"<SpeedUnits>: expected mm/s, found 'furlong'"),
    "rate": (("10000", "0"), r"<SampleRate>: expected 100 to 1000000 Hz, found 0"),
    "triangle": (("<tri><value>", "<tri><value>9"), r"<tri> 1: .*1 to 25"),
    "negative triangle": (("<tri><value>", "<tri><value>-"), r"<tri> 1: .*1 to 25"),
    "short": (("<ARlsf><value>", "<ARlsf><value>0.001</value><value>"), r"<model> 2: expected 17 ARlsf as in model 1"),
    "nan": (("<var>", "<var>nan "), r"<model> 1, <var>: expected finite numbers, found 'nan"),
    "negative": (("<var>", "<var>-1"), r"<model> 1, <var>: expected a number, 0 or more, found '-1"),
    "zeros": (("<MAcoeff>", "<MAcoeff><value>0.5</value>"), r"<model> 1, <MAcoeff>"),
}


@pytest.mark.parametrize("case", BAD)
def test_errors_name_file_element_and_value(tmp_path: Path, case: str) -> None:
    change, message = BAD[case]
    path = write_models(tmp_path / "Models_x.xml", 0)
    path.write_text(edited(path.read_text(encoding="utf-8"), change), encoding="utf-8")
    with pytest.raises(SwatchError, match=message) as caught:
        import_hatt(path)
    assert str(path) in str(caught.value) and len(str(caught.value)) < 400 + len(str(path))


def test_malicious_xml_is_refused(tmp_path: Path) -> None:
    lol = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 12))
    bombs = {
        "bomb": f'<!DOCTYPE m [<!ENTITY l0 "lol">{lol}]><modelSet><material>&l11;</material></modelSet>'.encode(),
        "utf-16": '<!DOCTYPE m [<!ENTITY x "y">]><modelSet a="&x;"/>'.encode("utf-16"),
        "deep": b"<modelSet>" + b"<a>" * 100_000,
        "large": b"<modelSet>" + b" " * (9 << 20),
        "empty": b"",
    }
    path = tmp_path / "Models_x.xml"
    for data in bombs.values():
        path.write_bytes(data)
        with pytest.raises(SwatchError):
            import_hatt(path)
    with pytest.raises(SwatchError, match="no such file"):
        import_hatt(tmp_path / "none.xml")
    with pytest.raises(SwatchError, match="cannot be read"):
        import_hatt(tmp_path)


def test_import_of_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, out = tmp_path / "in", tmp_path / "out"
    folder.mkdir()
    first = write_models(folder / "Models_0.xml", 0, pairs=3, side=3)
    text = first.read_text(encoding="utf-8")
    for i in range(1, 60):
        (folder / f"Models_{i}.xml").write_text(text.replace("Made up 0", f"Made up {i}"), encoding="utf-8")
    for i in (17, 42):
        (folder / f"Models_{i}.xml").write_text(text[: len(text) // 2], encoding="utf-8")
    (folder / "Models_55.xml").write_text(edited(text, ("<mu>0.4", "<mu>x")), encoding="utf-8")
    assert cli.main(["swatch", "import", str(folder), "-o", str(out)]) == 2
    said = capsys.readouterr()
    assert said.out.count("→") == 57 and "60/60" in said.out
    assert len(said.err.splitlines()) == 3 and all(name in said.err for name in ("_17.xml", "_42.xml", "_55.xml"))
    assert len(list(out.iterdir())) == 57
    assert load_swatch(out / "59.swatch").name == "Made up 59"
    assert cli.main(["swatch", "import", str(first), "-o", str(out)]) == 0


def test_taps_and_models_are_paired_by_name(tmp_path: Path, shared: Path) -> None:
    folder = shared / "data" / "hatt_format"
    for name in ("a", "b"):
        shutil.copy(folder / "Models_example.xml", tmp_path / f"Models_{name}.xml")
    shutil.copy(folder / "Taps_example.xml", tmp_path / "Taps_b.xml")
    assert import_many([tmp_path, tmp_path / "Models_a.xml"], tmp_path / "out", print) == []
    a, b = (load_swatch(tmp_path / "out" / f"{name}.swatch") for name in "ab")
    assert a.taps is None and b.taps is not None and b.taps.wave_m_s2 is not None
    (tmp_path / "Models_b.xml").unlink()
    with pytest.raises(SwatchError, match="Models_b"):
        import_many([tmp_path], tmp_path / "out", print)
