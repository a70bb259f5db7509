"""A handle that is played as sound: headphones, an exciter, a voice coil on an amplifier, a DualSense's voice coils.

A DualSense on a USB cable is a sound card of four channels at 48 kHz. 1 and 2 are its loudspeaker, 3 and 4 the voice
coils in its grips, left and right. It calls itself "Wireless Controller" or "DualSense". While another program has its
rumble on, the coils are deaf to sound. None of this was tried on hardware here; several independent sources agree.
"""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from hapscene.device.driver import Driver, Found, Option
from hapscene.errors import HandleError
from hapscene.handle.handle_output import Feed

DUALSENSE: Final = ("dualsense", "wireless controller")
"""What it is called, in lower case, as part of a longer name."""

TRAP: Final = (
    "shows only {count} of its four channels, without those of its voice coils: on Linux choose the profile Pro Audio "
    "or Direct for it (pavucontrol, Configuration), on Windows Quadraphonic; on macOS it has all four"
)

BLOCK_MAX: Final = 1 << 16
"""Most samples that a card asks for at once [count]."""

FULL_SCALE: Final = 32_767


class AudioHandle:
    """Plays on a sound card through PortAudio, as a `HandleOutput`."""

    takes_force = reads_back = False

    def __init__(
        self,
        device: str = "",
        channels: str = "",
        gain: float = 0.02,
        rate_Hz: float = 48_000.0,
        buffer_s: float = 0.0,
        block: int = 0,
        highpass_Hz: float = 15.0,
        lag_s: float = 0.005,
    ) -> None:
        """Opens it; `DRIVER.options` says what the arguments mean.

        Raises:
            HandleError: no PortAudio, no such output, or one without these channels.
        """
        self._sound = _sounddevice()
        self._rate_Hz, self.gain, self.ceiling, self.highpass_Hz, self.lag_s = rate_Hz, gain, 0.99, highpass_Hz, lag_s
        self.fault, self.counts = "", {"underruns": 0}
        self._feed: Feed | None = None
        number, name, count = _chosen(self._sound, device)
        self.name = name
        self._columns = _columns(channels, name, count)
        self._samples = np.zeros(BLOCK_MAX)
        needed = max(self._columns) + 1
        try:
            self._stream: Any = self._sound.OutputStream(
                samplerate=rate_Hz,
                device=number,
                channels=max(needed, 4) if count >= 4 else needed,  # the card's own, else a mixer may spread them
                dtype="int16",  # rounded here: PortAudio cuts
                latency=buffer_s or "low",
                blocksize=block,
                callback=self._fill,
                finished_callback=self._finished,
            )
        except (self._sound.PortAudioError, ValueError) as error:
            raise HandleError(f"{name}: cannot be opened: {' '.join(str(error).split())}") from None
        self._closing, self._latency_s = False, 0.0

    @property
    def rate_Hz(self) -> float:
        return self._rate_Hz

    @property
    def latency_s(self) -> float:
        """What PortAudio says of the open stream, and said last of a closed one."""
        if not self._closing:
            self._latency_s = float(self._stream.latency)
        return self._latency_s

    def start(self, feed: Feed) -> None:
        self._feed = feed
        try:
            self._stream.start()
        except self._sound.PortAudioError as error:
            raise HandleError(f"{self.name}: cannot play: {' '.join(str(error).split())}") from None

    def _fill(self, out: Any, count: int, time: Any, status: Any) -> None:
        out.fill(0)
        try:
            self.counts["underruns"] += bool(status.output_underflow)
            samples = self._samples[:count]
            assert self._feed is not None
            self._feed.pull(samples)
            whole = np.rint(FULL_SCALE * samples)
            for column in self._columns:
                out[:, column] = whole
        except Exception as error:  # a fault of ours: silence, and it is told
            out.fill(0)
            self.fault = f"{self.name}: {type(error).__name__}: {error}"
            raise self._sound.CallbackAbort from None

    def _finished(self) -> None:
        if not self._closing and not self.fault:
            self.fault = f"{self.name}: plays no more: was it unplugged?"

    def close(self) -> None:
        if self._closing:
            return
        _ = self.latency_s
        self._closing = True
        try:
            if not self.fault:
                self._stream.stop()  # plays what it has been given, which ends in silence
            self._stream.close()
        except self._sound.PortAudioError:
            pass  # it is gone


