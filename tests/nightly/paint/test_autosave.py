"""Autosave: after a kill, work up to the last write is offered for recovery once, as one undo step."""

import subprocess
import sys

import numpy as np

import hapscene
from hapscene.paint.model.document import autosave_folder, find_recovery
from hapscene.paint.model.session import Session
from tests.paint.test_autosave import path

__all__ = ["path"]  # fixtures


PAINTER = """
import sys, time
from pathlib import Path
from hapscene.paint.model.session import Session
from hapscene.surface.swatch import Swatch
session = Session.open(Path(sys.argv[1]))
session.document.start_autosave()
made = session.add_swatch(Swatch("slate", stiffness_N_m=900.0))
session.tune(session.painting.swatch_named("paper"), stiffness_N_m=123.0)
session.begin_stroke(made, 1e-3)  # a stroke that never ends: it is not lost either
file = session.document.autosave.file
shape, X_WB = session.shapes[0], session.scene.bodies[0].X_WB
for face in range(1280):
    up_W = X_WB[:3, :3] @ shape.normal[face]
    session.drag_to(X_WB[:3, :3] @ shape.centroid_m[face] + X_WB[:3, 3] + 0.01 * up_W, -up_W)
    print(face, file.stat().st_mtime_ns if file.exists() else 0, flush=True)
    time.sleep(0.02)
"""


def swatches_in_the_middle(scene: hapscene.Scene, faces: list[int]) -> set[int]:
    """What faces of the ball have there: finely painted ones, and those that are covered whole."""
    ball = scene.body("ball")
    assert ball.fine is not None
    fine = [ball.fine.at(face, np.full(3, 1 / 3)) for face in faces]
    return {int(ball.face_swatch[face]) if at is None else at for face, at in zip(faces, fine, strict=True)}


def test_a_killed_painter_loses_no_more_than_since_the_last_write(path) -> None:
    painter = subprocess.Popen([sys.executable, "-c", PAINTER, str(path)], stdout=subprocess.PIPE, text=True)
    assert painter.stdout is not None
    faces: list[int] = []
    writes: list[tuple[str, int]] = []  # when each was seen to be there, and how many faces had been painted then
    for line in painter.stdout:
        face, written_ns = line.split()
        faces.append(int(face))
        if not writes or writes[-1][0] != written_ns:
            writes.append((written_ns, len(faces)))
        if len(writes) > 3:
            break
    painter.kill()
    painter.wait()
    session = Session.open(path)
    session.document.start_autosave()
    left = session.document.recovery()
    assert left is not None
    assert "recovered" in session.document.recover(left)
    assert session.document.recovery() is None
    old = faces[: writes[-2][1] - 1]  # the last write began after the one before was there
    assert len(old) > 3
    slate = session.painting.swatch_named("slate")
    assert swatches_in_the_middle(session.scene, old) == {slate}
    paper = session.painting.swatch_named("paper")
    assert session.scene.swatches[paper].stiffness_N_m == 123.0
    session.save()
    assert find_recovery(path) is None
    session.document.close()
    assert not autosave_folder(path).exists()
    back = hapscene.load_scene(path)  # what it is made of does not lie in the folder that is gone
    assert back.swatches[slate].stiffness_N_m == 900.0
    assert swatches_in_the_middle(back, old) == {slate}
