"""File formats to fuzz: for each, a small valid file and its reader."""

import io
import json
import re
import struct
import tempfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.io import savemat, wavfile

import hapscene
from hapscene.capture.io.hatt import import_hatt, read_taps
from hapscene.capture.io.recording import load_recording
from hapscene.constants import UNITLESS
from hapscene.dsp.ar_filter import ar_from_reflection
from hapscene.exchange import export_scene, import_scene
from hapscene.handle.fit import Identification, IdentifiedGrip
from hapscene.handle.handle_file import handle_to_json, load_handle
from hapscene.handle.plant import Plant
from hapscene.io.probe_protocol import Column, Decoder, Header, sample_line
from hapscene.motion.path_file import load_path
from hapscene.paint.web.socket import number, parse, pointer_of
from hapscene.parallel import Journal
from hapscene.render import recording
from hapscene.scene.mesh import Mesh
from hapscene.scene.mesh_doctor import examine
from hapscene.scene.mesh_file import load_mesh
from hapscene.scene.region import Sphere
from hapscene.scene.scene import Scene
from hapscene.study.plan import load_plan
from hapscene.study.session import Session, load_rows
from hapscene.study.statistics import analyse
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_file import save_swatch
from hapscene.surface.taps import Taps
from hapscene.surface.texture import Texture
from hapscene.swatches import library
from tests.header_line import header_line

Files = Mapping[str, bytes]
"""Contents by file name: first the file to damage, then the files it refers to."""


@dataclass(frozen=True)
class Format:
    """One format.

    Attributes:
        make: returns the valid file; the suffix of its name selects the reader.
        read: the reader. An integer result is the number of elements (faces, samples) it read.
        soak, quick: number of mutants in the long run and in the short run.
        left: counts the elements in a text with one element a line, which is still valid when it is cut after a line.
            For other formats, reading a cut file without a warning must give all elements of the valid file.
        roams: whether the file may refer to files in any folder.
        file: whether error messages must name the file; False for messages of a connection.
    """

    make: Callable[[], Files]
    read: Callable[[Path], Any]
    soak: int = 350
    quick: int = 12
    left: Callable[[bytes], int] | None = None
    roams: bool = False
    file: bool = True


def lines(pattern: str) -> Callable[[bytes], int]:
    return lambda content: len(re.findall(f"(?im)^{pattern}".encode(), content))


# Meshes.


def ball(suffix: str, **options: Any) -> Callable[[], Files]:
    def make() -> Files:
        made = trimesh.creation.icosphere(subdivisions=1, radius=9.0).export(file_type=suffix, **options)
        return {f"x.{suffix.removesuffix('_ascii')}": made.encode() if isinstance(made, str) else made}

    return make


def strips(kind: str) -> Callable[[], Files]:
    """The ball as a PLY file with one list of triangle strips, each of which is one triangle."""

    def make() -> Files:
        mesh = trimesh.creation.icosphere(subdivisions=1, radius=9.0)
        corners = np.column_stack([mesh.faces, np.full(len(mesh.faces), -1)]).ravel()
        header = (
            f"ply\nformat {kind} 1.0\nelement vertex {len(mesh.vertices)}\nproperty float x\nproperty float y\n"
            "property float z\nelement tristrips 1\nproperty list int int vertex_indices\nend_header\n"
        ).encode()
        if kind == "ascii":
            rows = [*mesh.vertices.tolist(), [len(corners), *corners.tolist()]]
            return {"x.ply": header + "".join(" ".join(map(str, row)) + "\n" for row in rows).encode()}
        lists = np.array([len(corners), *corners], "<i4").tobytes()
        return {"x.ply": header + mesh.vertices.astype("<f4").tobytes() + lists}

    return make


def obj() -> Files:
    text = ball("obj")()["x.obj"].replace(b"\nf ", b"\ng upper\nusemtl oak\nf ", 1)
    return {"x.obj": b"mtllib x.mtl\no ball\n" + text, "x.mtl": b"newmtl oak\nKd 0.8 0.5 0.2\n"}


