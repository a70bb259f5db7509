"""A handle identified: from responses in several grips to its parameters, and how sure each of them is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import HandleError
from hapscene.handle.handle_loop import ACCELEROMETER_HZ
from hapscene.handle.plant import Array, Complex, Plant
from hapscene.handle.response import BAND_PER_OCTAVE, Response
from hapscene.handle.sensor import DELAY_MAX_S, Sensor

__all__ = ["GRIP_MAX", "HAND", "OWN", "Identification", "IdentifiedGrip", "asymptote", "identify", "sampled_response"]

Interval = tuple[float, float]

OWN: Final = ("m_c_kg", "k_s_N_m", "b_s_Ns_m", "m_h_kg")
"""Parameters of the handle itself, the same in every grip."""

HAND: Final = ("k_u_N_m", "b_u_Ns_m")
"""Parameters of the hand, different in every grip."""


@dataclass(frozen=True)
class IdentifiedGrip:
    """A hand that held the handle while it was identified.

    Attributes:
        name: as "light".
        k_u_N_m, b_u_Ns_m: its stiffness and damping.
        intervals: of them, by name, at 95 %.
        absent: why one of them has no interval, by name.
        coherence: median over the band: share of the acceleration's power that the force explains [1].
        coherence_least: the least over the band [1].
    """

    name: str
    k_u_N_m: float
    b_u_Ns_m: float
    coherence: float
    coherence_least: float
    intervals: Mapping[str, Interval] = field(default_factory=dict)
    absent: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Identification:
    """A handle, as measured.

    Attributes:
        name: of the handle.
        plant: the nominal handle, for a compensator: its k_u and b_u are the geometric means over the grips.
        grips: in the order in which they were played, one or more.
        intervals: of the plant's own parameters and amplifier_Hz, by name, at 95 %.
        absent: why one of them has no interval, by name; the plant then holds an assumption.
        asymptote_kg: the first estimate of m_h, force over acceleration where that is flattest.
        asymptote_Hz: the band where that is.
        delay_s: how much later the acceleration came than the amplifier's and accelerometer's poles say.
        accelerometer_Hz: the accelerometer's pole, which was taken as known.
        rate_Hz: of force and acceleration.
        band_Hz: of the sweep.
        misfit: what the model leaves of the responses, root mean square, over what noise explains [1].
        provenance: where the numbers come from.
    """

    name: str
    plant: Plant
    grips: tuple[IdentifiedGrip, ...]
    intervals: Mapping[str, Interval]
    absent: Mapping[str, str]
    asymptote_kg: float
    asymptote_Hz: Interval
    delay_s: float
    accelerometer_Hz: float
    rate_Hz: float
    band_Hz: Interval
    misfit: float
    provenance: str = ""

    def __repr__(self) -> str:
        return (
            f"<Identification {self.name!r}: coil {1e3 * self.plant.m_c_kg:.3g} g on {self.plant.k_s_N_m:.3g} N/m, "
            f"handle {1e3 * self.plant.m_h_kg:.3g} g; {len(self.grips)} grips, misfit {self.misfit:.3g}>"
        )

    @property
    def sensor(self) -> Sensor:
        """What is heard of it, for a compensator that is told of force n and the acceleration read as force n begins.

        To `delay_s` comes what a force that is held, and an accelerometer whose pole knows no samples, are later than
        in the compensator's reckoning: half a sample, and the rest of the pole's time constant.
        """
        period_s, pole_s = 1.0 / self.rate_Hz, 0.5 / (np.pi * self.accelerometer_Hz)
        late_s = self.delay_s + 0.5 * period_s + pole_s - period_s / np.expm1(period_s / pole_s)
        return Sensor(float(np.clip(late_s, 0.0, DELAY_MAX_S)), self.accelerometer_Hz)

    def plant_in(self, grip: IdentifiedGrip) -> Plant:
        """The plant as it was in that grip."""
        return replace(self.plant, k_u_N_m=grip.k_u_N_m, b_u_Ns_m=grip.b_u_Ns_m)


# The mass of the handle at first sight, from where acceleration over force is flat.


def asymptote(responses: Sequence[Response]) -> tuple[float, Interval]:
    """First estimate of m_h [kg]: |F/A| in the octave in which it is flattest over all grips; and that octave [Hz].

    At high frequency |A/F| → 1/m_h. Below, spring and hand bend it, above, amplifier and accelerometer; the flattest
    octave lies between. What bend is left there, about 1 %, the fit of the whole model takes out.
    """
    best: tuple[float, float, Interval] | None = None
    lowest = max(response.frequency_Hz[0] for response in responses)
    highest = min(response.frequency_Hz[-1] for response in responses)
    whole = highest > 1.9 * lowest  # mean frequencies of bands lie inside the octave that was played
    for low in np.geomspace(lowest, max(highest / 2.0, lowest), 50) if whole else ():
        within = [(r.frequency_Hz >= low) & (r.frequency_Hz <= 2.0 * low) for r in responses]
        level = np.log(np.abs(np.concatenate([r.response[part] for r, part in zip(responses, within, strict=True)])))
        if len(level) >= 3 and (best is None or level.std() < best[0]):
            best = float(level.std()), float(np.exp(-level.mean())), (float(low), float(2.0 * low))
    if best is None:
        raise HandleError("the responses share no octave in which the mass of the handle could be seen")
    return best[1], best[2]


# What stands between force command and acceleration sample, and is not the handle: amplifier, accelerometer, delay.


def sampled_response(
    plant: Plant, frequency_Hz: ArrayLike, rate_Hz: float, amplifier_s: float, accelerometer_s: float, delay_s: float
) -> Complex:
    """Acceleration samples over force commands, at frequencies of any shape [1/kg].

    A command is held over its sample (zero-order hold). Amplifier and accelerometer are one pole each, with the time
    constants given, 0 for none; what the accelerometer gives is sampled as the next command begins, and comes
    `delay_s` later than that.

    A held command has images around the multiples of the rate; sampling folds them back. At high frequency the plant is
    1/m_h, and passes them. So that path is taken as the sampled system that it is: with z = exp(jωT),
    G = 1 − [τ (z−1)/(z−e^(−T/τ)) − σ (z−1)/(z−e^(−T/σ))]/(τ−σ), the zero-order hold of 1/((1+τs)(1+σs)) by partial
    fractions. The rest of the plant, H − 1/m_h, falls with frequency; it is taken as continuous, times the hold's
    e^(−jωT/2) sinc. Its images, left out so, are 3e-5 of the response at 10 kHz, 4e-4 at 5 kHz, 2e-3 at 3 kHz.
    """
    frequency = np.asarray(frequency_Hz, dtype=np.float64)
    s, period_s = 2j * np.pi * frequency, 1.0 / rate_Hz
    z = np.exp(s * period_s)
    tau, sigma = amplifier_s, accelerometer_s
    if abs(tau - sigma) < 1e-4 * (tau + sigma):
        tau, sigma = 0.9995 * tau, 1.0005 * sigma  # the limit of two equal poles, to 1e-6
    direct = 1.0 - (_remainder(tau, z, period_s) - _remainder(sigma, z, period_s)) / (tau - sigma or 1.0)
    hold = np.sinc(frequency * period_s) * np.exp(-0.5 * s * period_s)
    rest = (plant.response(frequency) - 1.0 / plant.m_h_kg) * hold / ((1.0 + tau * s) * (1.0 + sigma * s))
    return np.asarray((rest + direct / plant.m_h_kg) * np.exp(-s * delay_s))


def _remainder(tau: float, z: Complex, period_s: float) -> Complex:
    """τ (z−1)/(z−e^(−T/τ)), the part of a step that is still to come; 0 without a pole."""
    pole = np.exp(-period_s / tau) if tau > 0.0 else 0.0
    return np.asarray(tau * (z - 1.0) / (z - pole))


# From frequency responses in several grips to the handle's parameters: m_h first, then the rest, with intervals.
#
# One grip does not do: eq. 8 over m_c is s⁴ over a polynomial of five coefficients, and they hang on six parameters.
# Each further grip brings two parameters, k_u and b_u, and four new coefficients. So grips that differ are what tells
# the coil's mass from its spring; how well is seen in the intervals, and where the answer is no, it is said.


GRIP_MAX: Final = 20
"""Most grips of an identification [count]."""

PRIOR: Final = 2.0
"""Standard deviation of each parameter's logarithm about the guess, before anything is measured [1]: a factor of seven
either way. Keeps the search finite where the grips do not differ; moves what is known to 1 % by 1/40,000 of its way."""

KNOWN: Final = 0.25
"""Largest standard deviation of a logarithm at which a parameter counts as known [1]: its interval spans 1 to 2.7."""

SMOOTH: Final = 9
"""Bands over which the noise is averaged to weigh them [count]: each alone has few degrees of freedom, and what happens
to look quiet would be weighed too much."""

NORMAL_95: Final = 1.959964
"""Reach of a 95 % interval, in standard deviations [1]."""

COARSE: Final = 0.1
"""Relative error at which every band is weighed first [1]."""

ENOUGH: Final = 1.5
"""Misfit at which no further start is tried [1]: the model then explains what noise does not."""

EVALUATION_MAX: Final = 60
"""Most evaluations of a search [count]. Those that arrive take 10 to 30; a valley that takes more is not the one."""

_FAR: Final = 20.0
"""Furthest logarithm that is looked at: 5e8 and 2e-9, inside what a `Plant` takes."""

_FADED: Final = 1e-3
"""What the prior counts in the intervals [1]: just enough that a parameter of which nothing is known has one."""

_DELAY_S: Final = 1e-4
"""Unit of the time constants in the search [s]."""

_STEP: Final = 1e-6
"""Step of the differences in the search [1], of logarithms and of time constants in their unit."""


def identify(
    responses: Sequence[Response],
    rate_Hz: float,
    names: Sequence[str],
    *,
    guess: Plant | None = None,
    accelerometer_Hz: float = ACCELEROMETER_HZ,
    name: str = "handle",
    provenance: str = "",
) -> Identification:
    """Fit eq. 8, with what stands before and after it, to the responses of several grips.

    m_c, k_s, b_s, m_h, the amplifier's pole and a delay are common to all; k_u and b_u are each grip's own. The sum of
    |h − model|²/s² over all bands is made least (Levenberg–Marquardt, MINPACK), s from the coherence. Intervals are at
    95 %, from the Jacobian there, wider by the misfit where the model leaves more than noise explains, and wide
    enough where what it leaves hangs together over an octave. In simulation 97 % of them hold; where the grip wanders
    by 5 % during the sweep, 83 %.

    Args:
        responses: of each grip; two or more that differ tell all parameters.
        rate_Hz: of the samples that they were estimated from.
        names: of the grips.
        guess: where the search begins, and whose limits are kept; `Plant()` unless given.
        accelerometer_Hz: the accelerometer's pole, from its data sheet. It is taken as known, for an accelerometer that
            is slower than believed and a handle that is heavier look alike.
        name: of the handle.
        provenance: where the responses come from.

    Raises:
        HandleError: no grip, more than `GRIP_MAX`, or responses that no handle of this kind has.
    """
    if not 1 <= len(responses) <= GRIP_MAX or len(names) != len(responses):
        raise HandleError(f"1 to {GRIP_MAX} grips, each with a name, can be identified together; got {len(responses)}")
    fit = _Fit(responses, rate_Hz, Plant() if guess is None else guess, accelerometer_Hz)
    x, deviation, misfit = fit.solve()
    x[4] = abs(x[4])
    mass_kg, octave_Hz = fit.asymptote
    reason = "the grips differ too little, or noise covers what tells it from the others"
    if len(responses) == 1:
        reason = "one grip cannot tell it from the others: play two or more that differ"
    intervals, absent = _judged(OWN, x[:4], deviation[:4], reason)
    amplifier_Hz = _amplifier(x[4], deviation[4], fit.guess.amplifier_Hz, intervals, absent)
    grips = []
    for i, (response, label) in enumerate(zip(responses, names, strict=True)):
        own = slice(6 + 2 * i, 8 + 2 * i)
        coherence = float(np.median(response.coherence)), float(response.coherence.min())
        k_u_N_m, b_u_Ns_m = np.exp(x[own]).tolist()
        known = _judged(HAND, x[own], deviation[own], reason)
        grips.append(IdentifiedGrip(label, k_u_N_m, b_u_Ns_m, *coherence, *known))
    hand = np.exp(x[6:].reshape(-1, 2).mean(axis=0))
    return Identification(
        name=name,
        plant=replace(fit.plant(x, hand), amplifier_Hz=amplifier_Hz),
        grips=tuple(grips),
        intervals=intervals,
        absent=absent,
        asymptote_kg=mass_kg,
        asymptote_Hz=octave_Hz,
        delay_s=float(x[5] * _DELAY_S - 0.5 / (np.pi * amplifier_Hz)),
        accelerometer_Hz=accelerometer_Hz,
        rate_Hz=rate_Hz,
        band_Hz=(float(responses[0].frequency_Hz[0]), float(responses[0].frequency_Hz[-1])),
        misfit=misfit,
        provenance=provenance,
    )


class _Fit:
    """The least squares. x holds ln m_c, ln k_s, ln b_s, ln m_h, the amplifier's time constant τ, delay + τ, and of
    each grip ln k_u, ln b_u. A slower amplifier and a longer delay look alike at first order: their sum does not."""

    def __init__(self, responses: Sequence[Response], rate_Hz: float, guess: Plant, accelerometer_Hz: float) -> None:
        self.responses, self.rate_Hz, self.guess = responses, rate_Hz, guess
        self.accelerometer_s = 1.0 / (2.0 * np.pi * accelerometer_Hz)
        self.asymptote = asymptote(responses)
        self.weight = [1.0 / _smoothed(response) for response in responses]

    def plant(self, x: Array, hand: Array) -> Plant:
        """The plant of common parameters x and a hand (k_u, b_u)."""
        own = dict(zip(OWN, np.exp(np.clip(x[:4], -_FAR, _FAR)), strict=True))
        return replace(self.guess, **own, **dict(zip(HAND, hand, strict=True)))

    def model(self, x: Array, grip: int) -> NDArray[np.complex128]:
        """The response (k,) of a grip, averaged over each band."""
        response = self.responses[grip]
        plant = self.plant(x, np.exp(np.clip(x[6 + 2 * grip : 8 + 2 * grip], -_FAR, _FAR)))
        at_Hz = response.frequency_Hz + np.array([[-1.0], [1.0]]) * response.spread_Hz
        tau = min(abs(x[4]), 1e3) * _DELAY_S  # the search knows no bounds
        delay_s = x[5] * _DELAY_S - tau
        both = sampled_response(plant, at_Hz, self.rate_Hz, tau, self.accelerometer_s, delay_s)
        return np.asarray(both.mean(axis=0))

    def residual(self, x: Array) -> Array:
        """What the model leaves, over its standard deviation, real and imaginary parts; then the prior."""
        each = zip(self.responses, self.weight, strict=True)
        left = np.concatenate([(response.response - self.model(x, i)) * w for i, (response, w) in enumerate(each)])
        return np.concatenate([left.real, left.imag, (self._logs(x) - self._logs(self.start)) / PRIOR])

    def slope(self, x: Array) -> Array:
        """Jacobian of the residual, by differences; a grip's hand moves only its own response."""
        count = sum(len(response.frequency_Hz) for response in self.responses)
        slope = np.zeros((2 * count + len(x) - 2, len(x)))
        row = 0
        for i, weight in enumerate(self.weight):
            here, rows = self.model(x, i), slice(row, row + len(weight))
            for column in (*range(6), 6 + 2 * i, 7 + 2 * i):
                moved = x.copy()
                moved[column] += _STEP
                left = (here - self.model(moved, i)) / _STEP * weight
                slope[rows, column] = left.real
                slope[count + rows.start : count + rows.stop, column] = left.imag
            row += len(weight)
        slope[2 * count + np.arange(len(x) - 2), np.delete(np.arange(len(x)), (4, 5))] = 1.0 / PRIOR
        return slope

    def solve(self) -> tuple[Array, Array, float]:
        """Best x, the standard deviation of each, and the misfit [1].

        From each start the responses are first met coarsely, each band weighed as if it were known to `COARSE`, so that
        quiet bands do not hold the search in a wrong valley; then by the noise.
        """
        from scipy.optimize import least_squares

        count = 2 * sum(len(response.frequency_Hz) for response in self.responses)
        if count <= 2 * (3 + len(self.responses)):
            raise HandleError(f"{count // 2} bands are too few to identify a handle from")
        fine, sizes = self.weight, [COARSE * np.abs(response.response) for response in self.responses]
        coarse = [1.0 / np.hypot(1.0 / weight, size) for weight, size in zip(fine, sizes, strict=True)]
        best: Any = None
        for start in self._starts(coarse):
            x = self.start = start
            for self.weight in (coarse, fine):
                found = least_squares(self.residual, x, self.slope, method="lm", x_scale="jac", max_nfev=EVALUATION_MAX)
                x = found.x
            best = found if best is None or found.cost < best.cost else best
            squares = float(np.sum(best.fun[:count] ** 2)) / (count - len(best.x))
            if squares <= ENOUGH**2:
                break
        slope = self.slope(best.x)
        slope[count:] *= _FADED  # the prior helps to search, and says nothing about what was measured
        inverse = np.linalg.inv(slope.T @ slope)
        spread = np.maximum(np.diag(inverse) * max(1.0, squares), np.diag(inverse @ self._scatter(best.x) @ inverse))
        return best.x, np.sqrt(spread), float(np.sqrt(squares))

    def _scatter(self, x: Array) -> Array:
        """Σ g gᵀ over each grip's octaves, g = Jᵀr of one: the gradient's covariance, neighbouring bands dependent.

        A grip that changes during a sweep leaves the same error in many bands (Liang & Zeger 1986, "Longitudinal data
        analysis using generalized linear models", Biometrika 73, with the usual factor for few groups).
        """
        slope, left, bands = self.slope(x), self.residual(x), sum(len(r.frequency_Hz) for r in self.responses)
        ends = np.cumsum([len(response.frequency_Hz) for response in self.responses])
        starts = np.concatenate([np.arange(a, b, BAND_PER_OCTAVE) for a, b in zip((0, *ends), ends, strict=False)])
        terms = slope[: 2 * bands] * left[: 2 * bands, None]
        sums = np.add.reduceat(terms[:bands] + terms[bands:], starts, axis=0)
        return np.asarray(sums.T @ sums * len(starts) / max(1, len(starts) - len(x)))

    def _starts(self, weight: list[Array]) -> list[Array]:
        """Where to search from, the likeliest first.

        The guess is made heavier or lighter until its m_h is the asymptote's. Its coil's spring is tried softer and
        stiffer, and each grip is the one of a few that fits best.
        """
        guess, scale = self.guess, self.asymptote[0] / self.guess.m_h_kg
        own = np.log([max(getattr(guess, name) * scale, 1e-9) for name in OWN])
        hand = np.log(np.maximum([guess.k_u_N_m * scale, guess.b_u_Ns_m * scale], 1e-9))
        tau = 1.0 / (2.0 * np.pi * guess.amplifier_Hz) / _DELAY_S
        starts = []
        for stiffer in (0.25, 0.5, 1.0, 2.0, 4.0):
            x = np.concatenate([own, [tau, tau], np.tile(hand, len(self.responses))])
            x[1] += np.log(stiffer)
            cost = 0.0
            for i, response in enumerate(self.responses):
                tried = []
                for firmer in np.log((0.1, 0.3, 1.0, 3.0, 10.0)):
                    x[6 + 2 * i] = hand[0] + firmer
                    away = np.abs(response.response - self.model(x, i)) * weight[i]
                    tried.append((float(np.sum(away**2)), firmer))
                least, firmer = min(tried)
                x[6 + 2 * i] = hand[0] + firmer
                cost += least
            starts.append((cost, x))
        return [x for _, x in sorted(starts, key=lambda start: start[0])]

    @staticmethod
    def _logs(x: Array) -> Array:
        return np.delete(x, (4, 5))


