"""Every format that is read from strangers: a small good file made by a writer, its reader, and what it promises."""

import io
import json
import re
import struct
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

Files = Mapping[str, bytes]
"""Contents by name: the file that is broken first, then those beside it."""


@dataclass(frozen=True)
class Format:
    """One format.

    Attributes:
        make: the good file, made anew; its name's suffix is what readers go by.
        read: the reader: takes the path, gives how many elements (faces, samples) were read, 0 where none are counted.
        soak: mutants in the long run; `quick` in the short one.
        promised: how many elements a content says that it holds, where it says so itself. A file cut short that
            gives fewer, and no warning, is silently smaller; without this, one that gives fewer than the good file.
        roams: whether it may name files anywhere, to be read.
        file: whether it is a file, which messages name; else what comes over a line.
    """

    make: Callable[[], Files]
    read: Callable[[Path], int]
    soak: int = 420
    quick: int = 24
    promised: Callable[[bytes], int] | None = None
    roams: bool = False
    file: bool = True


def rows(pattern: str) -> Callable[[bytes], int]:
    """Counts what a text holds of a kind: it has no count of its own, so what is left of it is a whole file."""
    return lambda content: len(re.findall(pattern.encode(), content))


# Meshes.


def ball(suffix: str, **options: Any) -> Callable[[], Files]:
    def make() -> Files:
        import trimesh

        made = trimesh.creation.icosphere(subdivisions=1, radius=9.0).export(file_type=suffix, **options)
        return {f"x.{suffix.removesuffix('_ascii')}": made.encode() if isinstance(made, str) else made}

    return make


def obj() -> Files:
    text = ["mtllib x.mtl", "o ball", *ball("obj")()["x.obj"].decode().splitlines()[1:]]
    first = next(i for i, line in enumerate(text) if line.startswith("f "))
    text[first:first] = ["g upper", "usemtl oak"]
    return {"x.obj": "\n".join(text).encode(), "x.mtl": b"newmtl oak\nKd 0.8 0.5 0.2\n"}


def gltf() -> Files:
    import trimesh

    made = trimesh.Scene(trimesh.creation.icosphere(subdivisions=1)).export(file_type="gltf")
    return {"x.gltf": made.pop("model.gltf"), **made}


def packed() -> Files:
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as out:
        for name, content in obj().items():
            out.writestr(name, content)
    return {"x.zip": archive.getvalue()}


def step() -> Files:
    """A cube of 9 mm as a faceted solid, the shortest STEP with a shape."""
    lines: list[str] = []

    def put(text: str, *ids: str) -> str:
        lines.append(f"#{len(lines) + 1}={text % ids if ids else text};")
        return f"#{len(lines)}"

    corners = 9.0 * np.array([(i >> 2, i >> 1 & 1, i & 1) for i in range(8)])
    point = [put(f"CARTESIAN_POINT('',({x},{y},{z}))") for x, y, z in corners]
    faces = []
    for face in ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)):
        loop = put("POLY_LOOP('',(%s,%s,%s,%s))", *(point[i] for i in face))
        bound = put("FACE_OUTER_BOUND('',%s,.T.)", loop)
        u, v = corners[face[1]] - corners[face[0]], corners[face[2]] - corners[face[0]]
        axes = [put("DIRECTION('',({},{},{}))".format(*axis)) for axis in (np.cross(u, v) / 81.0, u / 9.0)]
        plane = put("PLANE('',%s)", put("AXIS2_PLACEMENT_3D('',%s,%s,%s)", point[face[0]], *axes))
        faces.append(put("FACE_SURFACE('',(%s),%s,.T.)", bound, plane))
    solid = put("FACETED_BREP('',%s)", put("CLOSED_SHELL('',(%s,%s,%s,%s,%s,%s))", *faces))
    place = put("AXIS2_PLACEMENT_3D('',%s,$,$)", point[0])
    metre = put("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))")
    angle = put("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))")
    space = put(
        "(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNIT_ASSIGNED_CONTEXT((%s,%s))REPRESENTATION_CONTEXT('',''))",
        *(metre, angle),
    )
    shape = put("FACETED_BREP_SHAPE_REPRESENTATION('',(%s,%s),%s)", place, solid, space)
    use = put("APPLICATION_CONTEXT('automotive design')")
    product = put("PRODUCT('cube','cube','',(%s))", put("PRODUCT_CONTEXT('',%s,'mechanical')", use))
    formation = put("PRODUCT_DEFINITION_FORMATION('','',%s)", product)
    context = put("PRODUCT_DEFINITION_CONTEXT('part definition',%s,'design')", use)
    whole = put("PRODUCT_DEFINITION_SHAPE('','',%s)", put("PRODUCT_DEFINITION('','',%s,%s)", formation, context))
    put("SHAPE_DEFINITION_REPRESENTATION(%s,%s)", whole, shape)
    head = "FILE_DESCRIPTION((''),'2;1');\nFILE_NAME('','',(''),(''),'','','');\nFILE_SCHEMA(('AUTOMOTIVE_DESIGN'));"
    text = ["ISO-10303-21;\nHEADER;", head, "ENDSEC;\nDATA;", *lines, "ENDSEC;\nEND-ISO-10303-21;\n"]
    return {"x.step": "\n".join(text).encode()}


