"""The contract of what a handle is played on for real: headphones, a coil on an amplifier, a board of one's own.

An output has a clock of its own. Whenever it has room it pulls samples, at its rate, from a `Feed`, in a thread of its
own; it never waits for them. It opens what it drives when it is made, and what it is made of are its options.
"""

import inspect
from collections.abc import Callable, Mapping
from importlib.metadata import entry_points
from typing import Any, Final, Protocol

from hapscene.errors import HandleError, no_such
from hapscene.handle.plant import Array

GROUP: Final = "hapscene.devices"
"""Name of the entry-point group that handles join."""


class Feed(Protocol):
    """Where an output takes its samples from; faded in and out, and inside its limits (`live_stream.LiveStream`)."""

    def pull(self, out: Array) -> None:
        """Fill `out` (n,) with the next samples; takes microseconds, and raises nothing."""

    def fade_in(self) -> None:
        """What was pulled before is lost: begin with silence anew."""


class HandleOutput(Protocol):
    """Something that plays.

    Attributes:
        name: what it plays on, for messages.
        takes_force: whether a sample is a force [N]; else it is a level, `gain` per m/s², or per N of a compensator's.
        gain: what a sample is multiplied by.
        ceiling: the largest that it takes; what is louder is limited beforehand.
        highpass_Hz: below that it is given nothing; 0 for all.
        lag_s: how much of the channel is kept in hand at the worst moment, against ticks that come late.
        fault: why it plays no more; empty while it does.
        counts: what went wrong so far, by name.
    """

    name: str
    takes_force: bool
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


def open_output(name: str, options: Mapping[str, Any]) -> HandleOutput:
    """The handle that plugin `name` plays on, opened with its options, which may be texts.

    Raises:
        HandleError: no such handle or option, a value that is none, or nothing there that can be used.
    """
    found = {point.name: point for point in entry_points(group=GROUP)}
    if name not in found:
        raise HandleError(no_such("handle to play on", name, found))
    offer = found[name].load()
    opener: Callable[..., HandleOutput] | None = getattr(offer, "open_handle", offer)
    if opener is None:
        raise HandleError(f"{name!r} plays no acceleration: it is a device to touch with (--device {name})")
    return opener(**_read(name, opener, options))


def is_output(name: str) -> bool:
    """Whether a plugin has that name."""
    return any(point.name == name for point in entry_points(group=GROUP))


def _read(name: str, opener: Callable[..., Any], told: Mapping[str, Any]) -> dict[str, Any]:
    """The options told, each of the type that its default has."""
    known = inspect.signature(opener).parameters
    read = {}
    for key, value in told.items():
        if key not in known:
            raise HandleError(f"handle {name!r}: {no_such('option', key, known)}")
        kind = type(known[key].default)
        try:
            read[key] = kind(value)
        except ValueError:
            raise HandleError(f"handle {name!r}: option {key} is a number, is {value!r:.60}") from None
    return read
