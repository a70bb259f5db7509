"""docs/stability.md: what holds, by how much, and where every method fails.

All figures are measured in the run that writes the page; beside it lie the charts and the tables they are drawn from.
"""

import datetime
import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np

from hapscene.constants import DEFAULT_GRIP, TICK_S
from hapscene.device.model import DEVICES, MARGIN, TOUCH_SPEED_M_S, wall_limit
from hapscene.files import whole_file, whole_folder
from hapscene.stability import study
from hapscene.stability.answer import Answer
from hapscene.stability.random_limit import RandomLimit, random_limits
from hapscene.stability.wall_case import wall_cases
from hapscene.stability.wall_chart import write_random_chart
from hapscene.view.chart import picture
from hapscene_benchmarks.machine import describe_machine, machine_words
from hapscene_benchmarks.markdown import paragraph, shown, table
from hapscene_benchmarks.sheet import Sheet

from .contact_case import contact_cases, draw_contact
from .field_case import draw_fields, field_cases
from .friction_case import draw_friction, friction_cases
from .handle_case import draw_handle_limits, handle_cases
from .life_case import draw_life, life_cases
from .moving_case import draw_moving, moving_cases
from .stabiliser_case import GESTURES, STABILISERS, STIFFNESSES_N_M, Row, cost_us, draw_stabilisers, run_cases
from .texture_case import draw_texture, texture_cases
from .zoo_case import ENERGY_MJ, REST_MM_S, ZooCase, draw_zoo, zoo_cases

DIVERGED_M_S: Final = 10.0
"""Speed from which a motion is said to diverge [m/s]."""

RANDOM_COUNT: Final = 240
"""Random limits that are charted [count]."""


@dataclass
class Findings:
    """What the page tells of; parts that were not run are empty."""

    walls: list[Answer] = field(default_factory=list)
    limits: list[RandomLimit] = field(default_factory=list)
    stabilisers: list[Row] = field(default_factory=list)
    costs_us: dict[str, float] = field(default_factory=dict)
    friction: list[Answer] = field(default_factory=list)
    contact: list[Answer] = field(default_factory=list)
    texture: list[Answer] = field(default_factory=list)
    life: list[Answer] = field(default_factory=list)
    handle: list[Answer] = field(default_factory=list)
    moving: list[Answer] = field(default_factory=list)
    fields: list[Answer] = field(default_factory=list)
    zoo: list[ZooCase] = field(default_factory=list)
    words: list[str] = field(default_factory=list)


def find(folder: Path, reference: Path | None, zoo: Path | None, say: Callable[[str], None]) -> Findings:
    """Run everything but the Z-width; write charts and tables into `folder`.

    Args:
        folder: to write into.
        reference: file of wall cases, or None.
        zoo: folder of the zoo, or None.
        say: told how far it is.
    """
    found = Findings()
    if reference is not None:
        found.walls = wall_cases(reference, say)
        study.write_rows(folder / "wall_cases.csv", Answer, found.walls, ("error", "ok"))
    found.limits = random_limits(RANDOM_COUNT, say=say)
    study.write_rows(folder / "random_limits.csv", RandomLimit, found.limits, ("error",))
    write_random_chart(folder / "random_limits.png", found.limits)
    say("stabilisers\n")
    found.stabilisers, found.costs_us = run_cases(), cost_us()
    study.write_rows(folder / "stabilisers.csv", Row, found.stabilisers, ("rests",))
    draw_stabilisers(folder / "stabilisers.png", found.stabilisers, found.costs_us)
    say("friction\n")
    found.friction = friction_cases()
    draw_friction(folder / "friction.png")
    say("contact\n")
    found.contact = contact_cases()
    draw_contact(folder / "contact.png")
    study.write_rows(folder / "contact.csv", Answer, found.contact, ("error", "ok"))
    say("texture\n")
    found.texture = texture_cases()
    draw_texture(found.texture, folder / "texture.png")
    found.life = life_cases()
    draw_life(folder / "life.png")
    rows = [*found.friction, *found.texture, *found.life]
    study.write_rows(folder / "friction_texture.csv", Answer, rows, ("error", "ok"))
    say("handle, moving bodies, fields\n")
    found.handle, found.moving, found.fields = handle_cases(), moving_cases(), field_cases()
    draw_handle_limits(folder / "handle.png")
    draw_moving(folder / "moving.png")
    draw_fields(folder / "fields.png")
    rows = [*found.handle, *found.moving, *found.fields]
    study.write_rows(folder / "handle_moving_fields.csv", Answer, rows, ("error", "ok"))
    if zoo is not None:
        found.zoo = list(zoo_cases(zoo, say=say))
        study.write_rows(folder / "zoo.csv", ZooCase, found.zoo, ("ok",))
        draw_zoo(found.zoo, folder / "zoo.png")
    return found


