"""Identify a handle: fit its parameters, with confidence intervals, to frequency responses in several grips."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Final

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

from hapscene.errors import HandleError
from hapscene.handle.measure import BAND_PER_OCTAVE, Response
from hapscene.handle.plant import ACCELEROMETER_HZ, DELAY_MAX_S, NUMBER_MAX, Array, Complex, Plant, Sensor

__all__ = [
    "GRIP_MAX",
    "HANDLE_PARAMETERS",
    "HAND_PARAMETERS",
    "Identification",
    "IdentifiedGrip",
    "asymptote",
    "identify",
    "sampled_response",
]

GRIP_MAX: Final = 20
"""Most grips of an identification [count]."""

# the types of a handle file, with the limits that `handle_file` checks
_Text = Annotated[str, Meta(max_length=10_000)]
_Number = Annotated[float, Meta(ge=-NUMBER_MAX, le=NUMBER_MAX)]
_Positive = Annotated[float, Meta(gt=0.0, le=NUMBER_MAX)]
_NotNegative = Annotated[float, Meta(ge=0.0, le=NUMBER_MAX)]
Interval = tuple[_Number, _Number]

HANDLE_PARAMETERS: Final = ("m_c_kg", "k_s_N_m", "b_s_Ns_m", "m_h_kg")
"""Parameters of the handle, the same in every grip."""

HAND_PARAMETERS: Final = ("k_u_N_m", "b_u_Ns_m")
"""Parameters of the hand, which differ from grip to grip."""


@dataclass(frozen=True)
class IdentifiedGrip:
    """The hand in one grip of an identification.

    Attributes:
        name: name of the grip, such as "light".
        k_u_N_m, b_u_Ns_m: stiffness and damping of the hand.
        intervals: 95 % confidence intervals, by parameter.
        absent: reason why a parameter has no interval, by parameter.
        coherence: median over the band of the share of the acceleration's power that the force explains [1].
        coherence_least: lowest coherence in the band [1].
    """

    name: _Text
    k_u_N_m: _NotNegative
    b_u_Ns_m: _NotNegative
    coherence: _NotNegative
    coherence_least: _NotNegative
    intervals: Mapping[str, Interval] = field(default_factory=dict)
    absent: Mapping[str, _Text] = field(default_factory=dict)


@dataclass(frozen=True)
class Identification:
    """The result of an identification.

    Attributes:
        name: name of the handle.
        plant: nominal handle for a compensator; its k_u and b_u are the geometric means over the grips.
        grips: the grips, one or more, in the order of the recordings.
        intervals: 95 % confidence intervals of the plant's parameters and of amplifier_Hz, by parameter.
        absent: reason why a parameter has no interval, by parameter. Its value in `plant` is then an assumption.
        asymptote_kg: first estimate of m_h: force over acceleration where the ratio is flattest.
        asymptote_Hz: band of this estimate.
        delay_s: delay of the acceleration in addition to the poles of amplifier and accelerometer.
        accelerometer_Hz: pole of the accelerometer, assumed from its data sheet.
        rate_Hz: sample rate of force and acceleration.
        band_Hz: band of the sweep.
        misfit: residual of the responses, root mean square, relative to the measurement noise [1].
        provenance: origin of the recordings.
    """

    name: _Text
    plant: Plant
    grips: Annotated[tuple[IdentifiedGrip, ...], Meta(min_length=1, max_length=GRIP_MAX)]
    intervals: Mapping[str, Interval]
    absent: Mapping[str, _Text]
    asymptote_kg: _Positive
    asymptote_Hz: Interval
    delay_s: _Number
    accelerometer_Hz: _Positive
    rate_Hz: _Positive
    band_Hz: Interval
    misfit: _Number
    provenance: _Text = ""

    def __repr__(self) -> str:
        return (
            f"<Identification {self.name!r}: coil {1e3 * self.plant.m_c_kg:.3g} g on {self.plant.k_s_N_m:.3g} N/m, "
            f"handle {1e3 * self.plant.m_h_kg:.3g} g; {len(self.grips)} grips, misfit {self.misfit:.3g}>"
        )

    @property
    def sensor(self) -> Sensor:
        """Sensor for a compensator that receives force n together with the acceleration at the start of force n.

        Its delay is `delay_s` plus two delays that the discrete model of the compensator omits: half a sample of the
        zero-order hold of the force, and the difference between the time constants of the pole and its discrete form.
        """
        period_s, pole_s = 1.0 / self.rate_Hz, 0.5 / (np.pi * self.accelerometer_Hz)
        delay_s = self.delay_s + 0.5 * period_s + pole_s - period_s / np.expm1(period_s / pole_s)
        return Sensor(float(np.clip(delay_s, 0.0, DELAY_MAX_S)), self.accelerometer_Hz)

    def plant_in(self, grip: IdentifiedGrip) -> Plant:
        """The plant in the given grip."""
        return replace(self.plant, k_u_N_m=grip.k_u_N_m, b_u_Ns_m=grip.b_u_Ns_m)


def asymptote(responses: Sequence[Response]) -> tuple[float, Interval]:
    """First estimate of m_h [kg]: |F/A| in the octave where it is flattest over all grips. Also returns the octave
    [Hz].

    |A/F| approaches 1/m_h at high frequency. Spring and hand bend it at low frequencies, amplifier and accelerometer at
    high ones; the flattest octave lies between. The fit of the whole model removes the remaining bend of about 1 %.
    """
    best: tuple[float, float, Interval] | None = None
    lowest = max(response.frequency_Hz[0] for response in responses)
    highest = min(response.frequency_Hz[-1] for response in responses)
    whole = highest > 1.9 * lowest  # mean frequencies of bands lie within the octave that was played
    for low in np.geomspace(lowest, max(highest / 2.0, lowest), 50) if whole else ():
        within = [(r.frequency_Hz >= low) & (r.frequency_Hz <= 2.0 * low) for r in responses]
        level = np.log(np.abs(np.concatenate([r.response[part] for r, part in zip(responses, within, strict=True)])))
        if len(level) >= 3 and (best is None or level.std() < best[0]):
            best = float(level.std()), float(np.exp(-level.mean())), (float(low), float(2.0 * low))
    if best is None:
        raise HandleError(
            f"the responses share less than an octave, {lowest:.3g} to {highest:.3g} Hz, which does not determine the "
            "mass of the handle: record a wider sweep"
        )
    return best[1], best[2]


# The signal path from force command to acceleration sample: amplifier, plant, accelerometer, delay.


def sampled_response(
    plant: Plant, frequency_Hz: ArrayLike, rate_Hz: float, amplifier_s: float, accelerometer_s: float, delay_s: float
) -> Complex:
    """Response of acceleration samples to force commands [1/kg].

    A command is held over its sample (zero-order hold). Amplifier and accelerometer are one pole each. The
    accelerometer is sampled at the start of the next command, and its samples are delayed by `delay_s`.

    Args:
        plant: the handle in a hand.
        frequency_Hz: frequencies of any shape [Hz].
        rate_Hz: sample rate [Hz].
        amplifier_s, accelerometer_s: time constants of the poles [s]; 0 for no pole.
        delay_s: additional delay [s].

    A held command has images around the multiples of the sample rate, and sampling folds them back. At high frequency
    the plant passes them as 1/m_h. Therefore that path is computed as a sampled system: with z = exp(jωT),
    G = 1 − [τ (z−1)/(z−e^(−T/τ)) − σ (z−1)/(z−e^(−T/σ))]/(τ−σ), the zero-order hold of 1/((1+τs)(1+σs)) by partial
    fractions. The rest of the plant, H − 1/m_h, falls with frequency; it is computed as continuous, times
    e^(−jωT/2) sinc of the hold. Its images, which this neglects, are 3e-5 of the response at 10 kHz, 4e-4 at 5 kHz and
    2e-3 at 3 kHz.
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
    """τ (z−1)/(z−e^(−T/τ)), the part of a step response after the present sample; 0 without a pole."""
    pole = np.exp(-period_s / tau) if tau > 0.0 else 0.0
    return np.asarray(tau * (z - 1.0) / (z - pole))


