"""Audio output for headphones, an exciter, a voice coil on an amplifier, or the voice coils of a DualSense.

A DualSense on a USB cable is a sound card with four channels at 48 kHz: 1 and 2 are its loudspeaker, 3 and 4 its voice
coils, which play no audio while another program uses its rumble.
"""

import threading
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, Final

import numpy as np

from hapscene.device.driver import Driver, Found, Option
from hapscene.errors import HandleError
from hapscene.handle.handle_output import Feed

DUALSENSE: Final = ("dualsense", "wireless controller")
"""Parts of the name of a DualSense sound card, in lower case."""

TRAP: Final = (
    "has only {count} of its four channels, without those of the voice coils: on Linux select the profile Pro Audio "
    "or Direct (pavucontrol, Configuration), on Windows Quadraphonic; macOS provides all four"
)

BLOCK_MAX: Final = 1 << 16
"""Largest block of samples that a card requests."""

FULL_SCALE: Final = 32_767

BUFFERS_S: Final = (0.08, 0.12, 0.2, 0.3)
"""Lengths of the audio buffer without the option buffer_s [s]: the first, and the next one after an underrun.

The smallest buffer of PortAudio (`latency="low"`, 10 to 30 ms) has underruns on a busy computer."""


class AudioHandle:
    """A sound card, through PortAudio, as a `HandleOutput`."""

    takes_force = reads_back = False

    def __init__(
        self,
        device: str,
        channels: str,
        gain: float,
        rate_Hz: float,
        buffer_s: float,
        block: int,
        highpass_Hz: float,
        lag_s: float,
    ) -> None:
        """Open the card. The arguments are `DRIVER.options`.

        Raises:
            HandleError: PortAudio is not installed, or the output or its channels do not exist.
        """
        self._sound = _sounddevice()
        self.rate_Hz, self.gain, self.ceiling, self.highpass_Hz, self.lag_s = rate_Hz, gain, 0.99, highpass_Hz, lag_s
        self.fault, self.counts = "", {"underruns": 0}
        self._feed: Feed | None = None
        number, self.name, count = _chosen(self._sound, device)
        self._columns = _columns(channels, self.name, count)
        self._samples = np.zeros(BLOCK_MAX)
        needed = max(self._columns) + 1
        self._buffers_s = [buffer_s] if buffer_s > 0.0 else list(BUFFERS_S)
        self._options = {
            "samplerate": rate_Hz,
            "device": number,
            "channels": max(needed, 4) if count >= 4 else needed,  # all channels: a mixer may redistribute some
            "dtype": "int16",  # rounded here, since PortAudio truncates
            "blocksize": block,
            "callback": self._fill,
            "finished_callback": self._finished,
        }
        self._closing, self._reopening, self._latency_s = False, False, 0.0
        self._lock, self._grow = threading.Lock(), threading.Event()
        try:
            self._stream = self._open()
        except (self._sound.PortAudioError, ValueError) as error:
            raise HandleError(f"{self.name}: cannot be opened: {' '.join(str(error).split())}") from None

    def _open(self) -> Any:
        """A stream with the next length of the buffer."""
        return self._sound.OutputStream(latency=self._buffers_s.pop(0), **self._options)

    @property
    def latency_s(self) -> float:
        """Latency of the current buffer, as PortAudio reports it [s]; the last value after `close`."""
        if not self._closing and not self._reopening:
            self._latency_s = float(self._stream.latency)
        return self._latency_s

    def start(self, feed: Feed) -> None:
        self._feed = feed
        try:
            self._stream.start()
        except self._sound.PortAudioError as error:
            raise HandleError(f"{self.name}: cannot play: {' '.join(str(error).split())}") from None
        if self._buffers_s:
            threading.Thread(target=self._grow_when_needed, name="hapscene audio", daemon=True).start()

    def _grow_when_needed(self) -> None:
        """Enlarge the buffer after each underrun. A thread, since a callback must not close its own stream."""
        while self._buffers_s and not self._closing and not self.fault:
            self._grow.wait()
            self.grow()

    def grow(self) -> None:
        """Reopen the stream with the next length of the buffer. The signal fades in again."""
        with self._lock:
            if self._closing or self.fault or not self._buffers_s:
                return
            _ = self.latency_s
            self._reopening = True
            try:
                self._stream.stop()
                self._stream.close()
                assert self._feed is not None
                self._feed.fade_in()
                self._stream = self._open()
                self._grow.clear()
                self._stream.start()
                self._reopening = False
            except (self._sound.PortAudioError, ValueError) as error:
                self.fault = f"{self.name}: cannot be reopened: {' '.join(str(error).split())}"

    def _fill(self, out: Any, count: int, time: Any, status: Any) -> None:
        out.fill(0)
        try:
            if status.output_underflow:
                self.counts["underruns"] += 1
                self._grow.set()
            samples = self._samples[:count]
            assert self._feed is not None
            self._feed.pull(samples)
            whole = np.rint(FULL_SCALE * samples)
            for column in self._columns:
                out[:, column] = whole
        except Exception as error:  # a programming error: play silence and report it
            self.fault = f"{self.name}: {type(error).__name__}: {error}"
            raise self._sound.CallbackAbort from None

    def _finished(self) -> None:
        if not self._closing and not self._reopening and not self.fault:
            self.fault = f"{self.name}: the output has stopped; check that it is connected"

    def close(self) -> None:
        with self._lock:
            if self._closing:
                return
            _ = self.latency_s
            self._closing = True
            self._grow.set()
            with suppress(self._sound.PortAudioError):  # the card was disconnected
                if not self.fault:
                    self._stream.stop()  # plays the buffered samples, which end in silence
                self._stream.close()