def write_page(path: Path, found: Findings, charts: str) -> None:
    """Write the page; `charts` is the folder of the charts as seen from it."""
    parts = [_head(), _walls(found, charts), _limits(), _z_width(found, charts), _stabilisers(found, charts)]
    parts += [_answers("Friction", found.friction, f"{charts}/friction.png", _FRICTION)]
    contact = "Damping with depth, adhesion, friction over speed"
    parts += [_answers(contact, found.contact, f"{charts}/contact.png", _CONTACT)]
    parts += [_answers("Texture", found.texture, f"{charts}/texture.png", _TEXTURE)]
    parts += [_answers("Textures that live, on a stiff wall", found.life, f"{charts}/life.png", _LIFE)]
    parts += [_answers("The handle: sensors and stops", found.handle, f"{charts}/handle.png", _HANDLE)]
    parts += [_answers("What moves under the tool", found.moving, f"{charts}/moving.png", _MOVING)]
    parts += [_answers("Fields and fixtures", found.fields, f"{charts}/fields.png", _FIELDS)]
    if found.zoo:
        parts.append(_zoo(found, charts))
    parts.append(_FAILS)
    with whole_file(path) as part:
        part.write_text("\n".join(parts), encoding="utf-8")


def _head() -> str:
    sheet = Sheet()
    describe_machine(sheet)
    said = f"""Everything here was found by simulation in closed loop through the real tick, its effects, limits and
        stabilisers (`hapscene.twin`), and judged against closed forms and published theorems; nothing by a second
        little simulator. Made by `python -m hapscene_experiments.stability_page` on
        {datetime.date.today().isoformat()}. Machine:
        {"; ".join(machine_words(sheet))}."""
    loop = """One tick: read the encoders, compute the force, hold it until the next tick (d ticks later, at a delay
        of d). A device is a mass m with damping b, Coulomb friction c and encoder step Δ; a wall a spring K and a
        damper B (backward difference); T is the period of a tick."""
    return f"""# Stability: what holds, by how much, and where it fails

{paragraph(said)}

{paragraph(loop)}
"""


def _walls(found: Findings, charts: str) -> str:
    text = ["## Walls: simulated against predicted\n"]
    if found.walls:
        rows = []
        for kind in dict.fromkeys(row.id.split("-")[0] for row in found.walls):
            some = [row for row in found.walls if row.id.split("-")[0] == kind]
            held = sum(row.ok for row in some)
            rows.append((kind, some[0].what, f"{held} of {len(some)}", f"{max(row.error for row in some):.1e}"))
        text.append(table(("case", "what", "within tolerance", "largest relative error"), rows))
    text.append(picture(f"{charts}/random_limits.png", "Simulated against predicted limits") + "\n")
    rows = []
    for kind in dict.fromkeys(row.kind for row in found.limits):
        errors = [row.error for row in found.limits if row.kind == kind]
        rows.append((kind, str(len(errors)), f"{np.median(errors):.1e}", f"{max(errors):.1e}"))
    text.append(f"{len(found.limits)} random (m, b, c, Δ, T, d, K, B):\n")
    text.append(table(("what holds the tool", "cases", "median error", "largest error"), rows))
    return "\n".join(text)