def read_mesh(path: Path) -> int:
    from hapscene.scene.mesh_doctor import examine
    from hapscene.scene.mesh_file import UNITLESS, load_mesh

    mesh = load_mesh(path, "mm" if path.suffix[1:] in (*UNITLESS, "zip") else None)
    examine(mesh).text()
    return len(mesh.faces)


# Scenes and swatches.


@cache
def swatch() -> Any:
    from hapscene.dsp.ar_filter import ar_from_reflection
    from hapscene.surface.swatch import Swatch
    from hapscene.surface.taps import Taps
    from hapscene.surface.texture import Texture

    rng = np.random.default_rng(0)
    a = ar_from_reflection(rng.uniform(-0.5, 0.5, (3, 4)))
    texture = Texture.from_models(1e4, np.array([1.0, 2.0, 1.5]), np.array([0.1, 0.1, 0.2]), a, rng.uniform(0, 1, 3))
    taps = Taps([0.1, 0.2], [1.0, 2.0], [90.0, 80.0], [50.0, 60.0], rng.standard_normal((2, 8)), 1e4)
    return Swatch(
        "oak", 500.0, 0.1, 0.3, 0.2, texture, taps, (0.1, 0.5, 1.0), "made up", "MIT", {"wall": {}},
        {"friction_dynamic": (0.1, 0.3)}, {"damping_Ns_m": "not measured"},
    )  # fmt: skip


def small_scene() -> Any:
    import trimesh

    from hapscene.scene.mesh import Mesh
    from hapscene.scene.scene import Scene

    shape = trimesh.creation.icosphere(subdivisions=0, radius=0.03)
    group = (np.arange(20) % 2).astype(np.int16)
    scene = Scene()
    scene.add(Mesh(np.asarray(shape.vertices), np.asarray(shape.faces, np.int32), group, ("lid", "base")), name="ball")
    scene.swatch_index(swatch())
    scene.bodies[0].face_swatch[:10] = 1
    return scene


def written(write: Callable[[Any, Path], object], name: str) -> Callable[[], Files]:
    """What a writer makes, given a place to write to."""

    def make() -> Files:
        import tempfile

        with tempfile.TemporaryDirectory() as place:
            write(small_scene() if name.endswith((".scene.json", ".glb", ".ply", ".x3d")) else swatch(), Path(place) / name)
            first, rest = Path(place) / name, sorted(Path(place).iterdir())
            return {file.name: file.read_bytes() for file in (first, *(f for f in rest if f != first))}

    return make


def export(scene: Any, path: Path) -> None:
    from hapscene.exchange import export_scene

    export_scene(scene, path)


def read_painted(path: Path) -> int:
    from hapscene.exchange import import_scene

    return sum(len(body.mesh.faces) for body in import_scene(path, "m" if path.suffix == ".ply" else None).bodies)


