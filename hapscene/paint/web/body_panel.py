"""The tab Bodies: a tree of the bodies of the scene, and the name, parent, pose and size of the selected one.

Tree and fields are custom HTML, whose events body_tree.js sends to the server: viser has no tree, and its number fields
send a value with every key.
"""

import asyncio
import inspect
import shutil
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import HapsceneError, MeshError, SceneError
from hapscene.io.files import is_unitless
from hapscene.paint.model.composing import numbered
from hapscene.paint.web.context import Container, PageContext, aria, escape_html, set_html
from hapscene.paint.web.view import rotation
from hapscene.scene.body import Body
from hapscene.scene.mesh import UNIT_M, Mesh
from hapscene.scene.mesh_file import FORMATS, load_mesh
from hapscene.scene.scene import Scene
from hapscene.scene.size_advice import LIKELY_M, dimensions, size_advice

__all__ = ["BESIDE", "MESHES", "BodyPanel"]

MESHES: Final = tuple(f".{suffix}" for suffix in FORMATS)
BESIDE: Final = (".mtl", ".bin", ".png", ".jpg", ".jpeg")
"""Suffixes of files that a mesh may refer to."""

ROW_MAX: Final = 200
"""Largest number of bodies in the tree [count]."""

UNITS: Final = ("mm", "cm", "m", "in")
"""Units offered for a mesh whose file has no unit."""

ASK_MAX: Final = 3
"""Largest number of questions about size or upright position [count]; no questions about more bodies."""

AXES: Final = "xyz"


