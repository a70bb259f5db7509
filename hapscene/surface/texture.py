"""A surface's vibration under a sliding tool: AR models over normal force and slip speed.

After Culbertson, Unwin & Kuchenbecker 2014 ("Modeling and Rendering Realistic Textures from Unconstrained
Tool-Surface Interactions", IEEE Trans. Haptics 7(3)): each model is a vertex of a triangulation of the plane of
normal force and slip speed; what is asked for lies in a triangle, and its three models are blended.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.constants import EXCITATION_KNOTS, EXCITATION_SPAN, ORDER_MAX
from hapscene.errors import SwatchError
from hapscene.surface.blend import INTERPOLATIONS, filters, form
from hapscene.surface.lsf import ar_from_lsf, lsf_from_ar, power_gain, reflection_from_ar
from hapscene.surface.triangulation import close, triangulate

Array = NDArray[np.float64]

MODEL_MAX: Final = 4096
"""Most models of a texture [count]. Swatches have 4 to 200; more only makes the search slow."""

POWER_GAIN_MAX: Final = 1e10
"""Largest power gain of a model [1]. Real recordings give 1e1 to 1e5; at 1e14 double precision no longer tells
a stable filter from an unstable one."""


POWER_MAX: Final = 1e12
"""Largest variance of a model's output [(m/s²)²]. Real surfaces give 1e-2 to 1e3; beyond this it is no vibration."""


