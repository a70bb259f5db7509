"""An identified handle in words and figures."""

import math
from collections.abc import Mapping
from typing import Final

from hapscene.handle.identification import Identification, Interval

_OWN: Final = (
    ("m_h_kg", "mass of the handle", 1e3, "g"),
    ("m_c_kg", "mass of the coil", 1e3, "g"),
    ("k_s_N_m", "stiffness of the coil's spring", 1.0, "N/m"),
    ("b_s_Ns_m", "damping of the coil", 1.0, "N·s/m"),
    ("amplifier_Hz", "bandwidth of the amplifier", 1.0, "Hz"),
)
_HAND: Final = (("k_u_N_m", "stiffness of the hand", 1.0, "N/m"), ("b_u_Ns_m", "damping of the hand", 1.0, "N·s/m"))

MISFIT_MAX: Final = 2.0
"""Misfit above which it is told that the model does not explain the measurement [1]."""


def lines(handle: Identification) -> list[str]:
    """The handle for a reader: a line for each parameter, with its interval or why there is none."""
    said = [f"{handle.name}: {handle.provenance}" if handle.provenance else handle.name]
    said += [_line(handle.plant, row, handle.intervals, handle.absent) for row in _OWN]
    for grip in handle.grips:
        said.append(f"grip {grip.name}; coherence {grip.coherence:.3f}, least {grip.coherence_least:.2f}")
        said += [_line(grip, row, grip.intervals, grip.absent) for row in _HAND]
    low, high = handle.asymptote_Hz
    said.append(f"first estimate of the mass: {1e3 * handle.asymptote_kg:.4g} g, from {low:.0f} to {high:.0f} Hz")
    said.append(
        f"beside the poles of amplifier and accelerometer ({handle.accelerometer_Hz:g} Hz, taken as known) "
        f"the acceleration comes {round(1e6 * handle.delay_s)} µs late"
    )
    plant = handle.plant
    said.append(f"limits, as given: {plant.force_limit_N:g} N, {1e3 * plant.travel_limit_m:g} mm to either side")
    if handle.misfit > MISFIT_MAX:
        said.append(
            f"the model leaves {handle.misfit:.1f} times what noise explains: the handle is not quite of this kind, or "
            "the grip changed during a sweep. The intervals are wider by that, and still may be too narrow"
        )
    else:
        said.append(f"the model leaves {handle.misfit:.2f} times what noise explains")
    return said


def _line(
    holder: object,
    row: tuple[str, str, float, str],
    intervals: Mapping[str, Interval],
    absent: Mapping[str, str],
) -> str:
    name, words, scale, unit = row
    value = scale * getattr(holder, name)
    if name in intervals:
        low, high = (scale * edge for edge in intervals[name])
        # as many digits as tell the interval's ends apart
        digits = max(0, 1 - math.floor(math.log10(high - low))) if high > low else 6
        return f"  {words:<31} {value:>9.{digits}f} {unit:<6} between {low:.{digits}f} and {high:.{digits}f}"
    return f"  {words:<31} {value:>9.4g} {unit:<6} not known: {absent.get(name, 'no interval')}"