def read_scene(path: Path) -> int:
    import hapscene

    return sum(len(body.mesh.faces) for body in hapscene.load_scene(path).bodies)


def save_swatch(made: Any, path: Path) -> None:
    from hapscene.surface.swatch_file import save_swatch

    save_swatch(made, path)


def read_swatch(path: Path) -> int:
    from hapscene.surface.library import load_swatch

    load_swatch(path)
    return 0


def add_to_library(made: Any, path: Path) -> None:
    from hapscene.surface.library import add

    add(made, path.parent)


def read_library(path: Path) -> int:
    from hapscene.surface.library import own_entries, search

    return len(search(own_entries(path.parent), ["a"]))


def hatt_models(made: Any, path: Path) -> None:
    from hapscene.capture.hatt import export_hatt

    export_hatt(made, path)


def read_hatt_models(path: Path) -> int:
    from hapscene.capture.hatt import import_hatt

    import_hatt(path)
    return 0


def hatt_taps(made: Any, path: Path) -> None:
    from hapscene.capture.hatt import export_hatt

    export_hatt(made, path.with_name("models.xml"), path)
    path.with_name("models.xml").unlink()


def read_hatt_taps(path: Path) -> int:
    from hapscene.capture.hatt_file import read_taps

    read_taps(path)
    return 0


# The handle, batches, cases.


def handle() -> Files:
    from hapscene.handle.fit import Identification, IdentifiedGrip
    from hapscene.handle.handle_file import handle_to_json
    from hapscene.handle.plant import Plant

    grip = IdentifiedGrip("light", 151.2, 2.7, 0.9997, 0.87, {"k_u_N_m": (140.1, 163.0)}, {"b_u_Ns_m": "noise"})
    numbers: dict[str, Any] = {"asymptote_kg": 0.3, "delay_s": 0.0, "accelerometer_Hz": 1600.0, "rate_Hz": 1e4}
    numbers |= {"asymptote_Hz": (160.0, 320.0), "band_Hz": (10.0, 1000.0), "misfit": 1.0, "provenance": "a bench"}
    made = Identification(
        name="ours", plant=Plant(), grips=(grip,), intervals={"m_h_kg": (0.2, 0.3)}, absent={"m_c_kg": "one"}, **numbers
    )
    return {"x.handle": handle_to_json(made).encode()}


def read_handle(path: Path) -> int:
    from hapscene.handle.handle_file import load_handle

    return len(load_handle(path).grips)


def batch_list() -> Files:
    return {"x.list.csv": b'recording,name,rate,units\na.csv,oak,10000,"force=N,speed=mm/s"\nb.wav,ash,,\n'}


def read_batch_list(path: Path) -> int:
    from hapscene.capture.batch import outputs, read_list

    return len(outputs(read_list(path)))


def manifest() -> Files:
    from hapscene.capture import batch

    row = {"recording": "/r/a.csv", "output": "a.swatch", "status": "ok", "sha256": "0" * 64, "duration_s": 1.5}
    entry = vars(batch.ManifestEntry(**row))  # type: ignore[arg-type]
    content = {"format": batch.FORMAT, "version": batch.VERSION, "recordings": [entry]}
    return {batch.NAME: json.dumps(content).encode()}


def read_manifest(path: Path) -> int:
    from hapscene.capture.batch import Manifest

    found = Manifest(path.parent)
    found.check_outputs()
    return len(found.entries)


def wall_cases() -> Files:
    setup = {"m": 0.072, "b": 0.005, "c": 0, "D": 0, "T": 0.001, "delay": 0, "B": 0}
    case = {"id": "W1-a", "what": "critical K [N/m]", "setup": setup, "expected": 10.0, "rel_tol": 0.001}
    return {"x.json": json.dumps([case, case | {"id": "W2-a"}]).encode()}


def read_wall_cases(path: Path) -> int:
    from hapscene.stability.wall_case import read_cases

    return len(read_cases(path))


# Recordings and paths.