def gltf() -> Files:
    made = trimesh.Scene(trimesh.creation.icosphere(subdivisions=1)).export(file_type="gltf")
    return {"x.gltf": made.pop("model.gltf"), **made}


def step() -> Files:
    """A cube of 9 mm as a faceted solid: the shortest STEP with a shape."""
    text: list[str] = []

    def put(line: str, *ids: str) -> str:
        text.append(f"#{len(text) + 1}={line % ids if ids else line};")
        return f"#{len(text)}"

    corners = 9.0 * np.array([(i >> 2, i >> 1 & 1, i & 1) for i in range(8)])
    point = [put(f"CARTESIAN_POINT('',({x},{y},{z}))") for x, y, z in corners]
    faces = []
    for face in ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)):
        bound = put("FACE_OUTER_BOUND('',%s,.T.)", put("POLY_LOOP('',(%s,%s,%s,%s))", *(point[i] for i in face)))
        u, v = corners[face[1]] - corners[face[0]], corners[face[2]] - corners[face[0]]
        axes = [put("DIRECTION('',({},{},{}))".format(*axis)) for axis in (np.cross(u, v) / 81.0, u / 9.0)]
        plane = put("PLANE('',%s)", put("AXIS2_PLACEMENT_3D('',%s,%s,%s)", point[face[0]], *axes))
        faces.append(put("FACE_SURFACE('',(%s),%s,.T.)", bound, plane))
    solid = put("FACETED_BREP('',%s)", put("CLOSED_SHELL('',(%s,%s,%s,%s,%s,%s))", *faces))
    unit = put("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))")
    context = "GLOBAL_UNIT_ASSIGNED_CONTEXT((%s))REPRESENTATION_CONTEXT('','')"
    space = put(f"(GEOMETRIC_REPRESENTATION_CONTEXT(3){context})", unit)
    place = put("AXIS2_PLACEMENT_3D('',%s,$,$)", point[0])
    shape = put("FACETED_BREP_SHAPE_REPRESENTATION('',(%s,%s),%s)", place, solid, space)
    use = put("APPLICATION_CONTEXT('automotive design')")
    product = put("PRODUCT('cube','cube','',(%s))", put("PRODUCT_CONTEXT('',%s,'mechanical')", use))
    version = put("PRODUCT_DEFINITION_FORMATION('','',%s)", product)
    design = put("PRODUCT_DEFINITION_CONTEXT('part definition',%s,'design')", use)
    whole = put("PRODUCT_DEFINITION_SHAPE('','',%s)", put("PRODUCT_DEFINITION('','',%s,%s)", version, design))
    put("SHAPE_DEFINITION_REPRESENTATION(%s,%s)", whole, shape)
    head = "FILE_DESCRIPTION((''),'2;1');\nFILE_NAME('','',(''),(''),'','','');\nFILE_SCHEMA(('AUTOMOTIVE_DESIGN'));"
    file_lines = ["ISO-10303-21;\nHEADER;", head, "ENDSEC;\nDATA;", *text, "ENDSEC;\nEND-ISO-10303-21;\n"]
    return {"x.step": "\n".join(file_lines).encode()}


def read_mesh(path: Path) -> int:
    mesh = load_mesh(path, "mm" if path.suffix[1:] in UNITLESS else None)
    examine(mesh).text()
    return len(mesh.faces)


# Scenes and swatches.


@cache
def swatch() -> Swatch:
    rng = np.random.default_rng(0)
    a = ar_from_reflection(rng.uniform(-0.5, 0.5, (3, 4)))
    texture = Texture.from_models(
        1e4, np.array([1.0, 2.0, 1.5]), np.array([0.1, 0.1, 0.2]), a=a, variance_m2_s4=rng.uniform(0, 1, 3)
    )
    taps = Taps([0.1, 0.2], [1.0, 2.0], [90.0, 80.0], [50.0, 60.0], rng.standard_normal((2, 8)), 1e4)
    return Swatch(
        "oak", 500.0, 0.1, 0.3, 0.2, texture, taps, (0.1, 0.5, 1.0), "made up", "MIT", {"wall": {}},
        {"friction_dynamic": (0.1, 0.3)}, {"damping_Ns_m": "not measured"},
    )  # fmt: skip


