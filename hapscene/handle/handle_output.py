"""The contract of what a handle is played on for real: headphones, a coil on an amplifier, a board of one's own.

An output has a clock of its own. Whenever it has room it pulls samples, at its rate, from a `Feed`, in a thread of its
own; it never waits for them. It opens what it drives when it is made: `Driver.open_handle` makes it of its options.
"""

from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from hapscene.handle.plant import Array

__all__ = ["HEARD_MAX", "Feed", "HandleOutput"]

HEARD_MAX: Final = 400
"""How many samples late a compensator hears what became of its own [count]: less than its memory of 512."""


class Feed(Protocol):
    """Where an output takes its samples from; faded in and out, and inside its limits (`live_stream.LiveStream`)."""

    def pull(self, out: Array) -> None:
        """Fill `out` (n,) with the next samples; takes microseconds, and raises nothing."""

    def fade_in(self) -> None:
        """What was pulled before is lost: begin with silence anew."""

    def hear(self, numbers: NDArray[np.int64], force_N: Array, acceleration_m_s2: Array) -> None:
        """What came of samples that were pulled, (n,) each, in order; not finite where the output had none to play.

        Numbers are counted from the first sample that was ever pulled; the force is that which was put out, and the
        acceleration is read as it begins. Never while `pull` is called.
        """


class HandleOutput(Protocol):
    """Something that plays.

    Attributes:
        name: what it plays on, for messages.
        takes_force: whether a sample is a force [N]; else it is a level, `gain` per m/s², or per N of a compensator's.
        reads_back: whether it tells `Feed.hear` what came of a sample, at most `HEARD_MAX` samples after it was pulled.
        gain: what a sample is multiplied by.
        ceiling: the largest that it takes; what is louder is limited beforehand.
        highpass_Hz: below that it is given nothing; 0 for all.
        lag_s: how much of the channel is kept in hand at the worst moment, against ticks that come late.
        fault: why it plays no more; empty while it does.
        counts: what went wrong so far, by name.
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
        """Samples a second that it takes."""

    @property
    def latency_s(self) -> float:
        """How long after it was pulled a sample is felt [s], as it is now."""

    def start(self, feed: Feed) -> None:
        """Pull from `feed` from now on.

        Raises:
            HandleError: it is gone.
        """

    def close(self) -> None:
        """Put out nothing any more, and let go of it; raises nothing, also where it is gone. Twice does no harm."""