def columns(count: int = 300) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    names = ("acceleration_x", "acceleration_y", "acceleration_z", "force", "speed")
    return {name: np.round(rng.standard_normal(count), 3) for name in names}


def table() -> Files:
    data = columns(120)
    lines = [",".join(("time", *data)), *(",".join(map(str, (i / 1000, *row))) for i, row in enumerate(zip(*data.values(), strict=True)))]
    return {"x.csv": "\n".join(lines).encode() + b"\n"}


def wav() -> Files:
    from scipy.io import wavfile

    out = io.BytesIO()
    wavfile.write(out, 10_000, (1e4 * columns()["force"]).astype(np.int16))
    return {"x.wav": out.getvalue()}


def npz() -> Files:
    out = io.BytesIO()
    np.savez_compressed(out, rate_Hz=1e3, units=np.array(["force=N"]), **columns())
    return {"x.npz": out.getvalue()}


def mat(packed: bool) -> Callable[[], Files]:
    def make() -> Files:
        from scipy.io import savemat

        out = io.BytesIO()
        savemat(out, {"rate_Hz": 1e3, **columns(120)}, do_compression=packed)
        return {"x.mat": b"MATLAB 5.0 MAT-file".ljust(116) + out.getvalue()[116:]}  # the date is taken out

    return make


def record() -> Files:
    import zlib

    columns = [{"name": name, "unit": unit, "scale": 0.001} for name, unit in (("acceleration", "m/s2"), ("force", "N"))]
    head = {"rate_Hz": 1000.0, "started": "2026-01-01", "columns": columns}
    counts = np.arange(100, dtype="<i4").reshape(50, 2).tobytes()
    chunks = [(b"HEAD", 0, json.dumps(head).encode()), (b"DATA", 0, counts), (b"DATA", 50, counts), (b"END.", 0, b'{"ended": "stop"}')]
    bodies = [struct.pack("<4sIQ", kind, len(payload), first) + payload for kind, first, payload in chunks]
    return {"x.hsrec": b"hapscene record 1\n" + b"".join(b + struct.pack("<I", zlib.crc32(b)) for b in bodies)}


def read_recording(path: Path) -> int:
    from hapscene.capture.recording_file import load_recording

    units = {"acceleration": "m/s2", "force": "N", "speed": "m/s", "time": "s"}
    columns = {"acceleration": "1"} if path.suffix == ".wav" else None
    own = None if path.suffix == ".hsrec" else {k: v for k, v in units.items() if columns is None or k in columns}
    return len(load_recording(path, columns=columns, units=own).acceleration_m_s2)


def path_csv() -> Files:
    lines = [f"{0.001 * i:.3f},{0.01 * i:.2f},0,{0.05 - 0.001 * i:.3f}" for i in range(40)]
    return {"x.csv": "\n".join(["t,x,y,z", *lines, ""]).encode()}


def read_path(path: Path) -> int:
    from hapscene.motion.path_file import load_path

    return len(load_path(path, 0.001)[0])


def touch() -> Files:
    from hapscene import recording

    out, n = io.BytesIO(), 5
    arrays: dict[str, Any] = {}
    for name, (kind, row) in recording._COLUMNS.items():
        arrays[name] = np.zeros((n, *((10,) if row is None else row)), kind)
    arrays |= {"body_names": np.array(["a"]), "swatch_names": np.array(["oak"]), "effects": np.array(["wall"])}
    np.savez(out, format_version=recording.FORMAT_VERSION, a_rate_Hz=1e4, seed=0, **arrays)
    return {"x.npz": out.getvalue()}


def read_touch(path: Path) -> int:
    from hapscene.recording import load_touch

    return len(load_touch(path))


# What comes over a line: what a file holds is what was received.


def serial() -> Files:
    from hapscene.wire.protocol import Column, Header, header_line, sample_line

    head = header_line(Header(1000.0, (Column("acceleration", "m/s2", 0.001), Column("force", "N", 0.001))))
    return {"x.serial": head + b"".join(sample_line(i, (i, -i)) for i in range(40))}


