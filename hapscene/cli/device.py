"""`hapscene device`: devices and handles: what is connected, a first run, identification, playing a file."""

import sys
import threading
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

from cyclopts import App, Parameter

from hapscene.cli.console import complain, name_made, say, tell, tell_over
from hapscene.cli.options import (
    Help,
    InFile,
    InFiles,
    OutFile,
    OutFolder,
    OutputOptions,
    Pairs,
    Positive,
    RecordingOptions,
    Seed,
)
from hapscene.cli.paths import base_name
from hapscene.errors import HandleError
from hapscene.io.wire.port import BAUD

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from hapscene.device.driver import Driver, Found
    from hapscene.handle.measure import GripRecording
    from hapscene.handle.plant import Plant
    from hapscene.handle.sweep import Sweep

__all__ = ["app"]

app = App(name="device", synonym="handle", help="Haptic devices and handles: list, try, identify, play a file.")

FIND_S: Final = 5.0
"""Longest time that a driver may look for its device [s]."""

RATE_HZ: Final = 10_000.0
"""Sample rate of a simulated handle [Hz]."""


@app.command(name="list")
def list_devices(*, option: Annotated[Pairs, Help("Options of the drivers that have one of this name")] = None) -> None:
    """List the drivers, the connected devices, and what they lack.

    for example:
      hapscene device list
      hapscene device list --option library=/opt/openhaptics/libHD.so
    """
    from hapscene.device.driver_registry import DRIVERS

    for name, offer in DRIVERS.listed().items():
        driver = offer.plugin
        if driver is None:
            complain(f"{name}: cannot be used: {offer.error}")
            continue
        lines = [f"{name:<15} {driver.summary}"]
        for one in (found := _found(driver, option or {})):
            remedy = "" if one.remedy in one.trouble else f"; {one.remedy}"
            state = f"{one.trouble}{remedy}" if one.trouble else "ready"
            lines.append(f"  {one.where}: {state}" if one.where else f"  {state}")
        if not found:
            lines.append("  not connected" + (f"; needs {driver.needs}" if driver.needs else ""))
        tell(lines)
    say("`hapscene device try NAME` is the first run with one; `hapscene play SCENE --device NAME` feels a scene\n")


def _found(driver: "Driver", options: dict[str, str]) -> "Sequence[Found]":
    """The connected devices of a driver. An exception of the driver, or no answer, becomes a device's trouble."""
    from hapscene.device.driver import Found

    known = {option.name for option in driver.options}
    found = [Found("", {}, f"looking for it took longer than {FIND_S:g} s", "unplug it, and plug it in again")]

    def find() -> None:
        try:
            found[:] = driver.find(**driver.read_options({k: v for k, v in options.items() if k in known}))
        except Exception as error:  # a driver of anybody's; the others are listed all the same
            found[:] = [Found("", {}, f"looking for it failed: {type(error).__name__}: {error}")]

    looking = threading.Thread(target=find, daemon=True)  # a vendor's library may hang
    looking.start()
    looking.join(FIND_S)
    return list(found)


@app.command(name="try")
def try_device(
    name: Annotated[str, Help("Device; `hapscene device list` names them")],
    /,
    *,
    option: Annotated[Pairs, Help("Options of the device's driver, as firmware=falcon.bin")] = None,
    yes: Annotated[bool, Help("Do not wait for the Enter key, and stay below 0.5 N")] = False,
) -> int:
    """Try a device for the first time: move it through its workspace, then feel a small force.

    The force is at most 0.5 N before you confirm more.

    for example:
      hapscene device try haply2diy
      hapscene device try falcon --option firmware=falcon.bin
    """
    from hapscene.play.first_run import try_device as run

    return run(name, option or {}, say, wait=not yes)


@Parameter(name="*", group="Sweep")
@dataclass(frozen=True)
class SweepOptions:
    """The swept sine."""

    low: Annotated[Positive, Help("Lowest frequency [Hz]")] = 10.0
    high: Annotated[Positive, Help("Highest frequency [Hz]")] = 1000.0
    seconds: Annotated[Positive, Help("Length [s]")] = 10.0
    force: Annotated[Positive, Help("Force amplitude [N]")] = 1.0


@Parameter(name="*", group="Hardware of the handle")
@dataclass(frozen=True)
class HardwareOptions:
    """What the identification assumes of the handle."""

    force_limit: Annotated[Positive, Help("Peak force of the actuator [N]")] = 6.6
    travel_limit: Annotated[Positive, Help("Travel of the coil to a stop [m]")] = 0.005
    accelerometer: Annotated[Positive, Help("Bandwidth of the accelerometer, one pole [Hz]")] = 1600.0
    baud: Annotated[int, Help("Speed of the serial port [bit/s]")] = BAUD