class BodyPanel:
    """Tree of bodies, and fields of the selected body.

    Attributes:
        chosen: name of the selected body, or None.
        dragging: whether its transform handles are being dragged.
    """

    def __init__(self, context: PageContext, container: Container) -> None:
        self._context = context
        self._composing = context.session.composing
        self.chosen: str | None = None
        self.dragging = False
        self._handles = True
        with container:
            self._tree = context.gui.add_html("")
            self._fields = context.gui.add_html("")
        self._acts: Mapping[str, Callable[[str, str], object]] = {
            "choose": self._choose,
            "hide": lambda name, _: self._composing.hide(name, name not in context.session.painting.hidden),
            "copy": lambda name, _: self._select(self._composing.copy(name)),
            "delete": lambda name, _: self._composing.delete(name),
            "handles": self._toggle_handles,
            "name": self._rename,
            "parent": lambda name, value: self._composing.attach(name, value or None),
            "scale": lambda name, value: self._scale(name, _number(value) / self._composing.scale_of(name)),
            **{f"position {axis}": self._move_to for axis in AXES},
            **{f"rotation {axis}": self._turn_to for axis in AXES},
            **{f"size {axis}": self._resize for axis in AXES},
        }
        self._what = ""
        self.show()

    async def act(self, message: Mapping[str, object]) -> None:
        """Handle a message of a button or field of the tab.

        Raises:
            SceneError: the operation is invalid.
        """
        self._what, name, value = (str(message.get(key, ""))[:1000] for key in ("act", "body", "value"))
        if self._what in self._acts:
            self._context.finish()
            result = self._acts[self._what](name, value.strip())
            if inspect.isawaitable(result):
                await result

    def show(self) -> None:
        """Update tree and fields from the scene."""
        bodies = {body.name: body for body in self._context.session.scene.bodies}
        if self.chosen not in bodies:
            self.chosen = None
        set_html(self._tree, self._tree_html())
        set_html(self._fields, "" if self.chosen is None else self._fields_html(bodies[self.chosen]))
        if not self.dragging:
            body = None if self.chosen is None or not self._handles else bodies[self.chosen]
            self._context.view.show_handles(None if body is None else body.X_WB @ _middle(body), self._drag)

    # --- actions ---

    def _choose(self, name: str, _: str) -> None:
        self.chosen = None if name == self.chosen else self._context.session.scene.body(name).name

    def _select(self, name: str) -> None:
        self.chosen = name

    def _rename(self, name: str, value: str) -> None:
        self._composing.rename(name, value)
        self.chosen = value

    def _toggle_handles(self, name: str, _: str) -> None:
        self._handles = not self._handles

    def _move_to(self, name: str, value: str) -> None:
        X_WB = self._context.session.scene.body(name).X_WB.copy()
        X_WB[AXES.index(self._what[-1]), 3] = 1e-3 * _number(value)
        self._composing.move(name, X_WB)

    def _turn_to(self, name: str, value: str) -> None:
        body = self._context.session.scene.body(name)
        angles = _angles(body)
        angles[AXES.index(self._what[-1])] = _number(value)
        self._composing.move(name, _turned(body, rotation(angles)))

    async def _scale(self, name: str, factor: float, beside: bool = False) -> None:
        """Scale a body; a large mesh is prepared in another thread."""
        composing, view = self._composing, self._context.view
        await asyncio.to_thread(lambda: view.display.prepare([composing.scaled_mesh(name, factor)]))
        composing.scale(name, factor, beside=beside)

    async def _resize(self, name: str, value: str) -> None:
        size_m = np.ptp(self._context.session.scene.body(name).mesh.bounds_m, axis=0)[AXES.index(self._what[-1])]
        if not size_m > 0.0:
            raise SceneError(f"body {name!r} is flat along {self._what[-1]}: set its size along another axis")
        await self._scale(name, 1e-3 * _number(value) / float(size_m))

    def _drag(self, phase: str, X_WG: NDArray[np.float64]) -> None:
        """Handle the start, update and end of a drag of the transform handles."""
        if phase == "start" or not self.dragging:
            self._composing.begin_move()
        self.dragging = phase != "end"
        if self.chosen is not None and phase == "update":
            body = self._context.session.scene.body(self.chosen)
            self._composing.move(self.chosen, X_WG @ np.linalg.inv(_middle(body)), goes_on=True)
        self._context.refresh()

    # --- adding meshes from files ---

    async def take(self, files: Sequence[Path]) -> None:
        """Add meshes that were dropped on the page. The files are copied into the folder of the scene.

        Raises:
            HapsceneError: a mesh cannot be loaded; those before it are added.
        """
        meshes = [file for file in files if file.suffix.lower() in MESHES]
        if not meshes:
            raise MeshError(f"{files[0].name}: this file belongs to a mesh: drop it together with the mesh file")
        path = self._context.session.path
        assert path is not None
        folder, meshes_only = path.parent, len(meshes) == len(files)
        if not meshes_only:  # files that a mesh refers to must keep their names: they get a folder
            folder = folder / numbered(meshes[0].stem, [other.name for other in folder.iterdir()])
            folder.mkdir()
        made = await asyncio.to_thread(lambda: [_copy_into(file, folder) for file in files])
        copied = {file.name: copy for file, (copy, _) in zip(files, made, strict=True)}
        try:
            for mesh in meshes:
                await self._add(copied[mesh.name])
        except BaseException as error:
            used = {body.mesh.path for body in self._context.session.scene.bodies}
            for copy, is_new in made:
                if is_new and copy not in used and meshes_only:
                    copy.unlink(missing_ok=True)
            if not meshes_only and not any(copy in used for copy, _ in made):
                shutil.rmtree(folder, ignore_errors=True)
            if isinstance(error, HapsceneError):  # name the dropped file, since its copy has been removed
                raise MeshError(str(error).replace(f"{folder}/", "")) from None
            raise

    async def _add(self, file: Path) -> None:
        from hapscene.touch import open_scene

        loop, view = asyncio.get_running_loop(), self._context.view
        unit = None
        self._context.say(f"Reading {file.name} …")

        def load() -> Scene:
            scene = open_scene(file, unit)
            view.display.prepare([body.mesh for body in scene.bodies])
            return scene

        if is_unitless(file):
            raw = await loop.run_in_executor(None, load_mesh, file, "m")
            unit = await self._ask_unit(file.name, raw)
        scene = await loop.run_in_executor(None, load)
        names = self._composing.add(scene)
        self.chosen = names[0]
        self._context.refresh()
        size_m = np.ptp(scene.bodies[0].mesh.bounds_m, axis=0)
        more = f" and {len(names) - 1} more" if len(names) > 1 else ""
        self._context.say(f"Added {names[0]}{more}: {dimensions(size_m)}.")
        self.ask_upright(scene.bodies)
        self.ask_sizes(scene.bodies)

    def ask_upright(self, bodies: Sequence[Body]) -> None:
        """Ask whether bodies from files that state no vertical axis are upright; all turns are one undo step."""
        asked = [body.name for body in bodies if body.mesh.path is not None and is_unitless(body.mesh.path)]
        self._composing.begin_move()
        for name in reversed(asked if len(asked) <= ASK_MAX else []):
            self._context.ask(
                "Is this upright?",
                f"The file of {name} does not state which axis points up.",
                ("Yes", None, lambda: None),
                *((f"Turn it 90° about {axis}", "gray", partial(self._turn_up, name, axis)) for axis in "xy"),
            )

    def _turn_up(self, name: str, axis: str) -> bool:
        body = self._context.session.scene.body(name)
        R = rotation(np.where([axis == other for other in AXES], 90.0, 0.0))
        self._composing.move(name, _turned(body, R @ body.X_WB[:3, :3]), goes_on=True)
        return True

    def ask_sizes(self, bodies: Sequence[Body]) -> None:
        """Suggest another size for each body that is too large or too small for the hand and the device."""
        asked = []
        for body in bodies:
            advice = size_advice(body.mesh, self._context.touch.config.limits)
            if advice.scale is not None:
                asked.append(
                    (body.name, advice.words.rpartition("; ")[0], advice.scale, np.ptp(body.mesh.bounds_m, axis=0))
                )
        if len(asked) > ASK_MAX:
            self._context.say(f"{len(asked)} bodies are too large or too small for the hand: scale them in Bodies.")
            return
        for name, words, scale, size_m in reversed(asked):
            self._context.ask(
                "Check the size",
                f"{words}.",
                (f"Scale to {dimensions(scale * size_m)}", None, partial(self._fit, name, scale)),
                ("Keep the size", "gray", lambda: None),
            )

    async def _fit(self, name: str, scale: float) -> None:
        await self._scale(name, scale, beside=True)

    async def _ask_unit(self, name: str, raw: Mesh) -> str:
        """Ask for the unit of a mesh whose file has none; `raw` is loaded in metres."""
        answer: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        size_m = np.ptp(raw.bounds_m, axis=0)
        diagonal_m = float(np.linalg.norm(size_m))
        likely = [unit for unit in UNITS if LIKELY_M[0] <= UNIT_M[unit] * diagonal_m <= LIKELY_M[1]]
        choices = [
            (f"{unit}: {dimensions(UNIT_M[unit] * size_m)}", None if unit in likely else "gray", unit)
            for unit in sorted(UNITS, key=lambda unit: unit not in likely[:1])
        ]

        def choose(unit: str) -> Callable[[], None]:
            return lambda: None if answer.done() else answer.set_result(unit)

        self._context.ask(
            "Choose the unit",
            f"{name} does not contain a unit. Choose the unit that gives the right size.",
            *((text, colour, choose(unit)) for text, colour, unit in (*choices, ("Cancel", "gray", ""))),
        )
        question = self._context.questions[-1]
        while not answer.done() and not question.closed:  # Escape closes it
            await asyncio.wait([answer], timeout=0.3)
        if not answer.done() or not answer.result():
            raise MeshError(f"{name}: cancelled, the mesh was not added")
        return answer.result()

    # --- HTML ---

    def _tree_html(self) -> str:
        painting, tree = self._context.session.painting, self._composing.tree()
        rows = []
        for body, depth in tree[:ROW_MAX]:
            name, hidden = escape_html(body.name), body.name in painting.hidden
            row = _button("choose", name, name, body.name == self.chosen, f"{len(body.mesh.faces):,} faces")
            hint = "Hidden bodies are neither drawn nor painted"
            row += _button("hide", "Show" if hidden else "Hide", name, hidden, hint)
            rows.append(
                f'<div role="treeitem" aria-level="{depth + 1}" aria-selected="{aria(body.name == self.chosen)}" '
                f'style="--depth:{depth}"{" class=off" * hidden}>{row}</div>'
            )
        if len(tree) > ROW_MAX:
            rows.append(f"<div>… and {len(tree) - ROW_MAX:,} more</div>")
        accept = ",".join((*MESHES, *BESIDE))
        return (
            f'<div class="hs-bodies"><div role="tree" aria-label="Bodies of the scene">{"".join(rows)}</div>'
            f'<p><button data-upload="{accept}" title="STL, OBJ, PLY, glTF, STEP …">Add meshes…</button>'
            '</p><p class="dim">You can also drop mesh files onto the page. They are copied to the folder of the scene.'
            '</p><p class="dim">Hiding is not saved with the scene and cannot be undone.</p></div>'
        )

    def _fields_html(self, body: Body) -> str:
        name, bodies = escape_html(body.name), self._context.session.scene.bodies
        parent = body.parent and escape_html(body.parent)
        below = {child.name for child in self._context.session.scene.descendants(body.name)} | {body.name}
        parents = "".join(
            f'<option value="{other}"{" selected" * (other == parent)}>{other}</option>'
            for other in (escape_html(other.name) for other in bodies[:ROW_MAX] if other.name not in below)
        )
        size_m = np.ptp(body.mesh.bounds_m, axis=0)
        rows = [
            ("Name", f'<input data-body-set="name" data-body="{name}" value="{name}" aria-label="Name">'),
            (
                "Parent",
                f'<select data-body-set="parent" data-body="{name}" aria-label="Parent"><option value="">none'
                f"</option>{parents}</select>",
            ),
            ("Position [mm]", _three("position", name, 1e3 * body.X_WB[:3, 3])),
            ("Rotation [°]", _three("rotation", name, _angles(body))),
            ("Size [mm]", _three("size", name, 1e3 * size_m)),
            ("Scale", _field("scale", name, self._composing.scale_of(body.name))),
        ]
        table = "".join(f"<tr><th>{label}</th><td>{field}</td></tr>" for label, field in rows)
        buttons = [
            _button("copy", "Copy", name, None, "Add a copy next to this body"),
            _button("delete", "Delete", name, None, "Delete this body"),
            _button("handles", "Handles", name, self._handles, "Show arrows and rings that move and rotate the body"),
        ]
        return f'<div class="hs-bodies"><table>{table}</table><p>{"".join(buttons)}</p></div>'


