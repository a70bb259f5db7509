"""How long a block a handle that is played as sound should have."""

import math
import time as clock
from collections.abc import Sequence
from functools import cache
from types import SimpleNamespace
from typing import Any, Final

import numpy as np

from hapscene.constants import TICK_S
from hapscene.handle.live_stream import LiveStream
from hapscene.perception import AUDIO_S, LATENCY_S

from .measuring import RATE_HZ, Array, call_us, measured
from .question import Measure, Point, Question, Setting

CARD_HZ: Final = 48_000.0

BLOCKS: Final = (32, 64, 128, 256, 512, 1024, 2048)
"""Samples that a card asks for at once [count]."""

BUFFERS: Final = (2, 3)
"""Blocks that the card holds: one plays while the others wait [count]."""

REAL: Final = "this machine's sound"
"""A method of its own: what PortAudio says of the card, and counts."""

LATE_S: Final = {"own": 0.06e-3, "busy": 3.1e-3}
"""Median lateness of what is woken: alone in its process, and beside a busy thread of Python [s] (measured, 1 kHz)."""

LEAST: Final = 1e-6
"""What fewer gaps a minute are drawn as."""

PLAYED_S: Final = 3.0
"""How long a real card is played on [s]."""


CARD: Final[Any] = SimpleNamespace(gain=1.0, ceiling=10.0, highpass_Hz=15.0, lag_s=0.005, rate_Hz=CARD_HZ)
"""What a stream needs to know of its output: the numbers of the driver `audio`."""


@cache
def _cards() -> int:
    """Sound outputs that are there [count]."""
    try:
        import sounddevice

        return int(sum(card["max_output_channels"] > 0 for card in sounddevice.query_devices()))
    except (ImportError, OSError):
        return 0


def settings(quick: bool, scene_file: str | None) -> list[Setting]:
    blocks, buffers = (BLOCKS[::3], BUFFERS[:1]) if quick else (BLOCKS, BUFFERS)
    made = [Setting(f"{n} buffers", f"{b}", {"block": b, "buffers": n}) for n in buffers for b in blocks]
    real = [Setting(REAL, f"{b}", {"block": b, "buffers": 0}) for b in blocks]
    return made + real if _cards() else made


def error(block: int, buffers: int) -> dict[str, float]:
    """How much later than its tick a sample is felt, through the stream that plays it, and how often it is not."""
    if buffers == 0:
        return _on_a_card(block)
    slack_s = (buffers - 1) * block / CARD_HZ
    found = {"latency": 1e3 * felt_s(block, buffers)}
    return found | {name: max(LEAST, gaps_1_min(block, slack_s, late)) for name, late in LATE_S.items()}


def gaps_1_min(block: int, slack_s: float, median_s: float) -> float:
    """How often in a minute the card has nothing to play, where lateness is exponential: each time it is over slack."""
    return float(60.0 * CARD_HZ / block * 2.0 ** (-slack_s / median_s))


def felt_s(block: int, buffers: int) -> float:
    """From a channel's sample to the same at the card's output [s]: a click sent through the stream is looked for.

    The card asks for block k when block k − buffers + 1 begins to play.
    """
    t_s, played = streamed(block, at_s=1.6, duration_s=1.9)
    return float(t_s[np.argmax(np.abs(played))]) + (buffers - 1) * block / CARD_HZ - 1.6


def streamed(block: int, at_s: float, duration_s: float) -> tuple[Array, Array]:
    """When each of the card's samples is due [s] (n,), and what was pulled (n,): a click at `at_s`, ticks on time."""
    channel = np.zeros(round(duration_s * RATE_HZ))
    channel[round(at_s * RATE_HZ)] = 1.0
    now_s, taken, per_tick = [0.0], [0], round(RATE_HZ * TICK_S)

    def fetch(wanted: int) -> Array:
        done = math.floor(now_s[0] / TICK_S + 1e-9) * per_tick
        samples, taken[0] = channel[taken[0] : done], done
        return samples

    stream = LiveStream(fetch, RATE_HZ, CARD, steered=True)
    pulled = np.zeros(math.floor(duration_s * CARD_HZ / block) * block)
    for k in range(0, len(pulled), block):
        now_s[0] = k / CARD_HZ
        stream.pull(pulled[k : k + block])
    return np.arange(len(pulled)) / CARD_HZ, pulled


def _on_a_card(block: int) -> dict[str, float]:
    """What PortAudio says of a real output, beside what the stream adds, and what it missed in `PLAYED_S`."""
    from hapscene_plugins.devices.audio import AudioHandle

    card = AudioHandle(block=block, buffer_s=2 * block / CARD_HZ, gain=0.0)
    stream = LiveStream(lambda wanted: np.zeros(wanted), RATE_HZ, card, steered=False)
    try:
        card.start(stream)
        clock.sleep(PLAYED_S)
        missed = card.counts["underruns"]
        return {
            "latency": 1e3 * (card.latency_s + card.lag_s + stream.latency_s),
            "own": max(LEAST, 60.0 / PLAYED_S * missed),
        }
    finally:
        card.close()


def time(block: int, buffers: int) -> tuple[float, float]:
    ready = np.random.default_rng(0).standard_normal(1 << 16)
    stream = LiveStream(lambda wanted: ready[:wanted], RATE_HZ, CARD, steered=False)
    out = np.zeros(block)
    return call_us(lambda: stream.pull(out), 1e3 * block / CARD_HZ, 600)


def advice(points: Sequence[Point]) -> str:
    """The longest block that is in time, and what a shorter one costs in gaps."""
    made = [p for p in measured(points, "latency") if p.method != REAL]
    fit = [p for p in made if p.errors["latency"] <= 1e3 * AUDIO_S] or made
    chosen = min(fit, key=lambda p: (p.errors["busy"], p.errors["latency"]))
    alone = min(
        [p for p in made if p.errors["own"] <= 1.0] or made, key=lambda p: (p.errors["latency"], p.errors["own"])
    )
    slow = [p for p in made if p.errors["latency"] > 1e3 * LATENCY_S]
    return (
        f"Choose {alone.label} samples with {alone.method} where the handle has a process of its own: "
        f"{alone.errors['latency']:.3g} ms, and {alone.errors['own']:.1g} gaps a minute. Beside a busy thread of "
        f"Python {chosen.label} with {chosen.method} have fewest within {1e3 * AUDIO_S:g} ms "
        f"({chosen.errors['busy']:.0f} a minute, {chosen.errors['latency']:.3g} ms)"
        + (f"; not {slow[0].label} or more with {slow[0].method}, which change the texture" if slow else "")
        + "."
    )


QUESTION: Final = Question(
    name="audio-latency",
    title="How long a block for a handle that is played as sound?",
    measures=(
        Measure("latency", "from tick to card's output", "ms", 1e3 * AUDIO_S, "touch and sound, Adelstein et al. 2003"),
        Measure("own", "gaps, in a process of its own", "a minute"),
        Measure("busy", "gaps, beside a busy thread", "a minute"),
    ),
    settings=settings,
    error=error,
    time=time,
    advice=advice,
    conditions=(
        f"A click of a {RATE_HZ / 1e3:g} kHz channel, ticks on time, through the stream that makes {CARD_HZ / 1e3:g} "
        "kHz of it, to a card of two or three buffers. Gaps in closed form: the card is asked later than its buffers "
        "last, where lateness is exponential with the medians that were measured, 0.06 ms and 3.1 ms. Vibration that "
        f"is {1e3 * LATENCY_S:g} ms late changes the texture (Okamoto et al. 2009)."
    ),
    per="ms of sound",
)