# The fit of the parameters: first m_h, then all of them, with intervals.
#
# One grip is not sufficient: eq. 8 over m_c is s⁴ over a polynomial with five coefficients, which depend on six
# parameters. Each further grip adds two parameters, k_u and b_u, and four coefficients. So different grips are needed
# to separate the mass of the coil from its spring. The intervals show how well the grips determine the parameters; the
# result lists parameters that they do not determine.


PRIOR: Final = 2.0
"""Prior standard deviation of the logarithm of each parameter about the guess [1]: a factor of seven in both
directions. It keeps the search finite where grips are too similar. A parameter known to 1 % is moved by 1/40,000 of the
distance."""

KNOWN: Final = 0.25
"""Largest standard deviation of a logarithm at which a parameter counts as determined [1]: an interval of 1 to 2.7."""

SMOOTH: Final = 9
"""Number of bands over which the noise is averaged for the weights. One band has few degrees of freedom; one that seems
free of noise by chance would get too much weight."""

NORMAL_95: Final = 1.959964
"""Half width of a 95 % interval, in standard deviations [1]."""

COARSE: Final = 0.1
"""Relative error that each band is assumed to have in the first stage of the search [1]."""

ENOUGH: Final = 1.5
"""Misfit at which the search stops [1]: the model explains all but the noise."""