def _smoothed(response: Response) -> Array:
    """Standard deviation (k,) of real and imaginary part, the noise in it averaged over neighbouring bands."""
    reach = min(SMOOTH, len(response.deviation))
    noise = response.deviation**2 * response.force_power * response.freedom
    total, freedom = (np.convolve(values, np.ones(reach), "same") for values in (noise, response.freedom))
    return np.asarray(np.sqrt(total / freedom / response.force_power))


def _judged(
    names: Sequence[str], logs: Array, deviation: Array, reason: str
) -> tuple[dict[str, Interval], dict[str, str]]:
    """Intervals of parameters that are known, and why the others are not."""
    known = dict(zip(names, deviation <= KNOWN, strict=True))
    reach = NORMAL_95 * np.minimum(deviation, KNOWN)
    edges = np.exp([logs - reach, logs + reach]).T.tolist()
    intervals = {name: (low, high) for name, (low, high) in zip(names, edges, strict=True) if known[name]}
    return intervals, {name: reason for name in names if not known[name]}


def _amplifier(
    tau: float, deviation: float, guess_Hz: float, intervals: dict[str, Interval], absent: dict[str, str]
) -> float:
    """The amplifier's bandwidth [Hz], its interval or the reason for none."""
    low, high = ((tau + sign * NORMAL_95 * deviation) * _DELAY_S for sign in (-1.0, 1.0))
    if low > 0.0:
        intervals["amplifier_Hz"] = (float(0.5 / (np.pi * high)), float(0.5 / (np.pi * low)))
        return float(0.5 / (np.pi * tau * _DELAY_S))
    absent["amplifier_Hz"] = f"too fast to be seen: above {0.5 / (np.pi * high):.3g} Hz, {guess_Hz:g} Hz is assumed"
    return guess_Hz