@app.command
def identify(
    *,
    simulated: Annotated[bool, Help("Identify a simulated handle in a simulated hand")] = False,
    port: Annotated[str | None, Help("Serial port of a real handle, as /dev/ttyACM0 or COM3")] = None,
    files: Annotated[
        InFiles | None, Parameter(name="--from"), Help("Recordings of force and acceleration, one a grip")
    ] = None,
    out: Annotated[OutFile, Help("Handle file, .handle, or folder for all results (default: out/NAME)")] = None,
    name: Annotated[str, Help("Name of the handle")] = "handle",
    grips: Annotated[int, Help("Number of grips, 1 to 20")] = 5,
    seed: Seed = 0,
    sweep: SweepOptions = SweepOptions(),
    hardware: HardwareOptions = HardwareOptions(),
    recording: RecordingOptions = RecordingOptions(),
) -> None:
    """Identify a haptography handle: play a swept sine in several grips, and fit its parameters, with intervals.

    for example:
      hapscene device identify --simulated
      hapscene device identify --port /dev/ttyACM0 --grips 5 --out out/mine
      hapscene device identify --from a.csv b.csv --rate 10000 -o my.handle \\
          --units acceleration=m/s2,force=N
    """
    if [simulated, port is not None, bool(files)].count(True) != 1:
        raise HandleError("name one source: --simulated, --port PORT, or --from FILE …")
    from hapscene.handle.fit import GRIP_MAX
    from hapscene.handle.fit import identify as fit
    from hapscene.handle.identification_report import describe_lines, write_result
    from hapscene.handle.measure import load_grips
    from hapscene.handle.plant import Plant
    from hapscene.handle.sweep import Sweep

    if not 1 <= grips <= GRIP_MAX:
        raise HandleError(f"--grips must be 1 to {GRIP_MAX}, is {grips}")
    guess = Plant(force_limit_N=hardware.force_limit, travel_limit_m=hardware.travel_limit)
    sine = Sweep(sweep.low, sweep.high, sweep.seconds, sweep.force)
    told = f"swept sine, {sine.low_Hz:g} to {sine.high_Hz:g} Hz, {sine.sweep_s:g} s, at most {sine.force_N:g} N"
    if files:
        recordings = load_grips(files, recording.rate, recording.columns or {}, recording.units or {})
        provenance = f"from {', '.join(files)}"
    elif port is not None:
        recordings = _from_port(port, hardware.baud, grips, sine, guess)
        provenance = f"handle on {port}; {told}"
    else:
        rate_Hz = recording.rate or RATE_HZ
        recordings = _from_simulation(grips, seed, rate_Hz, hardware.accelerometer, sine, guess)
        provenance = f"simulated handle, seed {seed}; {told}"
    responses = [each.response((sweep.low, sweep.high)) for each in recordings]
    names, rate_Hz = [each.name for each in recordings], recordings[0].rate_Hz
    how: dict[str, Any] = {"accelerometer_Hz": hardware.accelerometer, "name": name, "provenance": provenance}
    handle = fit(responses, rate_Hz, names, guess=guess, **how)
    tell(describe_lines(handle))
    name_made(write_result(handle, responses, [] if files else recordings, out or Path("out", name)))


def _from_simulation(
    count: int, seed: int, rate_Hz: float, accelerometer_Hz: float, sweep: "Sweep", guess: "Plant"
) -> "list[GripRecording]":
    """The sweep played through a simulated handle."""
    from hapscene.handle.force_source import SimulatedSource, simulated_grips
    from hapscene.handle.measure import play_grips

    grips = simulated_grips(count, seed)
    source = SimulatedSource(guess, rate_Hz, seed=seed)
    source.accelerometer_Hz = accelerometer_Hz

    def hold(i: int) -> None:
        name, k_u, b_u = grips[i]
        source.plant = replace(guess, k_u_N_m=k_u, b_u_Ns_m=b_u)
        print(f"playing grip {name}", flush=True)

    return play_grips(source, sweep, guess, [name for name, _, _ in grips], hold)


def _from_port(port: str, baud: int, count: int, sweep: "Sweep", guess: "Plant") -> "list[GripRecording]":
    """The sweep played through a real handle; the user is asked to hold it."""
    from hapscene.handle.force_source import grip_names
    from hapscene.handle.measure import play_grips
    from hapscene.handle.serial_handle import SerialSource

    names = grip_names(count)

    def share(done: float) -> None:
        if sys.stdout.isatty():
            tell_over(f"{100 * done:3.0f} %")
            if done >= 1.0:
                tell([""])

    def hold(i: int) -> None:
        print(f"grip {names[i]}: hold the handle so, and keep still for {sweep.sweep_s + 1:.0f} s", flush=True)
        if sys.stdin.isatty():
            input("press Enter to play ")

    with closing(SerialSource(port, baud, share)) as source:
        return play_grips(source, sweep, guess, names, hold)