EVALUATION_MAX: Final = 60
"""Most evaluations of a search for each unknown [count]. Searches that converge take 10 to 30."""

_FAR: Final = 20.0
"""Largest absolute logarithm in the search: 5e8 and 2e-9, within the limits of a `Plant`."""

_FADED: Final = 1e-3
"""Weight of the prior in the intervals [1]: just enough that an undetermined parameter has one."""

_DELAY_S: Final = 1e-4
"""Unit of the time constants in the search [s]."""


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
    """Fit eq. 8, with amplifier, accelerometer and delay, to the responses of several grips.

    All grips share m_c, k_s, b_s, m_h, the pole of the amplifier and a delay; k_u and b_u differ from grip to grip. The
    fit minimises the sum of |h − model|²/s² over all bands (Levenberg–Marquardt, MINPACK), with s from the coherence.
    The 95 % intervals follow from the Jacobian. They are widened by the misfit where the residual exceeds the noise,
    and account for residuals that are correlated over an octave. In simulation 97 % of the intervals contain the true
    value; 83 % if the grip varies by 5 % during the sweep.

    Args:
        responses: one response a grip. Two or more different grips determine all parameters.
        rate_Hz: sample rate of the recordings [Hz].
        names: names of the grips.
        guess: start of the search, and the limits of force and travel of the result; `Plant()` by default.
        accelerometer_Hz: pole of the accelerometer, from its data sheet [Hz]. It cannot be fitted, since a slower
            accelerometer has the same effect as a heavier handle.
        name: name of the handle.
        provenance: origin of the recordings.

    Raises:
        HandleError: no grip, more than `GRIP_MAX` grips, or responses that do not determine a handle.
    """
    if not 1 <= len(responses) <= GRIP_MAX or len(names) != len(responses):
        raise HandleError(f"identification needs 1 to {GRIP_MAX} grips with a name each, got {len(responses)}")
    fit = _Fit(responses, rate_Hz, Plant() if guess is None else guess, accelerometer_Hz)
    x, deviation, misfit = fit.solve()
    x[4] = abs(x[4])
    mass_kg, octave_Hz = fit.asymptote
    reason = "the grips are too similar, or there is too much noise, to separate it from the other parameters"
    if len(responses) == 1:
        reason = "one grip does not determine it: record two or more different grips"
    intervals, absent = _intervals(HANDLE_PARAMETERS, x[:4], deviation[:4], reason)
    amplifier_Hz = _amplifier(x[4], deviation[4], fit.guess.amplifier_Hz, intervals, absent)
    each = zip(names, responses, x[6:].reshape(-1, 2), deviation[6:].reshape(-1, 2), strict=True)
    grips = [_grip(*known, reason) for known in each]
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