@dataclass(frozen=True, eq=False)
class Texture:
    """AR models over (normal force, slip speed), triangulated.

    Attributes:
        rate_Hz: sample rate that the models are made for.
        force_N: (m,) normal force of each model, ≥ 0.
        speed_m_s: (m,) slip speed of each model, ≥ 0.
        triangles: (t, 3) indices of the models at the corners; together they fill the rectangle up to the maxima.
        lsf_rad: (m, p) line spectral frequencies of each model, ascending in (0, π).
        variance_m2_s4: (m,) variance of the white excitation [(m/s²)²]; 0 is silence.
        interpolation: how models are blended, one of `INTERPOLATIONS` (see `hapscene.surface.blend`).
        excitation: () for Gaussian noise; else (`EXCITATION_KNOTS`,), ascending: the quantiles of the noise, scaled to
            variance 1, at the levels of Gaussian deviates even over ±`EXCITATION_SPAN`.

    Build one from filters with `Texture.from_models`, which adds the silent models and the triangles.

    Raises:
        SwatchError: shapes that do not fit, numbers that are not finite, an unstable model.
    """

    rate_Hz: float
    force_N: Array
    speed_m_s: Array
    triangles: NDArray[np.int32]
    lsf_rad: Array
    variance_m2_s4: Array
    interpolation: str = "lsf"
    excitation: Array = field(default_factory=lambda: np.empty(0))
    _form: Array = field(init=False, repr=False)  # (m, p): what the interpolation blends
    _power: Array = field(init=False, repr=False)  # (m,) variance of each model's output
    _inverse: Array = field(init=False, repr=False)  # (t, 3, 3): (force, speed, 1) to barycentric coordinates

    def __post_init__(self) -> None:
        for name in ("force_N", "speed_m_s", "lsf_rad", "variance_m2_s4", "excitation"):
            _put(self, name, np.array(getattr(self, name), dtype=np.float64))
        _put(self, "triangles", np.array(self.triangles, dtype=np.int32))
        _check_shapes(self)
        _put(self, "_power", _checked_power(self.variance_m2_s4, self.lsf_rad))
        _put(self, "_form", form(self.interpolation, self.lsf_rad))
        _put(self, "_inverse", _checked_inverse(self))

    @classmethod
    def from_models(
        cls,
        rate_Hz: float,
        force_N: ArrayLike,
        speed_m_s: ArrayLike,
        a: ArrayLike,
        variance_m2_s4: ArrayLike,
        interpolation: str = "lsf",
        excitation: ArrayLike = (),
    ) -> "Texture":
        """A texture of filters `a` (m, p+1) at `force_N` (m,), `speed_m_s` (m,), all > 0, closed and triangulated.

        The rectangle from zero to the largest force and speed is closed with silent models on its two axes and,
        where no model stands there, with a copy of the nearest model at its far corner.
        """
        models = np.atleast_2d(np.asarray(a, dtype=np.float64))
        lsf = np.stack([lsf_from_ar(one) for one in models])
        force, speed, source, sounding = close(np.ravel(force_N), np.ravel(speed_m_s))
        variance = np.ravel(np.asarray(variance_m2_s4, dtype=np.float64))[source] * sounding
        noise = np.asarray(excitation, dtype=np.float64)
        return cls(rate_Hz, force, speed, triangulate(force, speed), lsf[source], variance, interpolation, noise)

    @property
    def order(self) -> int:
        """Order p of the models."""
        return int(self.lsf_rad.shape[1])

    @property
    def force_max_N(self) -> float:
        """Largest force there is a model for; more is clamped to it."""
        return float(self.force_N.max())

    @property
    def speed_max_m_s(self) -> float:
        """Largest slip speed there is a model for; more is clamped to it."""
        return float(self.speed_m_s.max())

    @property
    def model_power_m2_s4(self) -> Array:
        """(m,) variance of each model's output [(m/s²)²]."""
        return self._power

    def model(self, force_N: float, slip_m_s: float) -> tuple[Array, float]:
        """The filter a (p+1,) and the excitation's variance [(m/s²)²] at a normal force [N] and slip speed [m/s].

        y(t) = e(t) − Σ a_k y(t−k), a[0] = 1. Always stable. Silent (variance 0) at no force or no speed; above the
        largest force or speed of the models, that of the maximum.
        """
        a, variance = self.models(np.array([force_N]), np.array([slip_m_s]))
        return a[0], float(variance[0])

    def models(self, force_N: ArrayLike, slip_m_s: ArrayLike) -> tuple[Array, Array]:
        """The same at many places: a (n, p+1) and variance (n,) at forces (n,) and slip speeds (n,)."""
        corner, weight = self.locate(force_N, slip_m_s)
        if self.single:
            a = np.tile(filters(self.interpolation, self._form[:1]), (len(corner), 1))
        else:
            a = filters(self.interpolation, np.einsum("nc,ncp->np", weight, self._form[corner]))
        if self.interpolation == "hatt":
            variance = np.einsum("nc,nc->n", weight, self.variance_m2_s4[corner])
        else:
            variance = np.einsum("nc,nc->n", weight, self._power[corner]) / power_gain(a)
        sounding = (np.asarray(force_N) > 0.0) & (np.asarray(slip_m_s) > 0.0)  # rounding leaves 1e-17 on the axes
        return a, np.where(sounding, variance, 0.0)

    def lattice(self, force_N: ArrayLike, slip_m_s: ArrayLike) -> tuple[Array, Array]:
        """The same for `hapscene.surface.lattice`: reflection coefficients (n, p) and power of the output (n,).

        The coefficients have one row where one filter holds everywhere. Power in (m/s²)².
        """
        force, slip = np.asarray(force_N, dtype=np.float64), np.asarray(slip_m_s, dtype=np.float64)
        if self.single:
            sounding = (force > 0.0) & (slip > 0.0)
            k = reflection_from_ar(filters(self.interpolation, self._form[:1]))
            return k, np.where(sounding, self.power(force, slip), 0.0)
        a, variance = self.models(force, slip)
        k = reflection_from_ar(a)
        return k, variance / np.prod((1.0 - k) * (1.0 + k), axis=1)

    @property
    def single(self) -> bool:
        """Whether all models have one filter, and differ in their level alone."""
        return bool(np.all(self.lsf_rad == self.lsf_rad[0]))

    def locate(self, force_N: ArrayLike, slip_m_s: ArrayLike) -> tuple[NDArray[np.int32], Array]:
        """The models that are blended at forces (n,) and slip speeds (n,): indices (n, 3) and weights (n, 3).

        Weights are barycentric, ≥ 0, sum 1. Inputs are clamped to the rectangle of the models; NaN counts as zero.
        """
        force = np.clip(np.nan_to_num(np.asarray(force_N, dtype=np.float64)), 0.0, self.force_max_N)
        speed = np.clip(np.nan_to_num(np.asarray(slip_m_s, dtype=np.float64)), 0.0, self.speed_max_m_s)
        place = np.stack([force, speed, np.ones_like(force)])
        weight = self._inverse @ place  # (t, 3, n)
        best = np.argmax(weight.min(axis=1), axis=0)  # the triangle that holds the place, or the nearest one
        inside = weight[best, :, np.arange(len(best))]
        inside[inside < 1e-12] = 0.0  # rounding: on the axes the texture is silent to the bit
        return self.triangles[best], inside / inside.sum(axis=1, keepdims=True)

    def power(self, force_N: ArrayLike, slip_m_s: ArrayLike) -> Array:
        """Variance (n,) of the acceleration [(m/s²)²] at forces (n,) and slip speeds (n,), blended from the models'.

        This is what `models` gives exactly; with the interpolation "hatt", what it should give.
        """
        corner, weight = self.locate(force_N, slip_m_s)
        return np.asarray(np.einsum("nc,nc->n", weight, self._power[corner]))

    def resampled(self, rate_Hz: float) -> "Texture":
        """The same texture for another sample rate, the power in the kept band the same.

        See `hapscene.surface.resample` for how, and for the error.
        """
        from hapscene.surface.resample import resample

        return resample(self, rate_Hz)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Texture):
            return NotImplemented
        names = ("force_N", "speed_m_s", "triangles", "lsf_rad", "variance_m2_s4", "excitation")
        same = (self.rate_Hz, self.interpolation) == (other.rate_Hz, other.interpolation)
        return same and all(np.array_equal(getattr(self, n), getattr(other, n)) for n in names)

    def __hash__(self) -> int:
        return hash((self.rate_Hz, self.interpolation, self.lsf_rad.tobytes()))


