"""Parts of a picture: bodies, path, tool, proxy and force."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.render.recording import Recording
from hapscene.view.feel_layer import Show, scene_solids
from hapscene.view.palette import AIR, FORCE, OKABE_ITO, PATH, Theme
from hapscene.view.triangles import Shown, Triangles, facing, joined, lathe, moved, pose_of, tube

if TYPE_CHECKING:
    from hapscene.scene.scene import Scene

__all__ = [
    "ARROW_SPACING",
    "PROXY_COLOUR",
    "STYLUS",
    "TOOL_LENGTH",
    "TOOL_R_WT",
    "FigureParts",
    "arrow_ticks",
    "make_figure_parts",
]

PATH_RADIUS: Final = 2.2e-3
"""Radius of the path on the surface, relative to the diagonal of the scene [1]."""

ARROW_LENGTH: Final = 0.12
"""Length of the arrow for the maximum force, relative to the diagonal [1]."""

ARROW_HEAD: Final = 0.2
"""Length of the arrow head, relative to the longest arrow [1]; it is the same for shorter arrows."""

ARROW_SPACING: Final = 0.035
"""Distance between arrows along the path, relative to the diagonal [1]."""

TOOL_LENGTH: Final = 0.22
"""Length of the tool, relative to the diagonal [1]."""

STYLUS: Final = [(0.0, 0.0), (0.03, 0.2), (0.037, 0.3), (0.037, 0.97), (0.025, 1.0), (0.0, 1.0001)]
"""Profile of the tool from its tip: radius and height, relative to its length [1]."""

TOOL_R_WT: Final = facing(np.array((0.8, 0.4, 1.0)))
"""Orientation of the tool, as a right hand holds a pen; for devices that do not measure it."""

TOOL, PROXY, SHAFT, HEAD, BODIES = range(5)
"""Indices of the first parts; further parts of the bodies and segments of the path follow."""

PROXY_COLOUR: Final = OKABE_ITO["black"]


@dataclass(frozen=True, eq=False)
class FigureParts:
    """A scene and a touch as parts. Frame S is the world frame W moved by `p_WS_m`."""

    parts: list[Triangles]
    body_count: int
    """Number of parts of the bodies."""
    piece_tick: NDArray[np.int64]
    """Tick from which each segment of the path is visible (p,); the segments are the last p parts."""
    p_ST_m: NDArray[np.float64]
    """Device position (n, 3) [m]; n is 0 without a touch."""
    R_ST: NDArray[np.float64]
    """Orientation of the tool (n, 3, 3): as measured, or `TOOL_R_WT`."""
    p_SP_m: NDArray[np.float64]
    """Proxy position (n, 3) [m]."""
    f_N: NDArray[np.float64]
    """Force on the hand (n, 3) [N]."""
    size_m: float
    """Diagonal of the scene [m]."""
    arrow_m_N: float
    """Arrow length per newton [m/N]."""

    def shown(self, tick: int | None = None) -> Shown:
        """Return the visible parts: bodies; at a tick also the path up to it, tool, proxy and force."""
        here = np.eye(4)
        shown = [(BODIES + i, here) for i in range(self.body_count)]
        if tick is None:
            return shown
        first = len(self.parts) - len(self.piece_tick)
        shown += [(first + int(k), here) for k in np.flatnonzero(self.piece_tick <= tick)]
        shown.append((TOOL, pose_of(self.R_ST[tick], self.p_ST_m[tick])))
        shown.append((PROXY, pose_of(np.eye(3), self.p_SP_m[tick])))
        return shown + self._arrow(tick)

    @property
    def f_max_N(self) -> float:
        """Maximum force [N]."""
        return float(np.linalg.norm(self.f_N, axis=1).max(initial=0.0))

    def arrows(self, ticks: NDArray[np.int64]) -> Triangles:
        """Return the force arrows of some ticks as one part."""
        return joined([moved(self.parts[part], X_SP) for k in ticks for part, X_SP in self._arrow(int(k))])

    def points_m(self, tool: bool) -> NDArray[np.float64]:
        """Return points (k, 3) that the camera must show: bodies, path, arrows and optionally the tool."""
        bodies = self.parts[BODIES : BODIES + self.body_count]
        ends = [*(part.corner_m for part in bodies), self.p_SP_m, self.p_SP_m + self.f_N * self.arrow_m_N]
        if tool:
            ends += [self.p_ST_m, self.p_ST_m + TOOL_LENGTH * self.size_m * self.R_ST[:, :, 2]]
        return np.concatenate(ends)

    def _arrow(self, tick: int) -> Shown:
        """Return the arrow of the force at a tick: a shaft and a head, starting at the proxy."""
        f_N = self.f_N[tick]
        length_m = float(np.linalg.norm(f_N)) * self.arrow_m_N
        if length_m < 0.02 * ARROW_LENGTH * self.size_m:
            return []
        whole_m = ARROW_HEAD * ARROW_LENGTH * self.size_m
        head_m = min(whole_m, length_m)
        R, thin, start_m = facing(f_N), head_m / whole_m, self.p_SP_m[tick]
        shaft = pose_of(R @ np.diag([thin, thin, max(length_m - head_m, head_m * 1e-3)]), start_m)
        head = pose_of(R @ np.diag([thin, thin, head_m]), start_m + f_N / np.linalg.norm(f_N) * (length_m - head_m))
        return [(SHAFT, shaft), (HEAD, head)]


def make_figure_parts(
    scene: "Scene",
    recording: Recording | None,
    theme: Theme,
    piece_ticks: NDArray[np.int64],
    show: Show = "both",
) -> FigureParts:
    """Create the parts of a picture; segments of the path end at `piece_ticks`, ascending (p,)."""
    solids = scene_solids(scene, show)
    corner_m = np.concatenate([solid.corner_m for solid in solids])
    low_m, high_m = corner_m.min(axis=0), corner_m.max(axis=0)
    p_WS_m, size_m = (low_m + high_m) / 2, max(float(np.linalg.norm(high_m - low_m)), 1e-9)
    bodies = [solid._replace(corner_m=solid.corner_m - p_WS_m) for solid in solids]
    p_ST_m = p_SP_m = f_N = np.zeros((0, 3))
    R_ST = np.zeros((0, 3, 3))
    pieces: list[Triangles] = []
    if recording is not None:
        p_ST_m, p_SP_m, f_N = recording.p_WT_m - p_WS_m, recording.p_WP_m - p_WS_m, recording.f_W_N
        held = np.broadcast_to(TOOL_R_WT, (len(recording), 3, 3))
        R_ST = held if recording.R_WT is None else recording.R_WT
        pieces = _path(recording, p_WS_m, PATH_RADIUS * size_m, piece_ticks)
    f_max_N = float(np.linalg.norm(f_N, axis=1).max(initial=0.0))
    return FigureParts(
        parts=[*_props(size_m, theme), *bodies, *pieces],
        body_count=len(bodies),
        piece_tick=piece_ticks[: len(pieces)],
        p_ST_m=p_ST_m,
        R_ST=R_ST,
        p_SP_m=p_SP_m,
        f_N=f_N,
        size_m=size_m,
        arrow_m_N=ARROW_LENGTH * size_m / f_max_N if f_max_N > 0 else 0.0,
    )


def arrow_ticks(recording: Recording, spacing_m: float) -> NDArray[np.int64]:
    """Select ticks for force arrows: one every `spacing_m` of each contact, or the maximum of a short contact."""
    force_N = np.linalg.norm(recording.f_W_N, axis=1)
    edges = np.flatnonzero(np.diff(recording.touching.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
    ticks: list[int] = []
    for start, stop in edges:
        step_m = np.linalg.norm(np.diff(recording.p_WP_m[start:stop], axis=0), axis=1)
        mark = np.concatenate(([0.0], np.cumsum(step_m))) // spacing_m
        if mark[-1] < 1:
            ticks.append(int(start + force_N[start:stop].argmax()))
        else:
            ticks += (start + 1 + np.flatnonzero(np.diff(mark))).tolist()
    return np.array(ticks, np.int64)


def _path(
    recording: Recording, p_WS_m: NDArray[np.float64], radius_m: float, piece_ticks: NDArray[np.int64]
) -> list[Triangles]:
    """Return the segments of the path, which end at `piece_ticks`, as tubes: thick on the surface, thin in the air."""
    touching = recording.touching
    # raise the path, since the proxy lies on the surface and would hide half of the tube
    line_m = recording.p_WP_m - p_WS_m + np.where(touching[:, None], recording.nhat_W, 0.0) * radius_m * 0.5
    pieces = []
    for first, last in zip([0, *piece_ticks], piece_ticks, strict=False):
        at = np.arange(first, last + 1)
        edges = np.flatnonzero(np.diff(touching[at])) + 1
        runs = []
        for start, stop in zip([0, *edges], [*edges, len(at)], strict=True):
            if touching[at[start]]:
                runs.append(tube(line_m[at[start:stop]], radius_m, PATH))
            else:
                runs.append(tube(line_m[at[max(start - 1, 0) : stop + 1]], radius_m * 0.4, AIR))
        pieces.append(joined(runs))
    return pieces


def _props(size_m: float, theme: Theme) -> list[Triangles]:
    """Return tool, proxy, and shaft and head of an arrow of length 1 m, each at the origin along z."""
    tool_m, arrow_m, ball_m = TOOL_LENGTH * size_m, ARROW_LENGTH * size_m, 3 * PATH_RADIUS * size_m
    angle = np.linspace(-np.pi / 2, np.pi / 2, 13)
    return [
        lathe([(r * tool_m, z * tool_m) for r, z in STYLUS], theme.tool),
        lathe([(ball_m * float(np.cos(a)), ball_m * float(np.sin(a))) for a in angle], PROXY_COLOUR),
        lathe([(0.016 * arrow_m, 0.0), (0.016 * arrow_m, 1.0)], FORCE),
        lathe([(0.0, 0.0), (0.05 * arrow_m, 1e-3), (0.0, 1.0)], FORCE),
    ]
