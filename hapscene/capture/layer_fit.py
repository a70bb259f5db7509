"""A fit of its own: whether a texture differs by a third variable, the direction of sliding or the tool's angle, and
where layers of it are to stand.

What is heard of a piece is taken as levels of `BANDS` bands. What force and speed explain of them (a plane over their
logarithms) is held against the same and an offset that goes from layer to layer in straight lines. Blocks of pieces
that were left out say which is nearer; layers are taken where they gain `GAIN` and that is no chance.
"""

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hapscene.capture import metric
from hapscene.capture.streams import Array, third_of
from hapscene.capture.texture_pieces import Pieces
from hapscene.perception import BAND_DB
from hapscene.surface.texture import LAYERS_MAX, PERIOD_RAD, layer_shares

BANDS: Final = 6
"""Bands from 20 to 1000 Hz that a piece is told by [count]: a tenth of a second has no finer ones."""

COUNTS: Final = {"axis": (2, 3, 4), "direction": (2, 3, 4, 6, LAYERS_MAX), "contact_angle": (2, 3, 4)}
"""Numbers of layers that are tried, by what they are of, the plainer first [count]."""

APART_RAD: Final = {"axis": 0.35, "direction": 0.35, "contact_angle": 0.087}
"""How near to one another layers may stand [rad]: 20°, and 5° of the tool's angle. A hand keeps to neither better."""

STARTS: Final = 8
"""How often layers are placed, begun at other angles [count]: on a whole circle they may stand anywhere."""

SAME_RAD: Final = 0.05
"""How near layers placed twice are for the same ones [rad]."""

LAYER_PIECES: Final = 10
"""Fewest pieces of a layer [count]: a second."""

OWN_SHARE: Final = 0.7
"""Least weight that its layer has in a piece that it is fitted to, where there are `LAYER_PIECES` of those [1]. With
all that are nearer to it than to others, a spectrum that turns as a cosine lost a fifth of its swing."""

BLOCK_PIECES: Final = 20
"""Most pieces that are left out together [count]: two seconds, eight times as long as a surface's slow gain lasts."""

FOLDS: Final = 5
"""In how many parts the blocks are left out [count]."""

GAIN: Final = 0.2
"""Least that layers gain on pieces left out, in twice the logarithm of the likelihood a piece [1]."""

SURE: Final = 2.0
"""How many standard errors of it, over the blocks, that must be [1]."""


class Layers(NamedTuple):
    """Where layers stand.

    Attributes:
        by: what they are of, a name of `PERIOD_RAD`.
        at_rad: (k,) their places, ascending.
        gain: twice the logarithm of the likelihood that they gained, a piece [1].
        near: (n,) the layer that each piece is of, −1 of those between two, or without such a variable.
    """

    by: str
    at_rad: Array
    gain: float
    near: NDArray[np.intp]


def find_layers(pieces: Pieces, rate_Hz: float, by: str) -> Layers | str:
    """The layers of a surface by "direction", of which its axis may do, or by "contact_angle"; or why there are none.

    Among those that gain about as much the plainest are taken.
    """
    angle = third_of(pieces, by)
    if angle is None or not np.any(known := np.isfinite(angle)):
        return f"no {by.replace('_', ' ')} was recorded"
    kept = pieces[known]
    levels, plane = _levels(kept, rate_Hz), _plane(kept)
    block = _blocks(kept)
    told, tried = by.replace("_", " "), []
    for kind in ("axis", "direction") if by == "direction" else (by,):
        for at in _places(angle[known], kind):
            gained = _gain(levels, plane, layer_shares(angle[known], at, kind), block)
            if gained is not None:
                tried.append((gained, kind, at))
    if not tried:
        return f"the {told} changed too little for layers of it, or too seldom"
    gains = np.array([gained for gained, *_ in tried])
    behind = gains[np.argmax(gains.sum(axis=1))] - gains
    chance = behind.std(axis=1) / np.sqrt(gains.shape[1])
    gained, kind, at = tried[int(np.argmax(behind.mean(axis=1) <= 0.5 * chance))]
    gain = float(gained.sum() / len(kept))
    if not (gain > GAIN and gained.mean() > SURE * gained.std(ddof=1) / np.sqrt(len(gained))):
        return f"layers of the {told} gain nothing that is sure on pieces left out ({gain:.2f}, {GAIN:g} are asked)"
    share = layer_shares(angle[known], at, kind)
    if not _felt(levels, plane, share):
        return f"no band differs by what is felt ({BAND_DB:g} dB) over the {told}"
    near = np.full(len(pieces), -1)
    near[known] = np.where(share.max(axis=1) > OWN_SHARE, np.argmax(share, axis=1), -1)
    if np.bincount(near[near >= 0], minlength=len(at)).min() < LAYER_PIECES:
        near[known] = np.argmax(share, axis=1)
    return Layers(kind, at, gain, near)


