"""The interface of hardware that plays the acceleration channel: headphones, a voice coil on an amplifier, a board.

An output has its own clock. Whenever its buffer has room, its thread pulls samples from a `Feed` at the output's rate,
and never waits for them. `Driver.open_handle` creates an output from the driver's options.
"""

from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from hapscene.handle.plant import Array

__all__ = ["FEEDBACK_DELAY_MAX", "Feed", "HandleOutput"]

FEEDBACK_DELAY_MAX: Final = 400
"""Longest delay of measurements that a compensator accepts [samples], less than its memory of 512 samples."""


class Feed(Protocol):
    """The source of an output's samples: faded in and out, within the output's limits (`live_stream.LiveStream`)."""

    def pull(self, out: Array) -> bool | None:
        """Fill `out` (n,) with the next samples. Takes microseconds and raises nothing.

        Returns True if the force must end at once: an output then discards the samples in its buffer, if it can.
        """

    def fade_in(self) -> None:
        """Discard the samples that were pulled, and start again from silence."""

    def receive_feedback(self, numbers: NDArray[np.int64], force_N: Array, acceleration_m_s2: Array) -> None:
        """Receive measurements of samples that were pulled, (n,) each, in order. Never called while `pull` is.

        Args:
            numbers: sample numbers, counted from the first sample that was pulled.
            force_N: force that was put out; not finite where the output had no sample to play.
            acceleration_m_s2: acceleration at the start of the sample.
        """


class HandleOutput(Protocol):
    """Hardware that plays samples.

    Attributes:
        name: the hardware's name in messages.
        takes_force: True if a sample is a force [N]; False if it is a level, `gain` per m/s² (or per N of a
            compensator).
        reads_back: whether it calls `Feed.receive_feedback`, at most `FEEDBACK_DELAY_MAX` samples after `pull`.
        gain: factor of each sample.
        ceiling: largest absolute value of a sample. The feed limits the signal to it.
        highpass_Hz: corner of the high-pass filter before the output; 0 disables the filter.
        lag_s: reserve of the channel at the worst moment, against delayed ticks.
        fault: reason why the output stopped; empty while it plays.
        counts: errors so far, by name.
    """

    name: str
    takes_force: bool
    reads_back: bool
    gain: float
    ceiling: float
    highpass_Hz: float
    lag_s: float
    fault: str
    counts: dict[str, int]

    @property
    def rate_Hz(self) -> float:
        """Sample rate [Hz]."""

    @property
    def latency_s(self) -> float:
        """Current delay from `pull` to the vibration of a sample [s]."""

    def start(self, feed: Feed) -> None:
        """Start to pull samples from `feed`. Raises HandleError: the hardware is disconnected."""

    def close(self) -> None:
        """Stop the output and release the hardware. Raises nothing, even if it is disconnected; may be called twice."""
