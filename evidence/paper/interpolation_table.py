"""Section 3, Future Work: how to interpolate a texture between the speeds and forces that were recorded.

The paper interpolates the filter coefficients linearly in two dimensions, and names poles and cepstral coefficients as
alternatives. Here they are compared with line spectral frequencies and reflection coefficients on a surface whose
spectrum is known at every force and speed (`evidence.chart.texture.surface_density`), between the conditions of a grid
of models. The recordings at hand hold one condition each, so they cannot judge this.
"""

from collections.abc import Callable
from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from hapscene.dsp.ar_filter import ar_from_lsf, ar_from_reflection, lsf_from_ar, reflection_from_ar
from hapscene.dsp.linear_prediction import solve

from ..chart.measuring import RATE_HZ, apart_jnd, bands_of
from ..chart.texture import FORCE_N, FREQUENCY_HZ, PLACES, SPEED_M_S, surface_density
from .result import Array, FigureResult, Number

ORDER: Final = 20
"""Order of the models [coefficients]."""

GRID: Final = 2
"""Models along each side of the plane of force and speed [count]."""


def cepstrum(a: Array) -> Array:
    """Return the first p cepstral coefficients of 1/A for a filter a (p+1,) with a leading 1."""
    c = np.zeros(len(a))
    for n in range(1, len(a)):
        k = np.arange(1, n)
        c[n] = -a[n] - np.sum(k * c[k] * a[n - k]) / n
    return c[1:]


def ar_from_cepstrum(c: Array) -> Array:
    """Return the filter (p+1,) whose first cepstral coefficients are c (p,)."""
    a = np.concatenate(([1.0], np.zeros(len(c))))
    for n in range(1, len(a)):
        k = np.arange(1, n)
        a[n] = -c[n - 1] - np.sum(k * c[k - 1] * a[n - k]) / n
    return a


def _mix_poles(filters: Array, weights: Array) -> Array:
    """Interpolate the poles of filters (4, p+1), each matched to the nearest pole of the first filter."""
    poles = [np.roots(a) for a in filters]
    matched = [p[linear_sum_assignment(np.abs(poles[0][:, None] - p))[1]] for p in poles]
    return np.asarray(np.poly(weights @ np.array(matched)).real)


def _mix(to: Callable[[Array], Array], back: Callable[[Array], Array]) -> Callable[[Array, Array], Array]:
    """Return a function that interpolates filters in another domain."""
    return lambda filters, weights: back(weights @ np.array([to(a) for a in filters]))


METHODS: Final[dict[str, Callable[[Array, Array], Array]]] = {
    "coefficients (the paper's method)": lambda filters, weights: weights @ filters,
    "poles": _mix_poles,
    "cepstral coefficients": _mix(cepstrum, ar_from_cepstrum),
    "line spectral frequencies": _mix(lsf_from_ar, ar_from_lsf),
    "reflection coefficients": _mix(reflection_from_ar, ar_from_reflection),
}
"""Each returns the filter for filters (4, p+1) of the corners of a cell and bilinear weights (4,)."""


FITTED: Final = "no interpolation, fitted at the condition"
"""Name of the reference: its error is that of the order alone."""


def interpolation_errors(seed: int = 0) -> dict[str, tuple[float, float]]:
    """Return for each method the rms error over the held-out conditions [JND] and the share of unstable filters [%]."""
    force, speed = (np.linspace(*ends, GRID) for ends in (FORCE_N, SPEED_M_S))
    lags = np.array([[np.fft.irfft(surface_density(f, v))[: ORDER + 1] for v in speed] for f in force])
    models = np.array([[solve(r) for r in row] for row in lags])
    errors: dict[str, list[float]] = {name: [] for name in (*METHODS, FITTED)}
    unstable = dict.fromkeys(errors, 0)
    rng = np.random.default_rng(seed)
    for x, y in rng.uniform(0.0, GRID - 1.0, (PLACES, 2)).tolist():
        (i, u), (j, w) = ((int(at), at % 1.0) for at in (x, y))
        corners = models[i : i + 2, j : j + 2].reshape(4, -1)
        weights = np.outer((1.0 - u, u), (1.0 - w, w)).ravel()
        density = surface_density(np.interp(x, range(GRID), force), np.interp(y, range(GRID), speed))
        filters = {name: mix(corners, weights) for name, mix in METHODS.items()}
        filters[FITTED] = solve(np.fft.irfft(density)[: ORDER + 1])
        for name, a in filters.items():
            response = 1.0 / np.abs(np.exp(-2j * np.pi * np.outer(FREQUENCY_HZ / RATE_HZ, np.arange(len(a)))) @ a) ** 2
            response *= np.sum(density) / np.sum(response)  # all methods have the true level: only the shape differs
            errors[name].append(float(apart_jnd(bands_of(FREQUENCY_HZ, response), bands_of(FREQUENCY_HZ, density))))
            unstable[name] += bool(np.abs(np.roots(a)).max() >= 1.0)
    return {n: (float(np.sqrt(np.mean(np.square(e)))), 100.0 * unstable[n] / PLACES) for n, e in errors.items()}


def interpolation() -> FigureResult:
    """Compare the methods on held-out conditions."""
    numbers, errors = list[Number](), interpolation_errors()
    others = [errors[name][0] for name in METHODS if name != "poles"]
    for name, (error_jnd, unstable) in errors.items():
        numbers.append(Number(name, error_jnd, "JND", note=f"{unstable:g} % unstable"))
    text = (
        f"Filters of order {ORDER} at {GRID} × {GRID} conditions ({FORCE_N[0]:g} and {FORCE_N[1]:g} N, "
        f"{SPEED_M_S[0]:g} and {SPEED_M_S[1]:g} m/s) of a simulated surface are interpolated bilinearly at {PLACES} "
        "conditions between them. Three of its five spectral lines rise with the speed; the simulation knows its "
        "spectrum at each condition. Error: rms difference in twelve bands at equal level. The paper states no number. "
        f"Apart from poles, the methods differ by at most {max(others) - min(others):.2g} JND, which is not "
        "perceptible."
    )
    return FigureResult("Section 3, Future Work: interpolation between conditions", text, numbers, [])
