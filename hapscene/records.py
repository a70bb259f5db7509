"""Data of one haptic tick: `TOUCH` and `OUTPUT` for the effects, and `ROW` for a recording.

The records are NumPy structured dtypes, so that compiled and interpreted code use the same memory. SI units; frames: W
world, B body; vectors are in W. An effect reads fields such as `touch.depth_m` and adds to `out.f_W_N[i]`.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np

from hapscene.constants import BLOCK_MAX, PASSED_MAX
from hapscene.errors import HapsceneError

__all__ = ["OUTPUT", "ROW", "TOUCH", "Owning", "Record", "Records", "block_of", "pack_small_arrays", "records"]

Records: TypeAlias = "np.recarray[Any, np.dtype[np.record]]"
"""An array of records with fields as attributes: `touch[0].depth_m`."""

if TYPE_CHECKING:

    class Record(np.record):  # type: ignore[misc]
        """One record with fields as attributes; of an `np.record`, mypy takes what was written for an array."""

        flags: int  # type: ignore[assignment]

        def __setattr__(self, name: str, value: Any) -> None: ...

else:
    Record = np.record

TOUCH: Final = np.dtype(
    [
        ("tick", "i8"),  # ticks since the last reset
        ("tick_s", "f8"),  # period of a tick [s]
        ("rate_Hz", "f8"),  # rate of the acceleration channel [Hz]
        ("block", "i8"),  # acceleration samples in this tick: fill out.a_m_s2[0:block]
        ("touching", "i8"),  # 1 while the tool is inside a surface; on the surface, rounding decides, and depth is 0
        ("began", "i8"),  # 1 in the first tick of a contact
        ("ended", "i8"),  # 1 in the first tick after a contact
        ("body", "i8"),  # touched body, −1 in the air
        ("face", "i8"),  # touched face of that body's mesh, −1 in the air
        ("swatch", "i8"),  # touched swatch; in the air the last touched one, −1 before the first contact
        ("crossed", "i8"),  # 1 if the swatch has changed since the last tick, or effect states are of another swatch
        ("inside", "i8"),  # number of bodies that the tool has penetrated (`release` of `OUTPUT`) and not yet left
        ("bary", "f8", (3,)),  # barycentric coordinates of the proxy on the face
        ("p_WT_m", "f8", (3,)),  # tool
        # proxy, the centre of the tip: in contact on the surface for a point, a radius above it for a ball; at the tool
        # in the air
        ("p_WP_m", "f8", (3,)),
        ("p_WC_m", "f8", (3,)),  # contact point on the surface; the proxy in the air
        ("v_WT_m_s", "f8", (3,)),  # velocity of the tool, backward difference
        ("nhat_W", "f8", (3,)),  # unit normal out of the surface, from tool to proxy; the last one in the air
        ("depth_m", "f8"),  # distance from tool to proxy, ≥ 0
        ("depth_rate_m_s", "f8"),  # backward difference of depth within a contact, 0 in the first tick
        ("approach_m_s", "f8"),  # speed into the surface when the contact began, ≥ 0
        ("leaving_m_s", "f8"),  # speed out of the surface when the last contact ended, ≥ 0
        ("left_body", "i8"),  # body that the tool left last; −1 at the start, or after it was teleported or removed
        ("left_W_m", "f8", (3,)),  # point on that body where the tool left it; moves with the body
        ("slip_W_m", "f8", (3,)),  # movement of the proxy over the body in this tick, tangential
        ("slip_m_s", "f8"),  # slip speed, low-passed at SLIP_CUTOFF_HZ, ≥ 0
        ("stiffness_N_m", "f8"),  # stiffness of the touched swatch
        ("normal_force_N", "f8"),  # stiffness times depth, the normal force that all effects use, ≥ 0
        ("force_N", "f8"),  # normal force, low-passed at SLIP_CUTOFF_HZ; selects the texture model
        ("x_WB", "f8", (3,)),  # axes x and y of the touched body; in the air, of the last touched body
        ("y_WB", "f8", (3,)),
        # second swatch of a blend, else −1; each effect runs for both, with `swatch` set to each
        ("other", "i8"),
        ("weight", "f8"),  # weight of the second swatch [0, 1]; follows the weight in the paint within BLEND_S
        # penetrated bodies, in the order of penetration; stored last because few ticks read them
        ("inside_body", "i8", (PASSED_MAX,)),  # indices of the bodies
        ("inside_X_WB", "f8", (PASSED_MAX, 12)),  # poses of the bodies: R_WB row by row, p_WB
        # orientation of the tool, z along the handle towards the hand; identity if it is not measured
        ("R_WT", "f8", (3, 3)),
    ],
    align=True,
)
"""The contact, computed once per tick. Effects may read it but not write it."""

OUTPUT: Final = np.dtype(
    [
        ("f_W_N", "f8", (3,)),
        ("release", "i8"),
        ("a_m_s2", "f8", (BLOCK_MAX,)),
        ("f_inside_W_N", "f8", (PASSED_MAX, 3)),
    ],
    align=True,
)
"""Output of an effect: force on the hand in W [N], and `block` samples of acceleration along the handle [m/s²].

