"""Make the demo's meshes and its scene anew: python assets/make.py

The meshes are made up here, by rule, and come out the same every time:

    bracket   a machined part: sharp edges, concave corners, a pocket, a slanted wall; groups by part
    toad      an organic body, dense as a scan: bumps on an ellipsoid, roughened by noise
    plate     flat, with a picture and two materials that meet along its middle
"""

import json
import math
from pathlib import Path

import numpy as np
from PIL import Image

import hapscene
from hapscene.scene.region import Box

HERE = Path(__file__).parent
MESHES = HERE / "meshes"


def main() -> None:
    """Write every mesh with its sidecar, then the scene."""
    make_bracket(MESHES / "bracket.obj")
    make_toad(MESHES / "toad.ply")
    make_plate(MESHES / "plate.obj")
    make_scene(HERE / "demo.scene.json")


def make_bracket(path: Path) -> None:
    """A bracket of 80 × 60 × 45 mm as boxes on a grid: the faces between full and empty cells."""
    x = np.array([0, 8, 22, 30, 36, 44, 58, 66, 80.0])
    y = np.array([0, 14, 22, 36, 50, 60.0])
    z = np.array([0, 4, 12, 24, 45.0])
    full = np.zeros((len(x) - 1, len(y) - 1, len(z) - 1), bool)
    full[:, :, :2] = True  # base, 12 mm
    full[:2, :, 2:] = True  # wall, 45 mm
    full[6:, :1, 2] = True  # step, 24 mm
    full[3:6, 2:4, 1] = False  # pocket, 8 mm deep
    vertices, quads, groups = {}, [], []
    padded = np.pad(full, 1)
    for axis in range(3):
        for sign in (-1, 1):
            edge = padded & ~np.roll(padded, -sign, axis)
            for cell in np.argwhere(edge) - 1:
                u, v = (axis + 1) % 3, (axis + 2) % 3
                corners = []
                for du, dv in ((0, 0), (1, 0), (1, 1), (0, 1))[::sign]:
                    corner = cell.copy()
                    corner[axis] += sign > 0
                    corner[u] += du
                    corner[v] += dv
                    corners.append(vertices.setdefault(tuple(corner.tolist()), len(vertices)))
                quads.append(corners)
                groups.append(bracket_group(cell, axis, sign))
    points = np.array([(x[i] - 40, y[j] - 30, z[k]) for i, j, k in vertices])
    slant = (points[:, 0] == x[2] - 40) & (points[:, 2] >= 24)
    points[slant, 0] -= (points[slant, 2] - 12) * 0.25  # the wall leans back over the base
    write_obj(path, points, quads, groups, {"steel": (0.42, 0.46, 0.52), "brass": (0.80, 0.68, 0.45)})
    write_sidecar(path, "mm", "A machined bracket: sharp edges, concave corners, a pocket, a slanted wall.")


def bracket_group(cell: np.ndarray, axis: int, sign: int) -> tuple[str, str]:
    """Name and material of a face of the bracket."""
    i, _, k = cell
    if k >= 2:
        return ("wall", "steel") if i < 2 else ("step", "brass")
    outside = cell.copy()
    outside[axis] += sign
    in_pocket = 3 <= outside[0] <= 5 and 2 <= outside[1] <= 3 and outside[2] == 1
    return ("pocket", "brass") if in_pocket else ("base", "steel")