def _button(act: str, text: str, name: str, pressed: bool | None, title: str) -> str:
    """HTML of a button; all texts must be escaped."""
    held = "" if pressed is None else f' aria-pressed="{aria(pressed)}"'
    return f'<button data-body-act="{act}" data-body="{name}" title="{title}"{held}>{text}</button>'


def _field(act: str, name: str, value: float) -> str:
    shown = f"{round(float(value), 6) + 0.0:.6g}"
    label = act.capitalize()
    return f'<input data-body-set="{act}" data-body="{name}" value="{shown}" inputmode="numeric" aria-label="{label}">'


def _three(act: str, name: str, values: NDArray[np.float64]) -> str:
    return "".join(_field(f"{act} {axis}", name, value) for axis, value in zip(AXES, values.tolist(), strict=True))


def _number(text: str) -> float:
    try:
        value = float(text.replace(",", ".")) if "_" not in text else np.nan
    except ValueError:
        value = np.nan
    if not np.isfinite(value) or abs(value) > 1e9:
        raise SceneError(f"{text!r:.40} is not a number: enter a number such as 12.5")
    return value


def _angles(body: Body) -> NDArray[np.float64]:
    """Rotation of a body about x, then y, then z [°]."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(body.X_WB[:3, :3]).as_euler("xyz", degrees=True, suppress_warnings=True))


def _middle(body: Body) -> NDArray[np.float64]:
    """Pose X_BG (4, 4) of a frame at the centre of a body."""
    X_BG = np.eye(4)
    X_BG[:3, 3] = body.mesh.bounds_m.mean(axis=0)
    return X_BG


def _turned(body: Body, R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Pose of a body with rotation R about its centre."""
    X_BG = _middle(body)
    X_WG = body.X_WB @ X_BG
    X_WG[:3, :3] = R
    return np.asarray(X_WG @ np.linalg.inv(X_BG))


def _copy_into(file: Path, folder: Path) -> tuple[Path, bool]:
    """Copy a file into a folder under a free name; returns the copy, and False if an identical file was there."""
    there = folder / file.name
    if there.is_file() and there.stat().st_size == file.stat().st_size and there.read_bytes() == file.read_bytes():
        return there, False
    stem = numbered(file.stem, [other.stem for other in folder.iterdir() if other.suffix == file.suffix])
    there = folder / f"{stem}{file.suffix}"
    shutil.copyfile(file, there)
    return there, True
