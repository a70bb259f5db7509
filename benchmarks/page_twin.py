"""The part of docs/benchmark.md on the twin and the handle."""

from hapscene.view.chart import picture

from .markdown import paragraph, shown, table
from .sheet import Sheet


def twin_section(sheet: Sheet) -> str:
    """How fast the closed loop is."""
    rows = [
        (
            case.removeprefix("twin, "),
            f"{sheet.number(case, 'times real time'):,.0f}",
            shown(sheet.number(case, "tick")),
        )
        for case in sheet.cases("twin, ")
    ]
    said = """A hand that scrubs wood, four effects, 1 kHz force and 10 kHz acceleration, the device and the handle
        (`adaptive`) advanced ten times a tick; the fastest of seven runs, making of the arrays included."""
    return f"""## The twin in closed loop
{paragraph(said)}

{table(("device", "times real time", "tick [µs]"), rows)}"""


def handle_section(sheet: Sheet, charts: dict[str, str]) -> str:
    """How well the compensators play, and what each costs."""
    from .handle import FIRM, PLANTS, SIGNALS, SPREAD

    rows = []
    for case in sheet.cases("handle, "):
        errors = [
            " / ".join(f"{sheet.number(case, f'{signal} {what}'):.1f}" for what in ("nominal", "median", "p95", "firm"))
            for signal in SIGNALS
        ]
        rows.append((case.removeprefix("handle, "), *errors, f"{sheet.number(case, 'sample least'):.2f}"))
    said = f"""Spectrogram error [%] of the handle's acceleration against the desired, no output being 100: the nominal
        handle / median and p95 of {PLANTS} handles with all six parameters off by up to {100 * SPREAD:.0f} % / a grip
        {FIRM:g} times as firm. Simulated at 10 kHz with amplifier, accelerometer and its noise, travel and force
        limits. Time is that of one sample, plant and all."""
    head = ("compensator", *(f"{signal}" for signal in SIGNALS), "sample [µs]")
    return f"""## The handle: error against time

{picture(charts["handle"], "Error against time of the compensators")}

{paragraph(said)}

{table(head, rows)}"""