def _put(texture: Texture, name: str, array: NDArray[np.generic]) -> None:
    """Sets a field of the frozen texture, read-only."""
    array.setflags(write=False)
    object.__setattr__(texture, name, array)


def _check_shapes(texture: Texture) -> None:
    """Everything that can be told without arithmetic on the filters."""
    count = len(texture.force_N) if texture.force_N.ndim == 1 else -1
    if not 3 <= count <= MODEL_MAX:
        raise SwatchError(f"texture: force_N must list 3 to {MODEL_MAX} models, its shape is {texture.force_N.shape}")
    for name, shape in (("speed_m_s", (count,)), ("variance_m2_s4", (count,))):
        if getattr(texture, name).shape != shape:
            raise SwatchError(f"texture: {name} must have shape {shape}, has {getattr(texture, name).shape}")
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
    _check_excitation(texture.excitation)


def excitation_moments(knots: Array) -> tuple[float, float]:
    """Mean and variance of the noise that knots (q,) bend a Gaussian deviate to (see `hapscene.surface.lattice`)."""
    z = np.linspace(-2.0 * EXCITATION_SPAN, 2.0 * EXCITATION_SPAN, 16 * (EXCITATION_KNOTS - 1) + 1)
    weight = np.exp(-0.5 * z**2)
    place = (z + EXCITATION_SPAN) * (len(knots) - 1) / (2.0 * EXCITATION_SPAN)
    i = np.clip(place.astype(np.intp), 0, len(knots) - 2)
    x = knots[i] + (place - i) * (knots[i + 1] - knots[i])
    mean = float(np.sum(weight * x) / weight.sum())
    return mean, float(np.sum(weight * (x - mean) ** 2) / weight.sum())


def _check_excitation(knots: Array) -> None:
    """The noise has as many knots as it must, ascending, and is of variance 1: the level is the models' affair."""
    if knots.shape == (0,):
        return
    if knots.shape != (EXCITATION_KNOTS,):
        raise SwatchError(
            f"texture: excitation must list {EXCITATION_KNOTS} numbers or none, its shape is {knots.shape}"
        )
    if not (np.all(np.isfinite(knots)) and np.all(np.diff(knots) >= 0.0) and np.abs(knots).max() < 1e3):
        raise SwatchError("texture: excitation must be finite and ascend")
    mean, variance = excitation_moments(knots)
    if not (abs(mean) < 0.01 and abs(variance - 1.0) < 0.01):
        raise SwatchError(f"texture: excitation must have mean 0 and variance 1, has {mean:.3g} and {variance:.3g}")


def _checked_power(variance_m2_s4: Array, lsf_rad: Array) -> Array:
    """Variance of the output (m,) of models (m, p); refuses what is unstable or absurdly loud."""
    ascending = np.diff(lsf_rad, axis=1, prepend=0.0, append=np.pi) > 0.0  # False for NaN too
    bad = np.flatnonzero(~ascending.all(axis=1))
    if len(bad):
        raise SwatchError(f"texture: model {bad[0]} is unstable: lsf_rad must ascend strictly between 0 and π")
    gain = power_gain(ar_from_lsf(lsf_rad))
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
    """(t, 3, 3): takes (force, speed, 1) to barycentric coordinates in each triangle."""
    corner = np.stack([texture.force_N, texture.speed_m_s, np.ones_like(texture.force_N)], axis=1)
    matrix = corner[texture.triangles].transpose(0, 2, 1)
    scale = max(texture.force_max_N * texture.speed_max_m_s, 1e-300)
    flat = np.flatnonzero(np.abs(np.linalg.det(matrix)) <= 1e-9 * scale)
    if len(flat):
        raise SwatchError(f"texture: triangle {flat[0]} has no area over force and speed")
    return np.asarray(np.linalg.inv(matrix))