def _limits() -> str:
    said = f"""Every device has a stiffest wall and a largest damping, found from the border of stability
        (`hapscene.device.model`) with friction counted at a touch of {TOUCH_SPEED_M_S:g} m/s, and never more than
        others drive it at. The margin is {MARGIN:g}: walls use half of the stiffness that is just stable and half of
        the step that friction just holds, which covers a device half as damped as its data say. A swatch over it is
        rendered at it, and a warning says so in N/m; a wall that needs damping to hold is given it."""
    loops = list(product((1, 5, 10), (0, 1)))  # rate [kHz], delay [ticks]
    rows = []
    for name, device in DEVICES.items():
        if device.point is not None:
            pairs = [
                [wall_limit(device, TICK_S / rate, d, damped=damped)[0] for damped in (True, False)]
                for rate, d in loops
            ]
            rows.append((name, *(f"{damped:.0f} / {undamped:.0f}" for damped, undamped in pairs)))
    head = ("device", *(f"{rate} kHz, d = {d}" for rate, d in loops))
    return f"""## Limits of a device, and the margin
{paragraph(said)}

Stiffest wall with damping / without [N/m]:

{table(head, rows)}"""


def _z_width(found: Findings, charts: str) -> str:
    said = "\n".join(f"- {line}" for line in found.words)
    return f"""## Z-width of the Omni

{picture(f"{charts}/z_width.png", "Stable stiffness over damping")}

The stable region of a light grip, of the full Omni and of the Omni as a point mass, at three rates and two delays; the
closed form of the point mass without friction; the limits above; the shipped swatches as points.

{said}
"""


def _stabilisers(found: Findings, charts: str) -> str:
    by_case = {(r.device, r.stabiliser, r.gesture, r.stiffness_N_m): _cell(r) for r in found.stabilisers}
    walls = list(product(GESTURES, STIFFNESSES_N_M))
    head = ("", *(f"{g}, {K:g} N/m" for g, K in walls), "cost [µs]")
    chart = picture(f"{charts}/stabilisers.png", "Speed at rest, energy out and stiffness kept, by stabiliser")
    parts = [f"## Stabilisers on the same cases\n\n{chart}\n"]
    for device in dict.fromkeys(row.device for row in found.stabilisers):
        rows = []
        for name in STABILISERS:
            cells = [by_case.get((device, name, *wall), "") for wall in walls]
            rows.append((name, *cells, f"{max(0.0, found.costs_us.get(name, 0.0)):.2f}"))
        parts.append(
            f"{device[0].upper()}{device[1:]}, light grip, 1 kHz: speed at rest [mm/s] / energy out [mJ] / "
            f"stiffness kept [1]\n\n{table(head, rows)}"
        )
    return "\n".join(parts)


def _cell(row: Row) -> str:
    if not row.late_m_s < DIVERGED_M_S:
        return "diverges"
    kept = "–" if np.isnan(row.kept) else f"{row.kept:.2f}"
    return f"{_plain(1e3 * row.late_m_s)} / {_plain(1e3 * row.out_J)} / {kept}"


def _plain(value: float) -> str:
    """Two figures, without exponents; nothing below a hundredth."""
    return f"{value:.0f}" if value >= 10.0 else f"{value:.1f}" if value >= 1.0 else f"{value:.2f}"


def _answers(title: str, rows: Sequence[Answer], chart: str, said: str) -> str:
    cells = []
    for row in rows:
        expected = f"{'≤ ' if row.at_most else ''}{shown(row.expected)}"
        cells.append((row.id, row.what, expected, shown(row.found), "yes" if row.ok else "**no**"))
    return f"""## {title}

{picture(chart, title)}

{paragraph(said)}

{table(("case", "what", "expected", "found", "held"), cells)}"""