@app.command
def play_file(
    file: Annotated[InFile, Help("Recording of `hapscene touch`, or CSV, WAV, NPZ, MAT, .hsrec")],
    /,
    *,
    compensator: Annotated[str | None, Help("Compensator (default: adaptive; flat without an accelerometer)")] = None,
    out: Annotated[OutFolder | None, Help("Folder for the simulated vibration (default: out/NAME)")] = None,
    seed: Seed = 0,
    output: OutputOptions = OutputOptions(),
    recording: RecordingOptions = RecordingOptions(),
) -> None:
    """Play an acceleration through a handle: a real one, or a simulated one whose vibration is written.

    for example:
      hapscene device play-file touch.npz --handle-file my.handle --out out/felt
      hapscene device play-file oak.csv --rate 10000 --compensator inverse \\
          --units acceleration=m/s2
      hapscene device play-file touch.npz --handle serial --handle-option port=COM3
    """
    if output.handle is not None:
        if out is not None:
            raise HandleError("--out is for the simulated handle; leave it out with --handle")
        _play_on(output, file, compensator, recording)
        return
    out = out or Path("out", base_name(file))
    from hapscene.dsp.spectrogram import spectrogram_error
    from hapscene.handle.compensator import find_compensator
    from hapscene.handle.handle_file import load_handle
    from hapscene.handle.plant import Plant
    from hapscene.handle.playback import play, write_wave
    from hapscene.handle.sensor import Sensor
    from hapscene.io.files import refusing, whole_folder

    compensator = compensator or "adaptive"
    find_compensator(compensator)
    plant, sensor = Plant(), Sensor()
    if output.handle_file is not None:
        handle = load_handle(output.handle_file)
        plant, sensor = handle.plant, handle.sensor
    desired, rate_Hz = _desired(file, recording)
    with refusing(HandleError, str(file)):
        played = play(desired, rate_Hz, plant, compensator=compensator, nominal=plant, seed=seed, sensor=sensor)
        error = spectrogram_error(desired, played.acceleration_m_s2, rate_Hz)
    result = f"{file.name} by {compensator}: spectrogram error {100 * error:.1f} %"
    with whole_folder(out) as folder:
        full_m_s2 = write_wave(played.acceleration_m_s2, rate_Hz, folder / "felt.wav")
    tell([result])
    print(f"latency {1e3 * played.latency_s:.1f} ms; full scale of felt.wav is {full_m_s2:.3g} m/s²")
    if played.hits or played.clips:
        print(f"the coil met a stop {played.hits} times; the force was cut {played.clips} times")
    name_made([out / "felt.wav"])


def _play_on(options: OutputOptions, file: Path, compensator: str | None, recording: RecordingOptions) -> None:
    """Play on a real handle."""
    from hapscene.handle.live_process import compensator_of, open_output, play_recording, report

    desired, rate_Hz = _desired(file, recording)
    output = open_output(str(options.handle), options.handle_option or {})
    try:
        known = None if options.handle_file is None else str(options.handle_file)
        handle = compensator_of(output, known, compensator)
        tell([f"playing {file.name}, {len(desired) / rate_Hz:.3g} s, on {output.name}"])
        stream = play_recording(desired, rate_Hz, output, handle)
    finally:
        output.close()
    found = report(stream, output)
    print(f"latency {1e3 * found['latency_s']:.1f} ms")
    if handle is not None and handle[0].kind == 3:
        learnt_g, known_g = 1e3 * handle[0].theta[0], 1e3 * handle[0].nominal[0]
        print(f"adapted while it played: mass of the handle {learnt_g:.3g} g, identified {known_g:.3g} g")
    if found["limited"] > 0:
        share = found["limited"] / (len(desired) / rate_Hz * output.rate_Hz)
        print(f"{100 * share:.1f} % was made quieter: it asks for more than {output.ceiling / output.gain:.3g} allows")
    wrong = [f"{word} {found[word]}" for word in (*output.counts, "clipped", "not_finite") if found[word]]
    if wrong:
        print(f"errors of the output: {', '.join(wrong)}")


def _desired(file: Path, options: RecordingOptions) -> "tuple[NDArray[np.float64], float]":
    """The acceleration of a file [m/s²], and its rate [Hz]."""
    from hapscene.capture.io.recording import load_recording
    from hapscene.render.recording import Recording, RecordingError

    if file.suffix == ".npz" and options.rate is None:
        try:
            recording = Recording.load(file)
            return recording.a_m_s2.ravel(), recording.a_rate_Hz
        except RecordingError:
            pass  # an npz of another kind, whose fault the next reader reports
    read = load_recording(file, **options.reading())
    return read.acceleration_m_s2, read.rate_Hz
