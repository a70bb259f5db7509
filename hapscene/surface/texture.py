"""The texture of a surface: AR models of vibration over normal force and slip speed.

After Culbertson, Unwin & Kuchenbecker 2014 ("Modeling and Rendering Realistic Textures from Unconstrained
Tool-Surface Interactions", IEEE Trans. Haptics 7(3)): each model is a vertex of a triangulation of the plane of normal
force and slip speed. At a given force and speed, the three models of the triangle there are blended.
"""

import math
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from hapscene.constants import LEVEL_BOUND_DB, ORDER_MAX
from hapscene.dsp.ar_filter import (
    ar_from_lsf,
    ar_from_reflection,
    lsf_from_ar,
    power_gain,
    power_response,
    reflection_from_ar,
)
from hapscene.errors import SwatchError
from hapscene.io.files import short
from hapscene.surface.gain_modulation import GainModulation
from hapscene.surface.taps import ByContent, freeze

__all__ = [
    "EXPONENT_MAX",
    "GAIN_MAX",
    "INTERPOLATIONS",
    "MODEL_MAX",
    "Texture",
    "filters",
    "form",
    "stabilised",
    "triangulate",
]

# Triangulation of the plane of normal force and slip speed around the models of a texture.


Array = NDArray[np.float64]

NEAR: Final = 0.02
"""Distance within which no second model is added along a side of the rectangle, relative to that side [1]. A smaller
distance would make sliver triangles."""


def close(force_N: Array, speed_m_s: Array) -> tuple[Array, Array, NDArray[np.intp], Array]:
    """Add models that close the rectangle of force and speed.

    Each model is copied onto the two axes as a silent model, so that its spectrum keeps its shape while the level
    falls. The nearest model is copied onto the two sides of largest force and speed. Without it, a point beyond the
    last model of its speed would be blended from models of other speeds.

    Returns:
        Forces, speeds, the index of the model that each is a copy of, and 0 for silent models, 1 for others.
    """
    force_N, speed_m_s = np.asarray(force_N, dtype=np.float64), np.asarray(speed_m_s, dtype=np.float64)
    if force_N.shape != speed_m_s.shape or not np.all((force_N > 0.0) & (speed_m_s > 0.0)):
        raise SwatchError("texture: each model needs a force_N and a speed_m_s above 0")
    place = np.stack([force_N / force_N.max(), speed_m_s / speed_m_s.max()], axis=1)
    x, y = np.sort(place, axis=0)[::-1].T
    count = len(place)
    for axis in (0, 1):
        for side in (0.0, 1.0):
            along = [1.0, 0.0]  # corners first
            for at in (y, x)[axis]:
                if np.abs(np.array(along) - at).min() > NEAR:
                    along.append(float(at))
            thrown = np.insert(np.array(along)[:, None], axis, side, axis=1)
            there = (np.abs(thrown[:, None] - place).max(axis=2) < 1e-9).any(axis=1)
            place = np.vstack([place, thrown[~there]])
    away = np.linalg.norm(place[:, None] - place[None, :count], axis=2)
    sounding = (place.min(axis=1) > 0.0).astype(np.float64)
    # a silent copy has the spectrum of the model that was projected: the one at its speed or force, not the nearest
    beside = np.where(sounding[:, None] > 0.0, away, _beside(place, place[:count]))
    top = np.array([force_N.max(), speed_m_s.max()])
    force, speed = (place * top).T
    force[:count], speed[:count] = force_N, speed_m_s  # exactly, not scaled back and forth
    return force, speed, np.argmin(beside, axis=1), sounding


def _beside(place: Array, model: Array) -> Array:
    """Return distances (k, m) of models from points on an axis: along the axis, plus 1 % of the distance across it."""
    off = np.abs(place[:, None] - model)
    on_force_axis = (place[:, 1] == 0.0)[:, None]
    along, across = np.where(on_force_axis, off[..., 0], off[..., 1]), np.where(on_force_axis, off[..., 1], off[..., 0])
    return np.asarray(along + 0.01 * across)