def _grip(name: str, response: Response, logs: Array, deviation: Array, reason: str) -> IdentifiedGrip:
    """The hand of one grip, from the logarithms of its parameters."""
    coherence = float(np.median(response.coherence)), float(response.coherence.min())
    k_u_N_m, b_u_Ns_m = np.exp(logs).tolist()
    return IdentifiedGrip(name, k_u_N_m, b_u_Ns_m, *coherence, *_intervals(HAND_PARAMETERS, logs, deviation, reason))


class _Fit:
    """The least-squares problem.

    x contains ln m_c, ln k_s, ln b_s, ln m_h, the time constant τ of the amplifier, delay + τ, and for each grip ln k_u
    and ln b_u. To first order, a slower amplifier has the same effect as a longer delay; their sum is well determined.
    """

    def __init__(self, responses: Sequence[Response], rate_Hz: float, guess: Plant, accelerometer_Hz: float) -> None:
        self.responses, self.rate_Hz, self.guess = responses, rate_Hz, guess
        self.accelerometer_s = 1.0 / (2.0 * np.pi * accelerometer_Hz)
        self.asymptote = asymptote(responses)
        self.weight = [1.0 / _smoothed(response) for response in responses]

    def plant(self, x: Array, hand: Array) -> Plant:
        """The plant with the parameters x and a hand (k_u, b_u)."""
        own = dict(zip(HANDLE_PARAMETERS, np.exp(np.clip(x[:4], -_FAR, _FAR)), strict=True))
        return replace(self.guess, **own, **dict(zip(HAND_PARAMETERS, hand, strict=True)))

    def model(self, x: Array, grip: int) -> NDArray[np.complex128]:
        """The response (k,) of a grip, averaged over each band."""
        response = self.responses[grip]
        plant = self.plant(x, np.exp(np.clip(x[6 + 2 * grip : 8 + 2 * grip], -_FAR, _FAR)))
        at_Hz = response.frequency_Hz + np.array([[-1.0], [1.0]]) * response.spread_Hz
        tau = min(abs(x[4]), 1e3) * _DELAY_S  # the search has no bounds
        delay_s = x[5] * _DELAY_S - tau
        both = sampled_response(plant, at_Hz, self.rate_Hz, tau, self.accelerometer_s, delay_s)
        return np.asarray(both.mean(axis=0))

    def residual(self, x: Array) -> Array:
        """Return the weighted residuals: real parts, then imaginary parts of the responses, then the prior."""
        each = zip(self.responses, self.weight, strict=True)
        left = np.concatenate([(response.response - self.model(x, i)) * w for i, (response, w) in enumerate(each)])
        return np.concatenate([left.real, left.imag, (self._logs(x) - self._logs(self.start)) / PRIOR])

    def solve(self) -> tuple[Array, Array, float]:
        """Minimise. Returns the best x, the standard deviation of each element, and the misfit [1].

        Each start has two stages. The first weights all bands as if known to `COARSE`, so that bands with little noise
        do not keep the search in a local minimum. The second uses the measured noise.
        """
        from scipy.optimize import least_squares

        count = 2 * sum(len(response.frequency_Hz) for response in self.responses)
        if count <= 2 * (3 + len(self.responses)):
            raise HandleError(
                f"{count // 2} frequency bands are too few for an identification: record a wider or longer sweep"
            )
        fine, sizes = self.weight, [COARSE * np.abs(response.response) for response in self.responses]
        coarse = [1.0 / np.hypot(1.0 / weight, size) for weight, size in zip(fine, sizes, strict=True)]
        best: Any = None
        for start in self._starts(coarse):
            x = self.start = start
            for self.weight in (coarse, fine):
                most = EVALUATION_MAX * (len(x) + 1)
                found = least_squares(self.residual, x, method="lm", x_scale="jac", max_nfev=most)
                x = found.x
            best = found if best is None or found.cost < best.cost else best
            squares = float(np.sum(best.fun[:count] ** 2)) / (count - len(best.x))
            if squares <= ENOUGH**2:
                break
        terms = best.jac[:count] * best.fun[:count, None]
        slope = best.jac.copy()
        slope[count:] *= _FADED  # the prior serves the search and is no measurement
        inverse = np.linalg.inv(slope.T @ slope)
        spread = np.maximum(np.diag(inverse) * max(1.0, squares), np.diag(inverse @ self._scatter(terms) @ inverse))
        return best.x, np.sqrt(spread), float(np.sqrt(squares))

    def _scatter(self, terms: Array) -> Array:
        """Covariance of the gradient, Σ g gᵀ over the octaves of each grip with g = Jᵀr of one octave, from the
        products of each row of J with its residual.

        It allows for dependent neighbouring bands: a grip that changes during a sweep causes similar errors in many
        bands (Liang & Zeger 1986, "Longitudinal data analysis using generalized linear models", Biometrika 73, with the
        usual factor for few groups).
        """
        bands = len(terms) // 2
        ends = np.cumsum([len(response.frequency_Hz) for response in self.responses])
        starts = np.concatenate([np.arange(a, b, BAND_PER_OCTAVE) for a, b in zip((0, *ends), ends, strict=False)])
        sums = np.add.reduceat(terms[:bands] + terms[bands:], starts, axis=0)
        return np.asarray(sums.T @ sums * len(starts) / max(1, len(starts) - terms.shape[1]))

    def _starts(self, weight: list[Array]) -> list[Array]:
        """Start values of the search, the most likely first.

        The guess is scaled to the m_h of the asymptote. Its spring is tried with several stiffnesses, and each grip
        starts with that one of a few stiffnesses which fits best.
        """
        guess, usual, scale = self.guess, Plant(), self.asymptote[0] / self.guess.m_h_kg
        own = np.log([scale * (getattr(guess, name) or getattr(usual, name)) for name in HANDLE_PARAMETERS])
        hand = np.log([scale * (getattr(guess, name) or getattr(usual, name)) for name in HAND_PARAMETERS])
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
    """Standard deviation (k,) of real and imaginary part, with the noise averaged over neighbouring bands."""
    reach = min(SMOOTH, len(response.deviation))
    noise = response.deviation**2 * response.force_power * response.freedom
    total, freedom = (np.convolve(values, np.ones(reach), "same") for values in (noise, response.freedom))
    return np.asarray(np.sqrt(total / freedom / response.force_power))