def scene() -> Scene:
    shape = trimesh.creation.icosphere(subdivisions=0, radius=0.03)
    group = (np.arange(20) % 2).astype(np.int16)
    made = Scene()
    made.add(Mesh(np.asarray(shape.vertices), np.asarray(shape.faces, np.int32), group, ("lid", "base")), name="ball")
    made.swatch_index(swatch())
    made.bodies[0].face_swatch[:10] = 1
    return made


def written(write: Callable[[Path], object], name: str) -> Callable[[], Files]:
    """Return a function that runs a writer in a temporary folder and returns the files it wrote."""

    def make() -> Files:
        with tempfile.TemporaryDirectory() as place:
            write(Path(place) / name)
            files = sorted(Path(place).iterdir(), key=lambda file: file.name != name)
            return {file.name: file.read_bytes() for file in files}

    return make


def read_painted(path: Path) -> int:
    return sum(len(body.mesh.faces) for body in import_scene(path).bodies)


def hatt_models(path: Path) -> None:
    places = [(0.0, 0.0), (0.0, 2.0), (100.0, 0.0), (100.0, 2.0)]
    models = (
        f"<model><modNum>{number}</modNum><ARlsf>0.3 0.9 1.8 2.6</ARlsf><var>{0.1 * number}</var>"
        f"<speedMod>{speed}</speedMod><forceMod>{force}</forceMod></model>"
        for number, (speed, force) in enumerate(places, 1)
    )
    head = "<SampleRate>10000</SampleRate><mu>0.4</mu><numMod>4</numMod><tri>1 2 3</tri><tri>2 3 4</tri>"
    path.write_text(f"<modelSet>{head}{''.join(models)}</modelSet>", encoding="utf-8")


def hatt_taps(path: Path) -> None:
    waves = np.random.default_rng(0).normal(size=(3, 20)).round(4)
    taps = (
        f"<tap><tapSpeed>{20 * k}</tapSpeed><tapAccel>{' '.join(map(str, wave))}</tapAccel></tap>"
        for k, wave in enumerate(waves.tolist(), 1)
    )
    path.write_text(f"<tapSet><numTap>3</numTap>{''.join(taps)}</tapSet>", encoding="utf-8")


# The handle and the journal.


def handle() -> Files:
    grip = IdentifiedGrip("light", 151.2, 2.7, 0.9997, 0.87, {"k_u_N_m": (140.1, 163.0)}, {"b_u_Ns_m": "noise"})
    numbers: dict[str, Any] = {"asymptote_kg": 0.3, "delay_s": 0.0, "accelerometer_Hz": 1600.0, "rate_Hz": 1e4}
    numbers |= {"asymptote_Hz": (160.0, 320.0), "band_Hz": (10.0, 1000.0), "misfit": 1.0, "provenance": "a bench"}
    said: dict[str, Any] = {"intervals": {"m_h_kg": (0.2, 0.3)}, "absent": {"m_c_kg": "one"}}
    return {
        "x.handle": handle_to_json(
            Identification(name="ours", plant=Plant(), grips=(grip,), **said, **numbers)
        ).encode()
    }


def journal() -> Files:
    return {"x.jsonl": b'{"key": "/r/a.csv", "digest": "00", "result": "a.swatch"}\n{"key": "/r/b.csv", "dig'}


# Recordings and paths.


def columns(count: int) -> dict[str, np.ndarray]:
    names = ("acceleration_x", "acceleration_y", "acceleration_z", "force", "speed")
    return dict(zip(names, np.random.default_rng(0).standard_normal((5, count)).round(3), strict=True))