`f_inside_W_N` is the part of the force that comes from each of `touch.inside_body`; each of these bodies receives the
opposite force, and the touched body receives the opposite of the rest. If `release` is not 0, the tool penetrates the
touched body from the next tick on until it has left the body."""

ROW: Final = np.dtype(
    [
        ("p_WT_m", "f8", (3,)),
        ("p_WP_m", "f8", (3,)),
        ("nhat_W", "f8", (3,)),
        ("depth_m", "f8"),
        ("touching", "i8"),
        ("body", "i8"),
        ("face", "i8"),
        ("swatch", "i8"),  # −1 in the air
        ("slip_m_s", "f8"),
        ("normal_force_N", "f8"),
        ("f_W_N", "f8", (3,)),
        ("began", "i8"),
        ("approach_m_s", "f8"),  # speed into the surface when the contact began
        ("f_body_W_N", "f8", (3,)),  # on the touched body
        ("flags", "i8"),
        ("tick_ns", "i8"),  # duration of the tick
        ("contact_ns", "i8"),  # part of `tick_ns` used to find the contact
        ("p_WC_m", "f8", (3,)),  # contact point on the surface
    ],
    align=True,
)
"""Recorded data of a tick, with the names of `Recording`."""


def records(count: int, dtype: np.dtype[np.void]) -> Records:
    """Zeroed records with fields as attributes, for compiled and interpreted code."""
    return np.zeros(count, dtype).view(np.recarray)


class Owning(bytearray):
    """Memory of arrays that contain addresses; keeps the objects at those addresses alive."""

    owned: Sequence[object]


def pack_small_arrays(arrays: Sequence[Any], owned: Sequence[object] = ()) -> list[Any]:
    """Copy the small arrays into one block of memory, so that a tick accesses few memory pages; returns all arrays.

    `owned` is kept alive as long as any of the copied arrays.
    """
    small = [array.nbytes <= SMALL_B for array in arrays]
    memory = Owning(sum(array.nbytes + _LINE for array, moves in zip(arrays, small, strict=True) if moves) + _PAGE)
    memory.owned = owned
    raw = np.frombuffer(memory, np.uint8)
    raw, at, found = raw[-raw.ctypes.data % _PAGE :], 0, []
    for array, moves in zip(arrays, small, strict=True):
        if moves:
            at += -at % (_LINE if array.nbytes >= _LINE else 16)
            flat = raw[at : at + array.nbytes].view(array.dtype)
            at += array.nbytes
            flat[:] = array.ravel()
            array = (flat.view(np.recarray) if array.dtype.fields else flat).reshape(array.shape)
        found.append(array)
    return found


SMALL_B: Final = 4096
"""Largest array that is copied into the block [bytes]."""

_LINE: Final = 64
_PAGE: Final = 4096

_WHOLE: Final = 1e-6
"""Tolerance for an integer number of samples per tick [1]: rates such as 44.1 kHz have no exact period."""


def block_of(tick_s: float, a_rate_Hz: float) -> int:
    """Number of acceleration samples in a tick.

    Raises:
        HapsceneError: the number is not an integer, or out of range.
    """
    if not (0.0 < tick_s < np.inf and 0.0 < a_rate_Hz < np.inf):
        raise HapsceneError(
            f"tick_s = {tick_s} or a_rate_Hz = {a_rate_Hz} is out of range: expected finite values above 0"
        )
    exact = tick_s * a_rate_Hz
    block = round(exact)
    if not 1 <= block <= BLOCK_MAX or abs(exact - block) > _WHOLE * exact:
        raise HapsceneError(
            f"a tick of tick_s = {tick_s:g} has {exact:g} samples at a_rate_Hz = {a_rate_Hz:g}; expected an integer "
            f"from 1 to {BLOCK_MAX}, such as 10 at 0.001 s and 10000 Hz: choose another rate or period"
        )
    return block