def _intervals(
    names: Sequence[str], logs: Array, deviation: Array, reason: str
) -> tuple[dict[str, Interval], dict[str, str]]:
    """Intervals of the parameters that are determined, and the reason for each that is not."""
    known = dict(zip(names, deviation <= KNOWN, strict=True))
    reach = NORMAL_95 * np.minimum(deviation, KNOWN)
    edges = np.exp([logs - reach, logs + reach]).T.tolist()
    intervals = {name: (low, high) for name, (low, high) in zip(names, edges, strict=True) if known[name]}
    return intervals, {name: reason for name in names if not known[name]}


def _amplifier(
    tau: float, deviation: float, guess_Hz: float, intervals: dict[str, Interval], absent: dict[str, str]
) -> float:
    """Bandwidth of the amplifier [Hz]. Adds its interval to `intervals`, or the reason for its lack to `absent`."""
    low, high = ((tau + sign * NORMAL_95 * deviation) * _DELAY_S for sign in (-1.0, 1.0))
    if low > 0.0:
        intervals["amplifier_Hz"] = (float(0.5 / (np.pi * high)), float(0.5 / (np.pi * low)))
        return float(0.5 / (np.pi * tau * _DELAY_S))
    absent["amplifier_Hz"] = f"too fast to be measured: above {0.5 / (np.pi * high):.3g} Hz; assumed {guess_Hz:g} Hz"
    return guess_Hz