def make_toad(path: Path) -> None:
    """A toad of some 80 mm: an icosphere of 82 k triangles, drawn out in bumps, roughened in five octaves."""
    import trimesh

    sphere = trimesh.creation.icosphere(subdivisions=6)
    d = np.array(sphere.vertices)
    radius = 1 / np.linalg.norm(d / (0.036, 0.030, 0.021), axis=1)  # ellipsoid, m
    for x, y, z, width_rad, height_m in (
        (1.0, 0.0, 0.25, 0.42, 0.012),  # head
        (1.0, 0.42, 0.62, 0.13, 0.0075),  # eyes
        (1.0, -0.42, 0.62, 0.13, 0.0075),
        (0.55, 0.95, -0.42, 0.20, 0.013),  # fore feet
        (0.55, -0.95, -0.42, 0.20, 0.013),
        (-0.60, 0.85, -0.30, 0.30, 0.016),  # thighs
        (-0.60, -0.85, -0.30, 0.30, 0.016),
    ):
        middle = np.array((x, y, z)) / np.linalg.norm((x, y, z))
        angle_rad = 2 * np.arcsin(np.minimum(np.linalg.norm(d - middle, axis=1) / 2, 1))
        radius += height_m * np.exp(-((angle_rad / width_rad) ** 2))
    rng = np.random.default_rng(7)
    p = d * radius[:, None]
    for octave in range(5):
        wave = rng.normal(size=(24, 3))
        wave *= 2 * np.pi / (0.030 / 2**octave) / np.linalg.norm(wave, axis=1, keepdims=True)  # 30 to 2 mm
        noise = np.sin(p @ wave.T + rng.uniform(0, 2 * np.pi, 24)).sum(axis=1) / np.sqrt(12)
        radius += 0.00055 / 2**octave * noise
    p = d * radius[:, None]
    p[:, 2] -= p[:, 2].min()
    p = p.astype(np.float32).astype(np.float64)
    write_ply_float32(path, p, np.array(sphere.faces))
    write_sidecar(path, "m", "A toad: an organic body, dense as a scan.")