def read_serial(path: Path) -> int:
    from hapscene.wire.protocol import Decoder

    decoder, data = Decoder(), path.read_bytes()
    for i in range(0, len(data), 37):  # in pieces, as a port gives them
        decoder.feed(data[i : i + 37], 1e-3 * i)
    return 0


def datagram() -> Files:
    from hapscene.teleoperation.datagram import MESSAGE, pack

    message = np.zeros(1, MESSAGE)[0]
    message["tick"], message["p_WT_m"] = 3, (0.1, 0.2, 0.3)
    return {"x.udp": pack(message, 0, 7)}


def read_datagram(path: Path) -> int:
    from hapscene.teleoperation.datagram import MESSAGE, Gate

    message = np.zeros(1, MESSAGE)[0]
    if Gate(0).admit(path.read_bytes(), message):
        numbers = np.concatenate([np.ravel(message[name]).astype(float) for name in MESSAGE.names or ()])
        assert np.isfinite(numbers).all(), "a number that is none was let in"
    return 0


def page() -> Files:
    message = {"do": "down", "client": 3, "x": 0.5, "y": -0.5, "w": 800, "h": 600, "value": 2.0, "factor": 1.5}
    return {"x.page": json.dumps(message).encode()}


def read_page(path: Path) -> int:
    from hapscene.paint.web.page_socket import number, parse, pointer_of

    message = parse(path.read_bytes().decode(errors="replace"))
    if message is not None:
        pointer_of(message)
        number(message, "value", -1e9, 1e9)
    return 0


FORMATS: Mapping[str, Format] = {
    "stl": Format(ball("stl"), read_mesh),
    "stl-text": Format(ball("stl_ascii"), read_mesh, promised=rows(r"(?i)\bfacet +normal")),
    "obj": Format(obj, read_mesh, promised=rows(r"(?m)^f +\S+ +\S+ +\S+")),
    "ply": Format(ball("ply"), read_mesh),
    "ply-text": Format(ball("ply", encoding="ascii"), read_mesh),
    "off": Format(ball("off"), read_mesh),
    "glb": Format(ball("glb"), read_mesh),
    "gltf": Format(gltf, read_mesh),
    "3mf": Format(ball("3mf"), read_mesh),
    "zip": Format(packed, read_mesh),
    "step": Format(step, read_mesh, soak=90, quick=3),
    "painted-glb": Format(written(export, "x.glb"), read_painted),
    "painted-ply": Format(written(export, "x.ply"), read_painted),
    "x3d": Format(written(export, "x.x3d"), read_painted),
    "scene": Format(written(lambda scene, path: scene.save(path), "x.scene.json"), read_scene, roams=True),
    "swatch": Format(written(save_swatch, "x.swatch"), read_swatch),
    "library": Format(written(add_to_library, "index.json"), read_library),
    "hatt-models": Format(written(hatt_models, "Models_x.xml"), read_hatt_models),
    "hatt-taps": Format(written(hatt_taps, "Taps_x.xml"), read_hatt_taps),
    "handle": Format(handle, read_handle),
    "manifest": Format(manifest, read_manifest),
    "batch-list": Format(batch_list, read_batch_list, promised=rows(r"(?m)^(?!recording)[^\n]*\w")),
    "wall-cases": Format(wall_cases, read_wall_cases),
    "csv": Format(table, read_recording, promised=rows(r"(?m)^(?!time)[^\n]*\d")),
    "wav": Format(wav, read_recording),
    "npz": Format(npz, read_recording),
    "mat": Format(mat(False), read_recording, soak=300, quick=3),
    "mat-packed": Format(mat(True), read_recording, soak=300, quick=3),
    "hsrec": Format(record, read_recording),
    "path": Format(path_csv, read_path, promised=rows(r"(?m)^(?!t,)[^\n]*\d")),
    "touch": Format(touch, read_touch),
    "serial": Format(serial, read_serial, file=False),
    "udp": Format(datagram, read_datagram, file=False),
    "page": Format(page, read_page, file=False),
}
