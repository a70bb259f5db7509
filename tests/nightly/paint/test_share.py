"""Up and down through a real browser: pictures, scenes, what the hand felt."""

import io
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("viser", reason="viser is not installed: pip install 'hapscene[paint]'")
pytest.importorskip("playwright", reason="playwright is not installed: pip install 'hapscene[dev]'")

from PIL import Image
from scipy.io import wavfile

from hapscene.paint.session import Session
from hapscene.paint.web.page import Page
from hapscene.records import ROW, records
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene, load_scene
from hapscene.servo.servo import TickLog
from tests.paint.conftest import library_in
from tests.until import until

PATIENCE_S = 120.0
"""How long something may take [s]: where tests run beside each other, a browser may get a tenth of a core."""

SAID = "document.getElementById('hs-say').textContent"


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """A square of two faces with texture coordinates, of wood; leather is at hand."""
    folder: Path = tmp_path_factory.mktemp("share")
    corners = np.array([[0, 0, 0], [0.02, 0, 0], [0.02, 0.02, 0], [0, 0.02, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    scene = Scene()
    scene.add(Mesh(corners, faces, uv=(corners[:, :2] / 0.02)[faces]), name="square", swatch="wood")
    scene.swatch_index("leather")
    session = Session(scene, folder / "square.scene.json")
    with library_in(folder), Page(session, port=0, with_hand=False) as made:
        yield made
    session.document.close()


@pytest.fixture(scope="module")
def tab(page: Page, browser: Any) -> Any:
    found = browser.new_page(viewport={"width": 1280, "height": 800})
    found.set_default_timeout(1e3 * PATIENCE_S)
    found.goto(page.url)
    found.wait_for_function("window.hapscene && window.hapscene.client() >= 0 && window.hapscene.state.tool")
    return found


def open_folder(tab: Any, name: str, *folders: str) -> None:
    tab.get_by_role("tab", name=name).click()
    for folder in folders:
        tab.get_by_text(folder, exact=True).click()


def upload(tab: Any, what: str, **files: bytes) -> None:
    """Choose files for a button; "__" in a name is a dot."""
    with tab.expect_file_chooser() as chosen:
        tab.get_by_role("button", name=f"Upload {what} …").click()
    kind = "application/octet-stream"
    named = [{"name": name.replace("__", "."), "mimeType": kind, "buffer": files[name]} for name in files]
    chosen.value.set_files(named)


def download(tab: Any, label: str) -> tuple[str, bytes]:
    with tab.expect_download() as told:
        tab.get_by_role("button", name=label).click()
    return told.value.suggested_filename, Path(told.value.path()).read_bytes()


def test_what_was_felt_is_played_again_and_comes_down(page: Page, tab: Any) -> None:
    count = 400
    rows = records(count, ROW)
    rows.p_WT_m[:, 0], rows.f_W_N[:, 2] = np.linspace(0.0, 0.02, count), 0.7
    rows.touching, rows.swatch = 1, 1
    a_m_s2 = np.sin(np.arange(10 * count) * 0.3).reshape(count, 10)
    recorder = page._monitor.recorder
    open_folder(tab, "Feel", "Recording")
    tab.get_by_role("button", name="Download WAV").click()
    tab.wait_for_function(f"{SAID}.includes('nothing was recorded')")
    recorder.start(0.001)
    for part in np.array_split(np.arange(count), 20):
        page.context.touch.on_felt(TickLog(int(part[0]), rows[part], a_m_s2[part], a_m_s2[part]))
    recorder.stop()
    tab.get_by_text("Recorded: 0.4 s of touch.").wait_for()
    tab.get_by_role("button", name="Play again").click()
    tab.wait_for_function("Math.max(...window.hapscene.trace.force) > 0.69")
    tab.wait_for_function("window.hapscene.sound.heard >= 4000 && window.hapscene.sound.peak > 0.9")
    until(lambda: not recorder.playing)

    name, content = download(tab, "Download WAV")
    rate_Hz, heard = wavfile.read(io.BytesIO(content))
    assert (name, rate_Hz, len(heard)) == ("square_touch.wav", 10_000, 10 * count)
    name, content = download(tab, "Download CSV")
    lines = content.decode().splitlines()
    assert name == "square_touch.csv" and len(lines) == count + 1
    header, last = lines[0].split(","), lines[-1].split(",")
    told = dict(zip(header, last, strict=True))
    assert told["swatch"] == "wood" and told["body"] == "square" and float(told["f_W_z_N"]) == pytest.approx(0.7)
    assert float(told["t_s"]) == pytest.approx(0.399) and float(told["p_WT_x_m"]) == pytest.approx(0.02)


def test_a_picture_is_painted_and_undone_and_scenes_go_down_and_up(page: Page, tab: Any) -> None:
    session = page.context.session
    body, colours = session.scene.bodies[0], [s.albedo_rgb for s in session.scene.swatches]
    image = np.zeros((16, 16, 3), np.uint8)
    image[...] = np.rint(255 * np.array(colours[2]))
    packed = io.BytesIO()
    Image.fromarray(image).save(packed, "PNG")
    open_folder(tab, "File", "Paint by picture", "Share")
    upload(tab, "picture", map__png=packed.getvalue())
    tab.wait_for_function("window.hapscene.state.undo === 'picture map.png'")
    assert (body.face_swatch == 2).all()
    name, content = download(tab, "Download picture")
    tab.evaluate("window.hapscene.send({ do: 'undo' })")
    tab.wait_for_function("!window.hapscene.state.undo")
    assert (body.face_swatch == 1).all()
    assert name == "square_picture.zip"
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        files = {name.replace(".", "__"): archive.read(name) for name in archive.namelist()}
    assert list(files) == ["square_square__png", "square_square__json"]
    upload(tab, "picture", **files)
    tab.wait_for_function("window.hapscene.state.undo")
    assert (body.face_swatch == 2).all()
    upload(tab, "picture", odd__png=b"no picture")
    tab.wait_for_function(f"{SAID}.includes('not a picture that can be read')")

    name, content = download(tab, "Download scene")
    assert name == "square.scene.zip"
    assert session.path is not None
    saved = session.path.parent / name
    saved.write_bytes(content)
    assert (load_scene(saved).bodies[0].face_swatch == 2).all()
    evil = io.BytesIO()
    with zipfile.ZipFile(evil, "w") as archive:
        archive.writestr("../escaped_share.scene.json", "{}")
    upload(tab, "scene", evil__scene__zip=evil.getvalue())
    tab.wait_for_function(f"{SAID}.includes('evil.scene.zip: ') && {SAID}.includes('would lie outside')")
    assert not list(session.path.parent.parent.glob("**/escaped_share*"))  # other tests have their folders there
    upload(tab, "scene", square__scene__zip=content)
    until(lambda: page.context.session.path == session.path.parent / "square" / "square.scene.json")
    assert (page.context.session.scene.bodies[0].face_swatch == 2).all()
