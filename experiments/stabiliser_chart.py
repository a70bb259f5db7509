"""The chart of stabilisers: what each does on every case, and what it costs."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from hapscene.stability.wall_chart import draw_panels
from hapscene.view.palette import INK, OKABE_ITO

from .stabiliser_case import REST_M_S, Row

if TYPE_CHECKING:
    from matplotlib.axes import Axes

OUT_J: Final = 2e-3
"""Energy out that is drawn as the line not to be crossed [J]."""

SPAN_MM_S: Final = (1e-2, 1e4)
SPAN_MJ: Final = (1e-3, 1e3)
"""Axes; what lies beyond is drawn at their ends."""

LANES: Final = 0.75
"""How much of a row its marks take [1]: the rest tells rows apart."""

MARKERS: Final = ("o", "s", "^", "D")
COLOURS: Final = (OKABE_ITO["blue"], OKABE_ITO["vermilion"], OKABE_ITO["green"])


def draw_stabilisers(path: Path, rows: Sequence[Row], costs_us: Mapping[str, float]) -> None:
    """Write a PNG: a row of panels for each device, with the speed late, the energy out and the stiffness kept.

    Args:
        path: where.
        rows: what was measured.
        costs_us: time that each stabiliser adds to the tick, by its name.
    """
    devices = list(dict.fromkeys(row.device for row in rows))
    draw_panels(path, len(devices), 3, (4.6, 4.4), lambda figure, axes: _draw(figure, axes, rows, devices, costs_us))


def _draw(figure: Any, axes: Any, rows: Sequence[Row], devices: list[str], costs_us: Mapping[str, float]) -> None:
    names = list(dict.fromkeys(row.stabiliser for row in rows))
    for line, device in zip(axes, devices, strict=True):
        own = [row for row in rows if row.device == device]
        _panel(line[0], own, names, [1e3 * row.late_m_s for row in own], SPAN_MM_S)
        line[0].axvline(1e3 * REST_M_S, color=INK, linewidth=0.8, linestyle="--")
        title = f"{device[0].upper()}{device[1:]}: speed where it should rest"
        line[0].set(title=title, xlabel="late rms speed [mm/s]; dashed: rest")
        _panel(line[1], own, names, [1e3 * row.out_J for row in own], SPAN_MJ)
        line[1].axvline(1e3 * OUT_J, color=INK, linewidth=0.8, linestyle="--")
        line[1].set(title="Energy out", xlabel="most given to the hand [mJ]; dashed: 2 mJ")
        _panel(line[2], own, names, [row.kept for row in own], None)
        line[2].set(title="Stiffness kept", xlabel="felt over asked; none where it never rests", xlim=(0.0, 1.15))
        line[0].set_yticks(range(len(names)), [f"{name}  {costs_us.get(name, 0.0):+.2f} µs" for name in names])
        for axis in line[1:]:
            axis.set_yticks(range(len(names)), [])
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)


def _panel(
    axis: "Axes", rows: Sequence[Row], names: list[str], values: list[float], span: tuple[float, float] | None
) -> None:
    """One mark a case: shape by gesture, colour by stiffness."""
    gestures = list(dict.fromkeys(row.gesture for row in rows))
    stiffnesses = sorted({row.stiffness_N_m for row in rows})
    for s, stiffness in enumerate(stiffnesses):
        for g, gesture in enumerate(gestures):
            chosen = [i for i, row in enumerate(rows) if (row.stiffness_N_m, row.gesture) == (stiffness, gesture)]
            x = [values[i] if span is None else min(max(values[i], span[0]), span[1]) for i in chosen]
            lane = LANES * ((s * len(gestures) + g + 0.5) / (len(stiffnesses) * len(gestures)) - 0.5)
            y = [names.index(rows[i].stabiliser) + lane for i in chosen]
            axis.plot(
                x,
                y,
                MARKERS[g],
                color=COLOURS[s],
                markersize=4,
                linestyle="none",
                label=f"{gesture}, {stiffness:g} N/m",
            )
    if span is not None:
        axis.set_xscale("log")
        axis.set_xlim(0.7 * span[0], 1.4 * span[1])
    axis.set_ylim(len(names) - 0.5, -0.5)