def triangulate(force_N: Array, speed_m_s: Array) -> NDArray[np.int32]:
    """Return Delaunay triangles (t, 3) over the plane scaled to 1 × 1, without degenerate ones."""
    x, y = force_N / force_N.max(), speed_m_s / speed_m_s.max()
    # Four models on a rectangle can be split along either diagonal. A slight stretch selects the diagonal from silence
    # to full level, along which the level does not sag.
    triangles = scipy.spatial.Delaunay(np.stack([x + y, 1.001 * (x - y)], axis=1)).simplices
    corner = np.stack([x, y], axis=1)[triangles]
    side = corner[:, 1:] - corner[:, :1]
    area = np.abs(side[:, 0, 0] * side[:, 1, 1] - side[:, 0, 1] * side[:, 1, 0])
    return _opened(np.asarray(triangles[area > 1e-6], dtype=np.int32), np.minimum(x, y) == 0.0)


def _opened(triangles: NDArray[np.int32], silent: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Replace triangles with three silent corners: the one at the origin is joined to a model that is not silent."""
    opened = [list(map(int, corners)) for corners in triangles]
    for dead in [corners for corners in opened if silent[corners].all()]:
        for other in opened:
            edge = [corner for corner in dead if corner in other]
            if other is not dead and len(edge) == 2 and not silent[other].all():
                (origin,), (beyond,) = set(dead) - set(edge), set(other) - set(edge)
                dead[:], other[:] = [origin, edge[0], beyond], [origin, beyond, edge[1]]
                break
    return np.asarray(opened, dtype=np.int32)


# Interpolation: how the models of a triangle become one filter.
#
# | interpolation | blended quantity | stable |
# |---|---|---|
# | `lsf` | line spectral frequencies | always |
# | `reflection` | reflection coefficients | always |
# | `direct` | coefficients a_k, as in Culbertson, Unwin & Kuchenbecker 2014 | after correction, see below |
# | `hatt` | line spectral frequencies and variance of the excitation, as in the Penn toolkit | always |
#
# The first three blend the power of the output and choose the excitation to match; the last blends the excitation.
#
# A weighted mean of the coefficients of stable filters can be unstable: between random pairs, it is somewhere in 13, 73
# and 99 % of cases at order 3, 8 and 20. The poles of an unstable mean are moved towards the origin, a_k ← γ^k a_k,
# with the largest γ = 1 − 2^−n for which the filter is stable and its power gain bounded. The peaks of the spectrum
# keep their frequencies and get wider.


INTERPOLATIONS: Final = ("lsf", "reflection", "direct", "hatt")
"""Names of the interpolations."""

GAIN_MAX: Final = 1e8
"""Largest power gain of a blended filter [1]. Models of recordings have 1e1 to 1e5."""

SHRINK_BITS: Final = 12
"""γ is 1 − 2^−n for n from this number down to 1: bandwidths from a tenth of a hertz upwards."""


def form(interpolation: str, lsf_rad: Array) -> Array:
    """Return the models (m, p) in the coordinates that the interpolation blends."""
    if interpolation == "reflection":
        return reflection_from_ar(ar_from_lsf(lsf_rad))
    if interpolation == "direct":
        return np.asarray(ar_from_lsf(lsf_rad)[:, 1:])
    return lsf_rad


def filters(interpolation: str, blended: Array) -> Array:
    """Return stable filters (n, p+1) of blended coordinates (n, p)."""
    if interpolation == "reflection":
        return ar_from_reflection(blended)
    if interpolation == "direct":
        return stabilised(np.concatenate([np.ones((len(blended), 1)), blended], axis=1))
    return ar_from_lsf(blended)


def stabilised(a: Array) -> Array:
    """Move the poles of unstable filters (n, p+1) towards the origin; stable filters are returned unchanged."""
    a = a.copy()
    unstable = np.flatnonzero(~(power_gain(a) < GAIN_MAX))
    k = np.arange(a.shape[1])
    original = a[unstable]
    for n in range(SHRINK_BITS, 0, -1):
        if len(unstable) == 0:
            break
        a[unstable] = original * (1.0 - 0.5**n) ** k
        remaining = ~(power_gain(a[unstable]) < GAIN_MAX)
        unstable, original = unstable[remaining], original[remaining]
    # at γ = 1/2 every mean of stable filters is stable; coefficients of an untrusted file may not be
    a[unstable, 1:] = 0.0
    return a


MODEL_MAX: Final = 4096
"""Most models of a texture [count]. Swatches have 4 to 200; more models slow down the search."""

POWER_GAIN_MAX: Final = 1e10
"""Largest power gain of a model [1]. Recordings give 1e1 to 1e5; at 1e14 double precision cannot tell a stable filter
from an unstable one."""

LINE_NOISE: Final = 1e-9
"""Power of the noise that is added to a spectral line to make a filter stable, relative to the line [1]."""


POWER_MAX: Final = 1e12
"""Largest variance of the output of a model [(m/s²)²]. Surfaces give 1e-2 to 1e3."""

WARP_MAX: Final = 0.99
"""Largest |warp| [1]. 0.75 is used at 10 kHz, and corresponds to 0.94 at 48 kHz."""

EXPONENT_MAX: Final = 8.0
"""Largest |exponent| of the power over force or speed [1]. Surfaces have 0 to 4."""


@dataclass(frozen=True, eq=False)
class Texture(ByContent):
    """AR models over normal force and slip speed, triangulated.

    Build a texture from filters with `Texture.from_models`, which adds silent models and triangles.

    Attributes:
        rate_Hz: sample rate of the models.
        force_N, speed_m_s: (m,) normal force and slip speed of each model, ≥ 0.
        triangles: (t, 3) indices of the models at the corners; together they cover the rectangle up to the maxima.
        lsf_rad: (m, p) line spectral frequencies of each model, ascending in (0, π).
        variance_m2_s4: (m,) variance of the white excitation [(m/s²)²]; 0 for silence.
        interpolation: how models are blended, one of `INTERPOLATIONS` (see `hapscene.surface.texture`).
        warp: allpass coefficient λ of D(z) = (z⁻¹ − λ)/(1 − λ z⁻¹), which replaces each unit delay (frequency
            warping). 0 for plain AR models; λ > 0 resolves low frequencies better, λ < 0 high ones. |λ| ≤ `WARP_MAX`.
        exponents: (2,) beyond the largest force F and speed V, the power grows as (force/F)^exponents[0]
            (speed/V)^exponents[1], by at most `LEVEL_BOUND_DB`; (0, 0) for constant power.
        modulation: amplitude modulation, or None for a steady level.

    Raises:
        SwatchError: arrays have inconsistent shapes, numbers are not finite, or a model is unstable.
    """

    rate_Hz: float
    force_N: Array
    speed_m_s: Array
    triangles: NDArray[np.int32]
    lsf_rad: Array
    variance_m2_s4: Array
    interpolation: str = "lsf"
    warp: float = 0.0
    exponents: Array = field(default_factory=lambda: np.zeros(2))
    modulation: GainModulation | None = None
    _form: Array = field(init=False, repr=False)  # (m, p) coordinates that the interpolation blends
    _power: Array = field(init=False, repr=False)  # (m,) variance of each model's output
    _inverse: Array = field(init=False, repr=False)  # (t, 3, 3): (force, speed, 1) to barycentric coordinates

    def __post_init__(self) -> None:
        for name in ("force_N", "speed_m_s", "lsf_rad", "variance_m2_s4", "exponents"):
            freeze(self, name, getattr(self, name))
        freeze(self, "triangles", self.triangles, np.int32)
        _check_shapes(self)
        freeze(self, "_power", _checked_power(self.variance_m2_s4, self.lsf_rad, self.warp))
        freeze(self, "_form", form(self.interpolation, self.lsf_rad))
        freeze(self, "_inverse", _checked_inverse(self))

    def __repr__(self) -> str:
        return (
            f"<Texture: {len(self.force_N)} models of order {self.order} at {self.rate_Hz:g} Hz; up to "
            f"{self.force_N.max():g} N and {self.speed_m_s.max():g} m/s>"
        )

    @classmethod
    def from_models(
        cls,
        rate_Hz: float,
        force_N: ArrayLike,
        speed_m_s: ArrayLike,
        *,
        a: ArrayLike,
        variance_m2_s4: ArrayLike,
        interpolation: str = "lsf",
        warp: float = 0.0,
        exponents: ArrayLike = (0.0, 0.0),
        modulation: GainModulation | None = None,
    ) -> "Texture":
        """Make a texture from filters `a` (m, p+1) at `force_N` (m,), `speed_m_s` (m,), all > 0.

        The rectangle from zero to the largest force and speed is closed with silent models on its two axes, and with
        copies of the nearest models at its far sides. With a `warp`, `a` are polynomials in D.
        """
        models = np.atleast_2d(np.asarray(a, dtype=np.float64))
        lsf = np.stack([lsf_from_ar(one) for one in models])
        force, speed, source, sounding = close(np.ravel(force_N), np.ravel(speed_m_s))
        variance = np.ravel(np.asarray(variance_m2_s4, dtype=np.float64))[source] * sounding
        edges = np.asarray(exponents, dtype=np.float64)
        places = force, speed, triangulate(force, speed)
        return cls(rate_Hz, *places, lsf[source], variance, interpolation, warp, edges, modulation)

    @property
    def order(self) -> int:
        """Order p of the models."""
        return int(self.lsf_rad.shape[1])

    @property
    def force_max_N(self) -> float:
        """Largest force of a model; beyond it only the level changes, see `beyond`."""
        return float(self.force_N.max())

    @property
    def speed_max_m_s(self) -> float:
        """Largest slip speed of a model; beyond it only the level changes, see `beyond`."""
        return float(self.speed_m_s.max())

    @property
    def model_power_m2_s4(self) -> Array:
        """(m,) variance of the output of each model [(m/s²)²]."""
        return self._power

    def model(self, force_N: float, speed_m_s: float) -> tuple[Array, float]:
        """Return the filter a (p+1,) and its excitation variance [(m/s²)²] at a normal force [N] and slip speed [m/s].

        The output is y(t) = e(t) − Σ a_k y(t−k), a[0] = 1; with a `warp`, 1/A(D(z)), where D^k replaces k delays. The
        filter is always stable. It is silent (variance 0) at zero force or speed. Above the largest force or speed it
        is that of the maximum, with the level of `beyond`.
        """
        a, variance = self.models(np.array([force_N]), np.array([speed_m_s]))
        return a[0], float(variance[0])

    def models(self, force_N: ArrayLike, speed_m_s: ArrayLike) -> tuple[Array, Array]:
        """Return filters a (n, p+1) and variances (n,) at forces (n,) and slip speeds (n,); see `model`."""
        corner, weight = self.locate(force_N, speed_m_s)
        if self.single:
            a = np.tile(filters(self.interpolation, self._form[:1]), (len(corner), 1))
        else:
            a = filters(self.interpolation, np.einsum("nc,ncp->np", weight, self._form[corner]))
        if self.interpolation == "hatt":
            variance = np.einsum("nc,nc->n", weight, self.variance_m2_s4[corner])
        else:
            variance = np.einsum("nc,nc->n", weight, self._power[corner]) / power_gain(a, self.warp)
        variance *= self.beyond(force_N, speed_m_s)
        sounding = (np.asarray(force_N) > 0.0) & (np.asarray(speed_m_s) > 0.0)  # rounding leaves 1e-17 on the axes
        return a, np.where(sounding, variance, 0.0)

    def lattice(self, force_N: ArrayLike, speed_m_s: ArrayLike) -> tuple[Array, Array]:
        """Return reflection coefficients (n, p) and power of the output (n,) [(m/s²)²] for `hapscene.dsp.lattice`.

        The coefficients have one row if all models have the same filter.
        """
        force, slip = np.asarray(force_N, dtype=np.float64), np.asarray(speed_m_s, dtype=np.float64)
        if self.interpolation == "hatt" and not self.single:
            a, variance = self.models(force, slip)
            return reflection_from_ar(a), variance * power_gain(a, self.warp)
        blended = self._form[:1]
        if not self.single:
            corner, weight = self.locate(force, slip)
            blended = np.einsum("nc,ncp->np", weight, self._form[corner])
        k = reflection_from_ar(filters(self.interpolation, blended))
        return k, np.where((force > 0.0) & (slip > 0.0), self.power(force, slip), 0.0)

    def density(self, force_N: ArrayLike, speed_m_s: ArrayLike, *, frequency_Hz: ArrayLike) -> Array:
        """Return the one-sided power spectrum (n, k) [(m/s²)²/Hz] at forces (n,), speeds (n,) and frequencies (k,)."""
        a, variance = self.models(force_N, speed_m_s)
        omega_rad = 2.0 * np.pi / self.rate_Hz * np.asarray(frequency_Hz, dtype=np.float64)
        return np.asarray(2.0 / self.rate_Hz * variance[:, None] * power_response(a, omega_rad, self.warp))

    def beyond(self, force_N: ArrayLike, speed_m_s: ArrayLike) -> Array:
        """Return the factor (n,) on the power at forces (n,) and speeds (n,) beyond the models, 1 within them [1].

        See `exponents`. The factor is limited to `LEVEL_BOUND_DB` up or down.
        """
        log, most = np.zeros(np.shape(force_N)), 0.1 * LEVEL_BOUND_DB * math.log(10.0)
        edges = (force_N, self.force_max_N), (speed_m_s, self.speed_max_m_s)
        for exponent, (value, edge) in zip(self.exponents, edges, strict=True):
            within = np.clip(np.nan_to_num(np.asarray(value, dtype=np.float64)), edge, 1e9 * edge)
            log = log + exponent * np.log(within / edge)
        return np.exp(np.clip(log, -most, most))

    @property
    def log_spread(self) -> float:
        """Standard deviation of the logarithm of the amplitude modulation; 0 without one."""
        return 0.0 if self.modulation is None else self.modulation.log_spread

    @property
    def single(self) -> bool:
        """Whether all models have the same filter and differ in level only."""
        return bool(np.all(self.lsf_rad == self.lsf_rad[0]))

    def locate(self, force_N: ArrayLike, speed_m_s: ArrayLike) -> tuple[NDArray[np.int32], Array]:
        """Return the models that are blended at forces (n,) and slip speeds (n,): indices (n, 3) and weights (n, 3).

        Weights are barycentric: ≥ 0 with sum 1. Inputs are clamped to the rectangle of the models; NaN counts as
        zero.
        """
        force = np.clip(np.nan_to_num(np.asarray(force_N, dtype=np.float64)), 0.0, self.force_max_N)
        speed = np.clip(np.nan_to_num(np.asarray(speed_m_s, dtype=np.float64)), 0.0, self.speed_max_m_s)
        place = np.stack([force, speed, np.ones_like(force)])
        weight = self._inverse @ place  # (t, 3, n)
        best = np.argmax(weight.min(axis=1), axis=0)  # the triangle that contains the point, or the nearest one
        inside = weight[best, :, np.arange(len(best))]
        inside[inside < 1e-12] = 0.0  # rounding: on the axes the texture is exactly silent
        return self.triangles[best], inside / inside.sum(axis=1, keepdims=True)

    def power(self, force_N: ArrayLike, speed_m_s: ArrayLike) -> Array:
        """Return the variance (n,) of the acceleration [(m/s²)²] at forces (n,) and slip speeds (n,).

        It is blended from the models. `models` has exactly this power, except with the interpolation "hatt".
        """
        corner, weight = self.locate(force_N, speed_m_s)
        return np.asarray(np.einsum("nc,nc->n", weight, self._power[corner]) * self.beyond(force_N, speed_m_s))

    def resampled(self, rate_Hz: float) -> "Texture":
        """Return the texture for another sample rate, with the same power in the common band.

        The order grows with the rate, and stays when the rate falls; a warp is adapted. See the comment on resampling
        in `hapscene.surface.texture` for method and error.

        Raises:
            SwatchError: the rate is not above 0, or not from 1/64 to 64 times that of the texture.
        """
        ratio = rate_Hz / self.rate_Hz
        if not 1 / 64 <= ratio <= 64:
            raise SwatchError(
                f"a texture at {self.rate_Hz:g} Hz cannot be resampled to {rate_Hz} Hz (1/64 to 64 times)"
            )
        if ratio == 1.0:
            return self
        if self.warp == 0.0:
            return self._refitted(rate_Hz, max(self.order, math.ceil(self.order * ratio)), 0.0)
        order = math.ceil(WARPED_ORDER * self.order) if ratio > 1.0 else self.order
        return self._refitted(rate_Hz, order, _warp_at(self.warp, ratio))

    def _refitted(self, rate_Hz: float, order: int, warp: float) -> "Texture":
        """Fit models of the same spectra at another rate, order and warp."""
        order, ratio = min(ORDER_MAX, order), rate_Hz / self.rate_Hz
        rows, row = np.unique(self.lsf_rad, axis=0, return_inverse=True)  # silent models are copies of others
        if warp == self.warp == 0.0:
            refitted = [_refit(a, ratio, order) for a in ar_from_lsf(rows)]
        else:
            refitted = [_refit_warped(a, ratio, order, self.warp, warp) for a in ar_from_lsf(rows)]
        lsf = np.stack([lsf_from_ar(a) for a, _ in refitted])[row]
        variance = self.variance_m2_s4 * np.array([share for _, share in refitted])[row]
        return replace(self, rate_Hz=float(rate_Hz), lsf_rad=lsf, variance_m2_s4=variance, warp=warp)

    def truncated(self, order: int) -> "Texture":
        """Return the texture with models of at most this order, each with the same power.

        The first reflection coefficients of a model are those of the best model of that order for the same signal:
        its autocorrelation is kept up to that lag (Makhoul 1975, "Linear prediction: a tutorial review", sec. III).

        Raises:
            SwatchError: the order is below 1.
        """
        if not order >= 1 or order % 1 != 0:
            raise SwatchError(f"the order of a texture must be an integer of at least 1, is {order}")
        if order >= self.order:
            return self
        rows, row = np.unique(self.lsf_rad, axis=0, return_inverse=True)  # silent models are copies of others
        shorter = ar_from_reflection(reflection_from_ar(ar_from_lsf(rows))[:, : int(order)])
        lsf = np.stack([lsf_from_ar(a) for a in shorter])[row]
        variance = self._power / power_gain(shorter, self.warp)[row]
        return replace(self, lsf_rad=lsf, variance_m2_s4=variance)


def _check_shapes(texture: Texture) -> None:
    """Check shapes and ranges, before any computation with the filters."""
    count = len(texture.force_N) if texture.force_N.ndim == 1 else 0
    if not 3 <= count <= MODEL_MAX:
        raise SwatchError(f"texture: force_N must list 3 to {MODEL_MAX} models, its shape is {texture.force_N.shape}")
    for name in ("speed_m_s", "variance_m2_s4"):
        if getattr(texture, name).shape != (count,):
            raise SwatchError(f"texture: {name} must have shape ({count},), has {getattr(texture, name).shape}")
    lsf, triangles = texture.lsf_rad, texture.triangles
    if lsf.ndim != 2 or len(lsf) != count or not 1 <= lsf.shape[1] <= ORDER_MAX:
        raise SwatchError(f"texture: lsf_rad must have shape ({count}, 1 to {ORDER_MAX}), has {lsf.shape}")
    if triangles.ndim != 2 or triangles.shape[1] != 3 or not 1 <= len(triangles) <= 2 * count:
        raise SwatchError(f"texture: triangles must have shape (1 to {2 * count}, 3), has {triangles.shape}")
    if triangles.min() < 0 or triangles.max() >= count:
        raise SwatchError(f"texture: triangles name models {triangles.min()} to {triangles.max()}, there are {count}")
    for name in ("force_N", "speed_m_s", "variance_m2_s4"):
        array = getattr(texture, name)
        if not np.all(np.isfinite(array) & (array >= 0.0)):
            raise SwatchError(f"texture: {name} must be finite and not negative")
    if not (np.isfinite(texture.rate_Hz) and texture.rate_Hz > 0.0):
        raise SwatchError(f"texture: rate_Hz must be above 0, is {texture.rate_Hz}")
    if texture.interpolation not in INTERPOLATIONS:
        raise SwatchError(f"texture: interpolation {texture.interpolation!r} must be one of {INTERPOLATIONS}")
    if not abs(texture.warp) <= WARP_MAX:
        raise SwatchError(f"texture: warp must be from -{WARP_MAX} to {WARP_MAX}, is {texture.warp}")
    exponents = texture.exponents
    if exponents.shape != (2,) or not np.all(np.abs(exponents) <= EXPONENT_MAX):
        raise SwatchError(
            f"texture: exponents must be two numbers from -{EXPONENT_MAX:g} to {EXPONENT_MAX:g}, of force and of "
            f"speed, not {exponents.ravel()[:3].tolist()}"
        )
    if not isinstance(texture.modulation, GainModulation | None):
        raise SwatchError(f"texture: modulation must be a GainModulation or None, is {short(texture.modulation)}")


def _checked_power(variance_m2_s4: Array, lsf_rad: Array, warp: float) -> Array:
    """Return the variance of the output (m,) of models (m, p); rejects unstable and excessively loud models."""
    ascending = np.diff(lsf_rad, axis=1, prepend=0.0, append=np.pi) > 0.0  # also False for NaN
    bad = np.flatnonzero(~ascending.all(axis=1))
    if len(bad):
        raise SwatchError(f"texture: model {bad[0]} is unstable: lsf_rad must ascend strictly between 0 and π")
    gain = power_gain(ar_from_lsf(lsf_rad), warp)
    bad = np.flatnonzero(~(gain < POWER_GAIN_MAX))
    if len(bad):
        raise SwatchError(
            f"texture: model {bad[0]} is too close to unstable: its power gain is over {POWER_GAIN_MAX:g}, "
            "two of its lsf_rad are almost equal"
        )
    bad = np.flatnonzero(variance_m2_s4 > POWER_MAX / gain)
    if len(bad):
        raise SwatchError(f"texture: model {bad[0]} is louder than any surface: its power is over {POWER_MAX:g} m²/s⁴")
    return variance_m2_s4 * gain


def _checked_inverse(texture: Texture) -> Array:
    """Return (t, 3, 3) matrices from (force, speed, 1) to barycentric coordinates in each triangle."""
    corner = np.stack([texture.force_N, texture.speed_m_s, np.ones_like(texture.force_N)], axis=1)
    matrix = corner[texture.triangles].transpose(0, 2, 1)
    scale = texture.force_max_N * texture.speed_max_m_s
    flat = np.flatnonzero(np.abs(np.linalg.det(matrix)) <= 1e-9 * scale)
    if len(flat):
        raise SwatchError(f"texture: triangle {flat[0]} has no area over force and speed")
    return np.asarray(np.linalg.inv(matrix))


# Resampling: a texture for another sample rate has the same spectrum in the common band.
#
# The power spectral density of each model is cut at the lower of the two Nyquist frequencies, transformed to an
# autocorrelation at the new rate, and fitted (Makhoul 1975, "Linear prediction: a tutorial review", sec. III). At a
# higher rate, nothing is known above the old Nyquist frequency: there the density is set to the smallest value of the
# model, which keeps the filter well conditioned and adds the least power.
#
# Error in 20–1000 Hz for the shipped swatches: 0.02 dB rms, at most 0.03 dB, from 4 to 48 kHz; 0.3 to 1.2 dB rms where
# the order would exceed `ORDER_MAX`, as orders above 60 do at 96 kHz. The power in the common band has the same error.
# The power added above it is at most 0.01 dB of the total at 48 kHz for three of the four swatches, but 1.3 dB
# (0.4 dB at 20 kHz) for epoxy, whose recording is noise above 1 kHz.


_WARPED_BINS: Final = 1 << 13  # over the phase of D, half the unit circle

WARPED_ORDER: Final = 1.5
"""Ratio of the order of a warped model at a higher rate to its original order [1]."""

_BINS: Final = 1 << 16  # bins of the spectrum at the old rate: 0.15 Hz at 10 kHz, narrower than any resonance


def _refit(a: Array, ratio: float, order: int) -> tuple[Array, float]:
    """Return the filter (order+1,) at `ratio` times the rate of `a`, and its excitation variance for 1 of `a`."""
    # one-sided samples of the density at 2π j / _BINS rad, scaled so that their mean over the circle is the power
    density = 1.0 / np.abs(np.fft.rfft(a, _BINS)) ** 2
    density *= power_gain(a) / np.fft.irfft(density)[0]
    kept = np.full(round(_BINS * ratio / 2) + 1, density.min())
    shared = min(len(kept), len(density))
    kept[:shared] = density[:shared]
    r = np.fft.irfft(kept)[: order + 1] * ratio  # the same density per Hz is more power per sample at a higher rate
    return _predictor(r)


def _predictor(r: Array) -> tuple[Array, float]:
    """Return the filter (p+1,) that predicts a signal of autocovariances (p+1,), and the variance of its excitation.

    The filter of a spectral line without noise, as of a grating, would be almost unstable: noise of −90 dB is added.
    """
    for noise in (0.0, LINE_NOISE):
        made = np.concatenate(
            [[1.0], scipy.linalg.solve_toeplitz(np.concatenate([[(1.0 + noise) * r[0]], r[1:-1]]), -r[1:])]
        )
        gain = float(power_gain(made))
        if gain < POWER_GAIN_MAX:
            break
    return made, float(r[0] / gain)


def _warp_at(warp: float, ratio: float) -> float:
    """Return the warp at `ratio` times the rate that maps low frequencies to the same phase; 0 stays 0.

    Near 0 Hz the phase of D grows (1 + λ)/(1 − λ) times as fast as that of a delay.
    """
    if warp == 0.0:
        return 0.0
    stretch = ratio * (1.0 + warp) / (1.0 - warp)
    there = (stretch - 1.0) / (stretch + 1.0)
    return min(max(there, 0.0), WARP_MAX) if warp > 0.0 else max(min(there, 0.0), -WARP_MAX)


def _refit_warped(a: Array, ratio: float, order: int, old: float, new: float) -> tuple[Array, float]:
    """Refit a filter from warp `old` to warp `new`: over the phase of D its spectrum is that of an AR model."""
    phase = np.exp(-1j * np.pi / _WARPED_BINS * np.arange(_WARPED_BINS + 1))
    # frequency at which D has this phase, at the old rate
    omega = -np.angle((phase + new) / (1.0 + new * phase)) * ratio
    density = np.full(len(omega), power_response(a, np.linspace(0.0, np.pi, 4096), old).min())
    within = omega <= np.pi
    density[within] = power_response(a, omega[within], old)
    r = np.fft.irfft(density)[: order + 1] * ratio
    return _predictor(r)