def _sounddevice() -> Any:
    try:
        import sounddevice
    except ImportError:
        raise HandleError("playing as sound needs sounddevice: pip install 'hapscene[audio]'") from None
    except OSError:
        raise HandleError("playing as sound needs PortAudio: sudo apt-get install libportaudio2") from None
    return sounddevice


def outputs(sound: Any) -> list[tuple[int, str, int]]:
    """Number, name and count of channels of each output that is there."""
    found = [(i, card["name"], int(card["max_output_channels"])) for i, card in enumerate(sound.query_devices())]
    return [card for card in found if card[2] > 0]


def is_dualsense(name: str) -> bool:
    return any(part in name.lower() for part in DUALSENSE)


def _chosen(sound: Any, device: str) -> tuple[int, str, int]:
    """The output that was meant: the one with the most channels of those whose name fits."""
    there = outputs(sound)
    if device:
        fits = [card for card in there if device == str(card[0])]
        fits = fits or [card for card in there if device.lower() in card[1].lower()]
        fits = fits or [card for card in there if device.lower() in DUALSENSE and is_dualsense(card[1])]
    else:
        fits = [card for card in there if is_dualsense(card[1])]
        fits = fits or [card for card in there if card[0] == sound.default.device[1]] or there
    if not fits:
        names = "; ".join(f"{number} {name} ({count} channels)" for number, name, count in there) or "none"
        wanted = f"no sound output {device!r}" if device else "no sound output"
        raise HandleError(f"{wanted}; there are: {names}")
    return max(fits, key=lambda card: card[2])


def _columns(channels: str, name: str, count: int) -> list[int]:
    """The channels to play on, from 0."""
    coils = is_dualsense(name)
    if coils and not channels and count < 4:
        raise HandleError(f"{name}: {TRAP.format(count=count)}; or give option channels=1,2 for what it shows")
    text = channels or ("3,4" if coils else "1,2" if count > 1 else "1")
    try:
        chosen = [int(part) - 1 for part in text.split(",")]
    except ValueError:
        raise HandleError(f"option channels={text}: are numbers from 1 with commas between, as 3,4") from None
    if not all(0 <= column < count for column in chosen):
        raise HandleError(f"option channels={text}: {name} has the channels 1 to {count}")
    return chosen


def find(**options: Any) -> Sequence[Found]:
    """The outputs that are there."""
    try:
        sound = _sounddevice()
    except HandleError as error:
        trouble, _, remedy = str(error).partition(": ")
        return [Found("sound", trouble=trouble, remedy=remedy)]
    found = []
    for number, name, count in outputs(sound):
        trap = f"{name}: {TRAP.format(count=count)}" if is_dualsense(name) and count < 4 else ""
        found.append(Found(f"{name} ({count} channels)", {"device": str(number)}, *trap.split(": on Linux ", 1)))
    return found


DRIVER = Driver(
    name="audio",
    summary="Sound: headphones, an exciter, a coil on an amplifier, a DualSense's voice coils (a handle).",
    open_handle=AudioHandle,
    find=find,
    force=False,
    needs="sounddevice (pip install 'hapscene[audio]'); on Linux libportaudio2",
    options=(
        Option("device", "", "number, or part of the name, of an output; else a DualSense, or the system's own"),
        Option("channels", "", "to play on, from 1, as 3,4; else 3 and 4 of a DualSense, or the first two"),
        Option("gain", 0.02, "part of full scale for 1 m/s², or for 1 N where a compensator makes force"),
        Option("rate_Hz", 48_000.0, "of the card [Hz]"),
        Option("buffer_s", 0.0, "how much the system keeps in hand [s]; 0 for the least that it offers"),
        Option("block", 0, "samples that it asks for at once; 0 for as many as it likes"),
        Option("highpass_Hz", 15.0, "what is lower is left out [Hz]; 0 for nothing"),
        Option("lag_s", 0.005, "how much of the channel is kept in hand beside that [s]"),
    ),
    assumptions=("A DualSense has its voice coils on channels 3 and 4, and calls itself so on every system.",),
)