def _zoo(found: Findings, charts: str) -> str:
    def worst(value: Callable[[ZooCase], Any]) -> str:
        row = max(found.zoo, key=value)
        return f"{shown(float(value(row)))} ({row.id})"

    held = sum(row.ok for row in found.zoo)
    failed = [row.id for row in found.zoo if not row.ok]
    said = f"""A hand follows each path of the zoo and pushes 3 N; with two grips, on the Omni as a point mass and,
        where its workspace reaches, on the full Omni. {held} of {len(found.zoo)} hold: no pop-through, at most
        {REST_MM_S:g} mm/s rms at rest, at most {ENERGY_MJ:g} mJ made in a contact. Largest speed at rest
        {worst(lambda r: r.rest_mm_s)} mm/s; most energy {worst(lambda r: r.energy_mJ)} mJ."""
    missed = f"\nNot held: {', '.join(failed)}.\n" if failed else ""
    return f"""## The zoo, closed loop

{picture(f"{charts}/zoo.png", "The zoo")}

{paragraph(said)}
{missed}"""


_FRICTION: Final = """F1 to F4 are closed forms; the rest is what an Omni with its encoders does when it holds still or
    comes to a stop."""

_CONTACT: Final = """Damping that grows with depth holds what a damper of as much does, at that depth (W5's border); a
    fall bounces as Hunt and Crossley's equation says. A tool that is torn off loses A e δ; near the surface adhesion is
    a spring of A e/δ, and W1 is its limit. Friction that falls with speed gives back nothing that was not put in; where
    it falls faster than the hand damps, a drag squeals, from the border that Routh's criterion gives on, as on the
    surface itself."""

_TEXTURE: Final = """L1: stable parts interpolated. L2, L3: models switched as adversaries would. T4: a grating is
    sampled like any signal. Then the shipped swatches, switched every tick, and a stiff wall that buzzes, with what
    removes it. Textures go to the handle; where a device has none, the motors' share is limited (T1, T2) with a
    warning that names the swatch."""

_LIFE: Final = """How loud a texture is depends on the force and speed of the tool; folded into the force of motors it
    moves that tool. Two strokes that begin a ten-millionth apart, with the same random numbers, part as fast as small
    motion grows, noise or no noise. Whether the texture is steady, has a slow gain or goes on beyond what was recorded,
    they begin to part where the wall alone does: it does not feed itself, all of it folded in. What motors are given
    is less than all (T1, T2), and counts the loud stretches of a gain and the level beyond."""

_HANDLE: Final = """The learning compensator hears the handle through an accelerometer, on handles 30 % off. Later than
    believed by up to 0.3 ms, what a slower pole adds counted, it takes the error to an eighth of that of `flat`, which
    hears nothing; beyond, it gives up and plays as `flat` does. It does harm where the sensor is at a tenth of the
    bandwidth that is believed. The coil's stops: the governor knows the handle that is believed, and uses 0.6 of its
    travel. Handles up to 10 % off meet no stop; others do where the line is in the shaded region, at the coil's own
    resonance above all, and some below it while a sound swells: `flat` then knocks in each cycle, `adaptive` hears that
    and ends it within a second or so."""

_MOVING: Final = """A wall of K that moves at v makes steps of K v T, its poses coming each tick or its shapes at 60 Hz;
    poses that are held make K v h. What swings under a still tool gives away K A² n sin²(π/n) a cycle of n ticks: as a
    damper of −K T/2. A tool that flies through a wall gets F v T; the passivity controller leaves K v² T² + F Δ of it.
    Bodies that are pushed chatter from K T²/m on that `ratio_max` has. After a stall a body is behind by v for what is
    beyond 0.1 s, and makes that up within the mean time between frames, of which the stall is a fifth."""

_FIELDS: Final = """A field is a spring that the tick holds: its limits are W1 and W2, for K of a guide, 3.5 F/r of
    a magnet. Beyond, it hums: a magnet at the amplitude at which a cycle gains as much as it loses, and from 3.2 times
    the limit on it throws the tool out. Viscosity holds to 2 m/T. With a device's name springs are kept to what it
    holds."""