def table() -> Files:
    data = {"time": np.arange(120) / 1000} | columns(120)
    rows = [",".join(map(str, row)) for row in zip(*data.values(), strict=True)]
    return {"x.csv": "\n".join([",".join(data), *rows, ""]).encode()}


def wav() -> Files:
    out = io.BytesIO()
    wavfile.write(out, 10_000, (1e4 * columns(300)["force"]).astype(np.int16))
    return {"x.wav": out.getvalue()}


def npz() -> Files:
    out = io.BytesIO()
    np.savez_compressed(out, rate_Hz=1e3, units=np.array(["force=N"]), **columns(120))
    return {"x.npz": out.getvalue()}


def mat() -> Files:
    out = io.BytesIO()
    savemat(out, {"rate_Hz": 1e3, **columns(120)}, do_compression=False)
    return {"x.mat": b"MATLAB 5.0 MAT-file".ljust(116) + out.getvalue()[116:]}  # without the date


def record() -> Files:
    named = [{"name": name, "unit": unit, "scale": 0.001} for name, unit in (("acceleration", "m/s2"), ("force", "N"))]
    head = {"rate_Hz": 1000.0, "started": "2026-01-01", "columns": named}
    counts = np.arange(100, dtype="<i4").tobytes()
    chunks = [
        (b"HEAD", 0, json.dumps(head).encode()),
        (b"DATA", 0, counts),
        (b"DATA", 50, counts),
        (b"END.", 0, b'{"ended": "stop"}'),
    ]
    bodies = [struct.pack("<4sIQ", kind, len(payload), first) + payload for kind, first, payload in chunks]
    return {"x.hsrec": b"hapscene record 1\n" + b"".join(b + struct.pack("<I", zlib.crc32(b)) for b in bodies)}


def read_recording(path: Path) -> int:
    known = {"acceleration": "m/s2", "force": "N", "speed": "m/s", "time": "s"}
    units, named = {".wav": ({"acceleration": "m/s2"}, {"acceleration": "1"}), ".hsrec": (None, None)}.get(
        path.suffix, (known, None)
    )
    return len(load_recording(path, columns=named, units=units).acceleration_m_s2)


def path_csv() -> Files:
    rows = [f"{0.001 * i:.3f},{0.01 * i:.2f},0,{0.05 - 0.001 * i:.3f}" for i in range(40)]
    return {"x.csv": "\n".join(["t,x,y,z", *rows, ""]).encode()}


def touch() -> Files:
    out = io.BytesIO()
    rows = {
        name: np.zeros((5, *((10,) if row is None else row)), kind) for name, (kind, row) in recording._COLUMNS.items()
    }
    names = {"body_names": np.array(["a"]), "swatch_names": np.array(["oak"]), "effects": np.array(["wall"])}
    np.savez(out, format_version=recording.FORMAT_VERSION, a_rate_Hz=1e4, seed=0, **rows, **names)  # type: ignore[arg-type]
    return {"x.npz": out.getvalue()}


# Messages of a connection: the file holds the received bytes.


def serial() -> Files:
    head = header_line(Header(1000.0, (Column("acceleration", "m/s2", 0.001), Column("force", "N", 0.001))))
    return {"x.serial": head + b"".join(sample_line(i, (i, -i)) for i in range(40))}


def read_serial(path: Path) -> None:
    decoder, data = Decoder(), path.read_bytes()
    for i in range(0, len(data), 37):  # in chunks, as a serial port delivers them
        decoder.feed(data[i : i + 37], 1e-3 * i)


def page() -> Files:
    message = {"do": "down", "client": 3, "x": 0.5, "y": -0.5, "w": 800, "h": 600, "value": 2.0, "factor": 1.5}
    return {"x.page": json.dumps(message).encode()}


def read_page(path: Path) -> None:
    if (message := parse(path.read_bytes().decode(errors="replace"))) is not None:
        pointer_of(message)
        number(message, "value", -1e9, 1e9)


