"""Scenes to paint: a ball, a plate thinner than the brush, both at poses; and the user's library somewhere else."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import trimesh
from trimesh.creation import box, icosphere

import hapscene
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene

if TYPE_CHECKING:
    from hapscene.paint.model.mesh import Hit
    from hapscene.paint.model.session import Session
    from hapscene.paint.web.page import Page

    from .tab import Tab
    from .window import Window


def mesh_of(shape: trimesh.Trimesh) -> Mesh:
    """A mesh [m] of a trimesh."""
    return Mesh(vertices_m=np.asarray(shape.vertices), faces=np.asarray(shape.faces, np.int32))


def plate_mesh(thickness_m: float = 0.001, cells: int = 5) -> Mesh:
    """A plate of 40 × 40 mm, its middle at the origin, z up; its sides halved `cells` times."""
    shape = box((0.04, 0.04, thickness_m))
    for _ in range(cells):
        shape = shape.subdivide()
    return mesh_of(shape)


def turned(angle_rad: float, place_m: tuple[float, float, float]) -> np.ndarray:
    """A pose."""
    return np.asarray(trimesh.transformations.rotation_matrix(angle_rad, (1, 2, 3))) + np.pad(
        np.reshape(place_m, (3, 1)), ((0, 1), (3, 0))
    )


def hit_at(session: "Session", body: int, face: int) -> "Hit":
    """The centroid of a face."""
    from hapscene.paint.model.mesh import Hit

    shape, X_WB = session.shapes[body], session.scene.bodies[body].X_WB
    p_B_m = shape.centroid_m[face]
    return Hit(body, face, X_WB[:3, :3] @ p_B_m + X_WB[:3, 3], p_B_m, X_WB[:3, :3] @ shape.normal[face], 0.0)


def make_scene(folder: Path) -> Scene:
    """A ball in a file, with two materials, and a plate in memory."""
    ball = icosphere(subdivisions=3, radius=20.0)
    text = "\n".join(f"v {x:.17g} {y:.17g} {z:.17g}" for x, y, z in ball.vertices)
    for name, faces in (("north", ball.faces[:700]), ("south", ball.faces[700:])):
        text += f"\nusemtl {name}\n" + "\n".join("f " + " ".join(str(i + 1) for i in f) for f in faces)
    (folder / "ball.obj").write_text(text)
    scene = hapscene.Scene()
    scene.add(folder / "ball.obj", name="ball", unit="mm", pose=turned(0.4, (0.01, 0.0, 0.0)))
    scene.add(plate_mesh(cells=3), name="plate", swatch="paper", pose=turned(-0.3, (0.0, 0.08, 0.0)))
    return scene


@contextmanager
def library_in(folder: Path) -> Iterator[None]:
    """The user's library in a folder, for a whole module."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HAPSCENE_LIBRARY", str(folder / "library"))
        patch.setenv("XDG_DATA_HOME", str(folder / "data"))
        yield


@pytest.fixture(autouse=True)
def library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Redirect the swatch library of the user to a temporary folder."""
    monkeypatch.setenv("HAPSCENE_LIBRARY", str(tmp_path / "library"))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    return tmp_path / "library"


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    """Return the scene of `make_scene`."""
    return make_scene(tmp_path)


@pytest.fixture
def page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> "Iterator[Page]":
    """Serve the page on `make_scene` without a simulated hand, in a temporary folder."""
    from hapscene.paint.model.session import Session
    from hapscene.paint.web.page import Page

    monkeypatch.chdir(tmp_path)
    make_scene(tmp_path).save("ball.scene.json")
    session = Session.open(Path("ball.scene.json"))
    with Page(session, port=0, with_hand=False) as made:
        yield made
    session.document.close()


@pytest.fixture
def tab(page: "Page") -> "Iterator[Tab]":
    """A tab of the page, without a browser."""
    from .tab import Tab

    opened = Tab(page)
    yield opened
    opened.close()


@pytest.fixture(scope="module")
def window(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> "Iterator[Window]":
    """A window on the page of a ball of wood; epoxy is at hand."""
    from hapscene.paint.model.session import Session

    from .window import WatchedPage, Window

    folder = tmp_path_factory.mktemp("browser")
    scene = hapscene.Scene()
    scene.add(mesh_of(icosphere(subdivisions=4, radius=0.03)), name="ball", swatch="wood")
    scene.swatch_index("epoxy")
    scene.save(folder / "ball.scene.json")
    session = Session.open(folder / "ball.scene.json")
    with library_in(folder):
        page = WatchedPage(session, port=0)
        with page:
            yield Window(browser, page)
    session.document.close()