_FAILS: Final = """## Where each method fails
- **No stabiliser**: a light grip on a wall beyond the border of its device bounces for ever (see "none" above);
  friction of a real device hides that for slow touches only (W7).
- **A tool that flies through a wall** at a speed v gets F v T too much, half of it as it enters and half as it leaves,
  since force is half a tick late: 6.6 mJ at 2 m/s and 3.3 N. The passivity controller takes back all but K v² T²: what
  the last tick makes it sees when the tool has left. At 500 N/m that is 2 mJ at 2 m/s. A faster tick helps.
- **The limit of a wall** is found at all delays up to 255 ticks, to seven digits and in seconds where the device's own
  damping is at most m/T. At 30 m/T, delays over 13 ticks and nine tenths of the largest wall damping, 0 is told.
- **Learning in the handle** is at the mercy of what is believed of the sensor: an accelerometer of 160 Hz that is said
  to have 1600 makes the error 1.8 times that without learning.
- **The coil's stops** are not sensed. Knocks weaker than a quarter of the largest force are not heard: a handle 10 %
  off that is asked for 200 m/s² at 10 to 50 Hz, far more than its travel allows, taps its stops ten times a second.
- **A pushed body** chatters where it is lighter than K T²/4, predicted than K T²/1.75; a simulation at 60 Hz holds 65 g
  at 500 N/m. **A game that stalls** over 0.1 s makes a step of force that is felt from some 5 cm/s on.
- **Limits with margin** rest on the device's data. A device less than half as damped as its data say, or a delay that
  nobody stated, is outside; the damping they add is felt as a softer onset of contact.
- **Damping of the wall** has an upper border of its own (W5), which falls fast with delay; over encoder steps it kicks
  with BΔ/T.
- **Damping that grows with the depth** is none where a wall is hardly touched: the limit there is that of the bare
  wall, and a device that holds 4000 N/m pressed 4 mm deep holds 210 N/m at 10 µm. Limits do not count it.
- **Adhesion** of a thin film is stiffer than any device: it is made weaker and wider, at the same work. A tool faster
  than δ a tick jumps over it.
- **Falling friction** is felt through the low-pass on the slip speed, 8 ms late: a squeal is at most some 20 Hz fast.
- **Passivity controller, uncapped**, chatters and can diverge. **Capped**, it only slows what grows at long delays on
  stiff walls; limits must do it there. It watches the normal force alone.
- **Virtual coupling** is still everywhere it is passive, at a small share of the stiffness.
- **Shading** makes the direction of force continuous over facets, and leaks the energy of G4 on a closed tour; it
  stabilises nothing.
- **Direct interpolation** of texture models is unstable for a large share of pairs (L1), and a filter with kept history
  explodes when models are switched (L3); the normalised lattice is not.
- **The simulated hand** is a spring, a damper and a mass: a hand that reacts within a few ticks, or an object that is
  held by the tool, is not in it.
"""


def publish(docs: Path, cases: Path | None, zoo: Path | None, say: Callable[[str], None]) -> None:
    """Run everything, and write stability.md, its charts and tables into a folder."""
    from hapscene.device.hand import grip_named
    from hapscene.surface.library import load_swatch, shipped_swatches

    swatches = [load_swatch(name) for name in shipped_swatches()]
    device = ("omni", (1000.0, 5000.0, 10_000.0), (0, 1), grip_named(DEFAULT_GRIP))
    made = study.stability(Path("out/stability"), *device, swatches, cases, RANDOM_COUNT, say)
    with whole_folder(docs / "stability") as folder:
        for file in made:
            shutil.copyfile(file, folder / file.name)
        found = find(folder, cases, zoo, say)
        found.words = (folder / "words.txt").read_text(encoding="utf-8").splitlines()
    write_page(docs / "stability.md", found, "stability")


if __name__ == "__main__":  # python -m hapscene_experiments.stability_page DOCS CASES ZOO
    publish(Path(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3]), print)