def _levels(pieces: Pieces, rate_Hz: float) -> Array:
    """Levels (n, b) of pieces in bands [dB]."""
    edges = np.geomspace(metric.BAND_EDGES_HZ[0], metric.BAND_EDGES_HZ[-1], BANDS + 1)
    edges = edges[edges <= 0.5 * rate_Hz]
    rows = pieces.acceleration_m_s2
    power = np.abs(np.fft.rfft(rows * np.hanning(rows.shape[1]), axis=1)) ** 2
    edge = np.searchsorted(np.fft.rfftfreq(rows.shape[1], 1.0 / rate_Hz), edges)
    bands = np.add.reduceat(power[:, : edge[-1]], edge[:-1], axis=1)
    return np.asarray(10.0 * np.log10(np.maximum(bands, 1e-9 * bands.mean())))


def _plane(pieces: Pieces) -> Array:
    """What is known of pieces beside the third variable (n, 2): logarithms of force and speed."""
    known = np.log([pieces.force_N, pieces.speed_m_s]).T
    return np.asarray(known - known.mean(axis=0))


def _blocks(pieces: Pieces) -> NDArray[np.intp]:
    """Number of the block (n,) of each piece: neighbours, of about `BLOCK_PIECES`."""
    size = int(np.clip(len(pieces) // (4 * FOLDS), 1, BLOCK_PIECES))
    return np.asarray(np.arange(len(pieces)) // size)


def _places(angle_rad: Array, by: str) -> Iterator[Array]:
    """Where layers could stand: means of clusters on the circle or the line, begun far from one another."""
    period = PERIOD_RAD[by]

    def away(at: Array) -> Array:
        off = angle_rad[:, None] - at
        return np.asarray(off if np.isinf(period) else (off + 0.5 * period) % period - 0.5 * period)

    for count in COUNTS[by]:
        found: list[Array] = []
        for start in angle_rad[np.linspace(0, len(angle_rad) - 1, STARTS).astype(int)]:
            at = np.array([start])
            while len(at) < count:
                at = np.append(at, angle_rad[np.argmax(np.abs(away(at)).min(axis=1))])
            for _ in range(30):
                off = away(at)
                near = np.argmin(np.abs(off), axis=1)
                size = np.bincount(near, minlength=count)
                if size.min() < LAYER_PIECES:
                    break
                at = at + np.array([off[near == i, i].mean() for i in range(count)])
            at = np.sort(at if np.isinf(period) else at % period % period)  # once: a hair below 0 is the period
            gaps = np.diff(at if np.isinf(period) else np.append(at, at[0] + period))
            alike = any(np.abs(away(at) - away(other)).max() < SAME_RAD for other in found)
            if size.min() >= LAYER_PIECES and gaps.min() > APART_RAD[by] and not alike:
                found.append(at)
        yield from found


def _gain(levels: Array, plane: Array, layer: Array, block: NDArray[np.intp]) -> Array | None:
    """What layers gain on each block left out (b,), in twice the logarithm of the likelihood; None if one says nothing.

    Residuals are weighed by the covariance of those without layers, of the pieces that were not left out.
    """
    gained = np.zeros(block[-1] + 1)
    one = np.ones((len(plane), 1))
    for fold in range(FOLDS):
        out = block % FOLDS == fold
        if layer[~out].sum(axis=0).min() < 1.0:
            return None
        both = np.hstack([one, plane]), np.hstack([layer, plane])
        left = [levels - x @ np.linalg.lstsq(x[~out], levels[~out], rcond=1e-6)[0] for x in both]
        spread = np.cov(left[0][~out].T) + 0.01 * np.eye(levels.shape[1])
        square = [np.einsum("nb,nb->n", one_left, np.linalg.solve(spread, one_left.T).T) for one_left in left]
        np.add.at(gained, block[out], (square[0] - square[1])[out])
    return gained


def _felt(levels: Array, plane: Array, layer: Array) -> bool:
    """Whether layers differ in a band by what is felt."""
    offset = np.linalg.lstsq(np.hstack([layer, plane]), levels, rcond=1e-6)[0][: layer.shape[1]]
    return bool(np.ptp(offset, axis=0).max() >= BAND_DB)