STUDY = b"""title = "t"
people = 2
stimuli.a.swatch = "wood"
stimuli.b = {swatch = "wood", life = false}
[[blocks]]
name = "rated"
kind = "rating"
stimuli = ["a", "b"]
repeats = 2
[[blocks]]
name = "compared"
kind = "2ifc"
pairs = [["a", "b"]]
repeats = 3
margin = 0.5
[[blocks]]
name = "gain"
kind = "staircase"
stimulus = "a"
parameter = "gain_dB"
levels = [0.5, 8.0, 5]
trials = 5
"""


def answers() -> Files:
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "x.toml").write_bytes(STUDY)
        plan = load_plan(Path(folder) / "x.toml")
        for person in ("P01", "P02"):
            with Session(plan, Path(folder) / "x", person) as session:
                while session.trial is not None:
                    session.answer(session.trial.number % 2, latency_s=1.0)
        return {"results.csv": (Path(folder) / "x" / "results.csv").read_bytes(), "plan.toml": STUDY}


def read_answers(path: Path) -> int:
    analyse(path.parent)
    return len(load_rows(path))


def painted(name: str, *, fine: bool = False, quick: int = 12) -> Format:
    def write(path: Path) -> None:
        made = scene()
        if fine:
            made.paint("ball", "wood", Sphere((0.0, 0.0, 0.03), 0.02), resolution_m=0.01, falloff_m=0.01)
        export_scene(made, path)

    return Format(written(write, name), read_painted, quick=quick)


FORMATS: Mapping[str, Format] = {
    "stl": Format(ball("stl"), read_mesh),
    "stl-text": Format(ball("stl_ascii"), read_mesh, left=lines(r" *facet +normal")),
    "obj": Format(obj, read_mesh, left=lines(r"f +\S+ +\S+ +\S+")),
    "ply": Format(ball("ply"), read_mesh),
    "ply-text": Format(ball("ply", encoding="ascii"), read_mesh),
    "ply-strips": Format(strips("binary_little_endian"), read_mesh),
    "ply-strips-text": Format(strips("ascii"), read_mesh),
    "off": Format(ball("off"), read_mesh),
    "glb": Format(ball("glb"), read_mesh),
    "gltf": Format(gltf, read_mesh),
    "step": Format(step, read_mesh, soak=90, quick=2),
    "painted-glb": painted("x.glb"),
    "fine-glb": painted("x.glb", fine=True),
    "scene": Format(
        written(lambda path: scene().save(path), "x.scene.json"),
        lambda path: sum(len(body.mesh.faces) for body in hapscene.load_scene(path).bodies),
        roams=True,
    ),
    "swatch": Format(written(lambda path: save_swatch(swatch(), path), "x.swatch"), library.load_swatch),
    "library": Format(
        written(lambda path: library.add(swatch(), path.parent), library.INDEX),
        lambda path: len(library.search(library.own_entries(path.parent), ["a"])),
    ),
    "hatt-models": Format(written(hatt_models, "Models_x.xml"), import_hatt),
    "hatt-taps": Format(written(hatt_taps, "Taps_x.xml"), read_taps),
    "handle": Format(handle, load_handle),
    "journal": Format(journal, lambda path: len(Journal(path).results), left=lambda content: 0),
    "csv": Format(table, read_recording, left=lines(r"(?!time).*\d")),
    "wav": Format(wav, read_recording),
    "npz": Format(npz, read_recording),
    "mat": Format(mat, read_recording, soak=300, quick=2),
    "hsrec": Format(record, read_recording),
    "path": Format(path_csv, lambda path: len(load_path(path, 0.001)[0]), left=lines(r"(?!t,).*\d")),
    "touch": Format(touch, lambda path: len(recording.load_touch(path))),
    "study": Format(lambda: {"x.toml": STUDY}, load_plan),
    "answers": Format(answers, read_answers, left=lines(r"(?!person).*\d")),
    "serial": Format(serial, read_serial, file=False),
    "page": Format(page, read_page, file=False),
}