def make_plate(path: Path) -> None:
    """A plate of 100 × 60 × 4 mm: cells of 2 mm on top, one picture, two materials."""
    nx, ny = 50, 30
    count = (nx + 1) * (ny + 1)

    def at(i: int, j: int, layer: int) -> int:
        return layer * count + j * (nx + 1) + i

    points = [(2.0 * i - 50, 2.0 * j - 30, z) for z in (4.0, 0.0) for j in range(ny + 1) for i in range(nx + 1)]
    uv = [(i / nx, j / ny) for _ in range(2) for j in range(ny + 1) for i in range(nx + 1)]
    quads, groups = [], []
    for j in range(ny):
        for i in range(nx):
            corners = ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))
            quads += [[at(*c, 0) for c in corners], [at(*c, 1) for c in corners[::-1]]]
            groups += [("top", "woven" if i < nx // 2 else "grained"), ("underside", "grained")]
    rim = [(i, 0) for i in range(nx)] + [(nx, j) for j in range(ny)]
    rim += [(i, ny) for i in range(nx, 0, -1)] + [(0, j) for j in range(ny, 0, -1)]
    for a, b in zip(rim, rim[1:] + rim[:1], strict=True):
        quads.append([at(*a, 0), at(*a, 1), at(*b, 1), at(*b, 0)])
        groups.append(("rim", "grained"))
    materials = {"woven": (1.0, 1.0, 1.0), "grained": (1.0, 1.0, 1.0)}
    write_obj(path, np.array(points), quads, groups, materials, uv, "plate.png")
    draw_plate(path.with_name("plate.png"))
    write_sidecar(path, "mm", "A plate with a picture and two materials that meet in its middle.")


def draw_plate(path: Path) -> None:
    """The picture: on the left half blue waves in the Japanese way, printed on cloth; on the right half walnut."""
    width, height, r = 600, 360, 60
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    wave = np.full((height, width), np.inf)
    for row in range(2 * height // r + 3):  # later rows cover earlier ones
        far = np.hypot((x + r * (row % 2)) % (2 * r) - r, y - row * r / 2)
        wave = np.where(far < r, far, wave)
    ring = np.clip(np.abs((wave / r * 4 + 0.5) % 1 - 0.5) / 0.09 - 1, 0, 1)[..., None]  # 0 on a line
    cloth = np.array((214, 222, 226)) + 5 * np.where((x // 2 + y // 2) % 2, 1, -1)[..., None]
    print_ = ring * cloth + (1 - ring) * np.array((38, 70, 120))
    bend = 14 * np.sin(x / 150 + 0.6) + 5 * np.sin(x / 47 + 1) + 2 * np.sin(x / 17)
    late = ((y + bend * (1 + y / 240)) / 27 % 1) ** 2
    fibre = np.sin((y + 0.5 * bend) / 1.3 + 2 * np.sin(x / 31)) + np.sin((y + bend) / 2.9 + 1)
    walnut = np.array((132, 88, 54)) - (46 * late - 5 * fibre)[..., None] * np.array((1.0, 0.8, 0.55))
    pixels = np.where((x < width // 2)[..., None], print_, walnut)
    Image.fromarray(np.clip(pixels, 0, 255).astype(np.uint8)).save(path, optimize=True)


def write_obj(path, points, quads, groups, materials, uv=None, picture=None) -> None:
    """Quads, in order of their groups (name, material), with an MTL file beside them."""
    mtl = []
    for name, colour in materials.items():
        mtl += [f"newmtl {name}", "Kd " + " ".join(f"{c:g}" for c in colour)]
        mtl += [f"map_Kd {picture}"] if picture else []
    path.with_suffix(".mtl").write_text("\n".join(mtl) + "\n", newline="\n")
    lines = [f"mtllib {path.stem}.mtl"]
    lines += ["v " + " ".join(f"{c:.6g}" for c in point) for point in points]
    lines += [f"vt {u:.6g} {v:.6g}" for u, v in uv or []]
    order = sorted(range(len(quads)), key=lambda q: groups[q])
    last = None
    for q in order:
        if groups[q] != last:
            last = groups[q]
            lines += [f"g {last[0]}", f"usemtl {last[1]}"]
        lines.append("f " + " ".join(f"{c + 1}/{c + 1}" if uv else f"{c + 1}" for c in quads[q]))
    path.write_text("\n".join(lines) + "\n", newline="\n")


def write_ply_float32(path: Path, points: np.ndarray, faces: np.ndarray) -> None:
    """Binary PLY as scanners write it: positions in float32."""
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment unit m\n"
        f"element vertex {len(points)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.zeros(len(faces), [("count", "u1"), ("corners", "<i4", 3)])
    rows["count"], rows["corners"] = 3, faces
    path.write_bytes(header.encode() + points.astype("<f4").tobytes() + rows.tobytes())


def write_sidecar(path: Path, unit: str, what: str) -> None:
    """Where a mesh is from, under which licence, and in which unit."""
    content = {
        "file": path.name,
        "what": what,
        "unit": unit,
        "source": "made for hapscene by assets/make.py",
        "licence": "MIT",
    }
    path.with_suffix(".json").write_text(json.dumps(content, indent=2) + "\n", newline="\n")


def make_scene(path: Path) -> None:
    """The three side by side on the plane z = 0; the tool comes from +z."""
    scene = hapscene.Scene()
    scene.add(MESHES / "bracket.obj", unit="mm", swatch="epoxy", pose=place(-0.11))
    scene.paint("bracket", "wood", "wall")
    scene.paint("bracket", "leather", "pocket")
    scene.add(MESHES / "toad.ply", unit="m", swatch="leather", pose=place(0.0))
    scene.paint("toad", "paper", Box((-1, -1, -1), (-0.004, 1, 1)), resolution_m=math.inf)
    scene.add(MESHES / "plate.obj", unit="mm", swatch="wood", pose=place(0.11))
    scene.paint("plate", "paper", "woven")
    scene.save(path)


def place(x_m: float) -> np.ndarray:
    """A pose shifted along x."""
    X_WB = np.eye(4)
    X_WB[0, 3] = x_m
    return X_WB


if __name__ == "__main__":
    main()