def _sounddevice() -> Any:
    try:
        import sounddevice
    except ImportError:
        raise HandleError("sounddevice is not installed: pip install 'hapscene[audio]'") from None
    except OSError:
        raise HandleError("PortAudio is not installed: sudo apt-get install libportaudio2") from None
    return sounddevice


def outputs(sound: Any) -> list[tuple[int, str, int]]:
    """Index, name and channel count of each audio output."""
    found = [(i, card["name"], int(card["max_output_channels"])) for i, card in enumerate(sound.query_devices())]
    return [card for card in found if card[2] > 0]


def is_dualsense(name: str) -> bool:
    return any(part in name.lower() for part in DUALSENSE)


def _chosen(sound: Any, device: str) -> tuple[int, str, int]:
    """Select an output: of those whose name matches, the one with the most channels."""
    known = outputs(sound)
    if device:
        fits = [card for card in known if device == str(card[0])]
        fits = fits or [card for card in known if device.lower() in card[1].lower()]
        fits = fits or [card for card in known if device.lower() in DUALSENSE and is_dualsense(card[1])]
    else:
        fits = [card for card in known if is_dualsense(card[1])]
        fits = fits or [card for card in known if card[0] == sound.default.device[1]] or known
    if not fits:
        names = "; ".join(f"{number} {name} ({count} channels)" for number, name, count in known) or "not found"
        wanted = f"no audio output {device!r}" if device else "no audio output"
        raise HandleError(f"{wanted}; outputs: {names}")
    return max(fits, key=lambda card: card[2])


def _columns(channels: str, name: str, count: int) -> list[int]:
    """Indices of the channels to play on, from 0."""
    coils = is_dualsense(name)
    if coils and not channels and count < 4:
        raise HandleError(
            f"{name}: {TRAP.format(count=count)}; or use --handle-option channels=1,2 for the provided channels"
        )
    text = channels or ("3,4" if coils else "1,2" if count > 1 else "1")
    try:
        chosen = [int(part) - 1 for part in text.split(",")]
    except ValueError:
        raise HandleError(
            f"option channels={text}: expected channel numbers from 1, separated by commas, such as 3,4"
        ) from None
    if not all(0 <= column < count for column in chosen):
        raise HandleError(f"option channels={text}: expected channels 1 to {count} of {name}")
    return chosen


def find(**options: Any) -> Sequence[Found]:
    """The audio outputs."""
    try:
        sound = _sounddevice()
    except HandleError as error:
        trouble, _, remedy = str(error).partition(": ")
        return [Found("audio", trouble=trouble, remedy=remedy)]
    found = []
    for number, name, count in outputs(sound):
        trap = f"{name}: {TRAP.format(count=count)}" if is_dualsense(name) and count < 4 else ""
        found.append(Found(f"{name} ({count} channels)", {"device": str(number)}, *trap.split(": on Linux ", 1)))
    return found


DRIVER = Driver(
    name="audio",
    summary="Handle: an audio output with headphones, an exciter, a voice coil, or a DualSense.",
    open_handle=AudioHandle,
    find=find,
    force=False,
    needs="sounddevice (pip install 'hapscene[audio]'); on Linux libportaudio2",
    options=(
        Option("device", "", "index or part of the name of an output; by default a DualSense, or the system's default"),
        Option("channels", "", "channels, from 1, such as 3,4; by default 3,4 of a DualSense, otherwise 1,2"),
        Option("gain", 0.02, "share of full scale for 1 m/s², or for 1 N with a compensator"),
        Option("rate_Hz", 48_000.0, "sample rate of the card [Hz]"),
        Option("buffer_s", 0.0, "length of the audio buffer [s]; 0 for 0.08 s, and after underruns up to 0.3 s"),
        Option("block", 0, "block size [samples]; 0 for the system's choice"),
        Option("highpass_Hz", 15.0, "corner of the high-pass filter [Hz]; 0 disables the filter"),
        Option("lag_s", 0.005, "reserve of the channel against delayed ticks [s]"),
    ),
    assumptions=("A DualSense has its voice coils on channels 3 and 4, and the same name on every system.",),
)
