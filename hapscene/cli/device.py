"""`hapscene device`: list and try haptic devices, identify a handle, play a recording on a handle."""

import importlib
import sys
import threading
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

from cyclopts import App, Parameter

from hapscene.cli.console import print_error, print_files, print_lines, print_progress
from hapscene.cli.inputs import base_name
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
from hapscene.errors import DeviceError, HandleError
from hapscene.io.probe_port import BAUD

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from hapscene.device.driver import Driver, Found
    from hapscene.handle.measure import GripRecording, Sweep
    from hapscene.handle.plant import Plant

__all__ = ["app"]

app = App(name="device", synonym="handle", help="Haptic devices and handles: list, try, check, identify, play a file.")

FIND_S: Final = 5.0
"""Longest time for the device search of a driver [s]."""

RATE_HZ: Final = 10_000.0
"""Sample rate of a simulated handle [Hz]."""


@app.command(name="list")
def list_devices(
    *, option: Annotated[Pairs, Help("Driver options, passed to each driver that has an option of that name")] = None
) -> None:
    """List the device drivers, the connected devices, and how to make the others ready.

    examples:
      hapscene device list
      hapscene device list --option library=/opt/openhaptics/libHD.so
    """
    from hapscene.device.driver_registry import DRIVERS

    for name, offer in DRIVERS.listed().items():
        driver = offer.plugin
        if driver is None:
            print_error(f"{name}: the driver cannot be loaded: {offer.error}")
            continue
        lines = [f"{name:<15} {driver.summary}"]
        for one in (found := _found(driver, option or {})):
            remedy = "" if one.remedy in one.trouble else f"; {one.remedy}"
            state = f"{one.trouble}{remedy}" if one.trouble else "ready"
            lines.append(f"  {one.where}: {state}" if one.where else f"  {state}")
        if not found:
            lines.append("  not connected" + (f"; needs {driver.needs}" if driver.needs else ""))
        print_lines(lines)


def _found(driver: "Driver", options: dict[str, str]) -> "Sequence[Found]":
    """Return the connected devices of a driver. An exception or a timeout becomes a device that is not ready."""
    from hapscene.device.driver import Found

    known = {option.name for option in driver.options}
    found = [Found("", {}, f"the search took longer than {FIND_S:g} s", "disconnect the device, and connect it again")]

    def find() -> None:
        try:
            found[:] = driver.find(**driver.read_options({k: v for k, v in options.items() if k in known}))
        except Exception as error:  # a driver may raise anything; the other drivers are still listed
            found[:] = [Found("", {}, f"the search failed: {type(error).__name__}: {error}")]

    search = threading.Thread(target=find, daemon=True)  # a vendor library may hang
    search.start()
    search.join(FIND_S)
    return list(found)


@app.command(name="try")
def try_device(
    name: Annotated[str, Help("Device, listed by `hapscene device list`")],
    /,
    *,
    option: Annotated[Pairs, Help("Options of the device driver, as in firmware=falcon.bin")] = None,
    yes: Annotated[bool, Help("Run without waiting for the Enter key")] = False,
) -> int:
    """Test a device step by step: position first, then a small force.

    You move the device through its workspace, then it renders a small force, below
    0.5 N. For the full force, use `hapscene play SCENE --device NAME`.

    examples:
      hapscene device try haply2diy
      hapscene device try falcon --option firmware=falcon.bin
    """
    from hapscene.play.first_run import try_device as run

    return run(name, option or {}, print_progress, wait=not yes)


@app.command(name="check")
def check_device(
    name: Annotated[str, Help("Driver: a name of `hapscene device list`, or MODULE:DRIVER of a file in this folder")],
    /,
    *,
    option: Annotated[Pairs, Help("Options of the driver, as port=/dev/ttyACM0")] = None,
    emulator: Annotated[
        str | None, Help("Emulator to check instead of the connected device, as MODULE:CLASS in this folder")
    ] = None,
) -> int:
    """Check that a driver keeps the driver contract, on the connected device or on an emulator.

    Prints one line per check: ok, failed or skipped. The exit code is 1 if a check
    failed. The connected device receives no force. An emulator receives at most
    0.5 N, and also injects faults: see docs/tutorials/write-a-driver.md.

    examples:
      hapscene device check haply2diy --option port=/dev/ttyACM0 --option homed=yes
      hapscene device check board_driver:DRIVER --emulator board_emulator:Board
    """
    from hapscene.device.check import check_driver
    from hapscene.device.driver import Driver
    from hapscene.device.driver_registry import DRIVERS, DeviceChoice
    from hapscene.device.emulator import Emulator, serve

    driver = _imported(name, Driver) if ":" in name else DRIVERS.load(name)
    if driver.open is None:
        DeviceChoice(name).checked()  # raises an error that names the driver's kind
    if emulator is None:
        return 0 if check_driver(driver, option or {}, print_progress) else 1
    emulated = _imported(emulator, type)()
    if not isinstance(emulated, Emulator):
        raise DeviceError(f"{emulator}: expected a class that is derived from hapscene.device.emulator.Emulator")
    with serve(emulated) as place:
        known = {one.name for one in driver.options}
        given = {**{key: value for key, value in place.items() if key in known}, **(option or {})}
        return 0 if check_driver(driver, given, print_progress, emulated) else 1


def _imported(text: str, kind: type) -> Any:
    """The object MODULE:NAME, of an installed module or of one in the current folder."""
    module, _, name = text.partition(":")
    sys.path.insert(0, "")
    try:
        found = getattr(importlib.import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise DeviceError(f"{text}: cannot be imported: {error}; expected MODULE:NAME, as my_driver:DRIVER") from None
    finally:
        sys.path.remove("")
    if not isinstance(found, kind):
        raise DeviceError(f"{text}: is a {type(found).__name__}; expected a {kind.__name__}")
    return found


@Parameter(name="*", group="Sweep")
@dataclass(frozen=True)
class SweepOptions:
    """Options of the swept sine."""

    low: Annotated[Positive, Help("Lowest frequency [Hz]")] = 10.0
    high: Annotated[Positive, Help("Highest frequency [Hz]")] = 1000.0
    seconds: Annotated[Positive, Help("Duration [s]")] = 10.0
    force: Annotated[Positive, Help("Force amplitude [N]")] = 1.0


@Parameter(name="*", group="Hardware of the handle")
@dataclass(frozen=True)
class HardwareOptions:
    """Known properties of the handle."""

    force_limit: Annotated[Positive, Help("Peak force of the actuator [N]")] = 6.6
    travel_limit: Annotated[Positive, Help("Travel of the coil from the centre to a stop [m]")] = 0.005
    accelerometer: Annotated[Positive, Help("Bandwidth of the accelerometer, first order [Hz]")] = 1600.0
    baud: Annotated[int, Help("Baud rate of the serial port [bit/s]")] = BAUD


@app.command
def identify(
    *,
    simulated: Annotated[bool, Help("Identify a simulated handle in a simulated hand")] = False,
    port: Annotated[str | None, Help("Serial port of a real handle, as in /dev/ttyACM0 or COM3")] = None,
    files: Annotated[
        InFiles | None, Parameter(name="--from"), Help("Recordings of force and acceleration, one for each grip")
    ] = None,
    out: Annotated[OutFile, Help("Handle file (.handle), or folder for all results (default: out/NAME)")] = None,
    name: Annotated[str, Help("Name of the handle")] = "handle",
    grips: Annotated[int, Help("Number of grips, 1 to 20")] = 5,
    seed: Seed = 0,
    sweep: SweepOptions = SweepOptions(),
    hardware: HardwareOptions = HardwareOptions(),
    recording: RecordingOptions = RecordingOptions(),
) -> None:
    """Identify a haptography handle: play a swept sine in several grips, and fit the model parameters.

    The result has a confidence interval for each parameter. Give one source:
    --simulated, --port or --from.

    examples:
      hapscene device identify --simulated
      hapscene device identify --port /dev/ttyACM0 --grips 5 --out out/mine
      hapscene device identify --from a.csv b.csv --rate 10000 -o my.handle \\
          --units acceleration=m/s2,force=N
    """
    if [simulated, port is not None, bool(files)].count(True) != 1:
        raise HandleError("expected exactly one source: --simulated, --port PORT, or --from FILE …")
    from hapscene.handle.fit import GRIP_MAX
    from hapscene.handle.fit import identify as fit
    from hapscene.handle.handle_file import describe_lines, write_result
    from hapscene.handle.measure import Sweep, load_grips
    from hapscene.handle.plant import Plant

    if not 1 <= grips <= GRIP_MAX:
        raise HandleError(f"--grips {grips} is out of range; expected 1 to {GRIP_MAX}")
    guess = Plant(force_limit_N=hardware.force_limit, travel_limit_m=hardware.travel_limit)
    sine = Sweep(sweep.low, sweep.high, sweep.seconds, sweep.force)
    signal = f"swept sine, {sine.low_Hz:g} to {sine.high_Hz:g} Hz, {sine.sweep_s:g} s, at most {sine.force_N:g} N"
    if files:
        recordings = load_grips(files, **recording.reading())
        provenance = f"from {', '.join(files)}"
    elif port is not None:
        recordings = _from_port(port, hardware.baud, grips, sine, guess)
        provenance = f"handle on {port}; {signal}"
    else:
        rate_Hz = recording.rate or RATE_HZ
        recordings = _from_simulation(grips, seed, rate_Hz, hardware.accelerometer, sine, guess)
        provenance = f"simulated handle, seed {seed}; {signal}"
    responses = [each.response((sweep.low, sweep.high)) for each in recordings]
    names, rate_Hz = [each.name for each in recordings], recordings[0].rate_Hz
    how: dict[str, Any] = {"accelerometer_Hz": hardware.accelerometer, "name": name, "provenance": provenance}
    handle = fit(responses, rate_Hz, names, guess=guess, **how)
    print_lines(describe_lines(handle))
    print_files(write_result(handle, responses, [] if files else recordings, out or Path("out", name)))


def _from_simulation(
    count: int, seed: int, rate_Hz: float, accelerometer_Hz: float, sweep: "Sweep", guess: "Plant"
) -> "list[GripRecording]":
    """Play the sweep through a simulated handle."""
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
    """Play the sweep through a real handle; before each grip, ask the user to hold it."""
    from hapscene.handle.board import SerialSource
    from hapscene.handle.force_source import grip_names
    from hapscene.handle.measure import play_grips

    names = grip_names(count)

    def hold(i: int) -> None:
        print(
            f"grip {names[i]}: hold the handle in this grip, without moving, for {sweep.sweep_s + 1:.0f} s", flush=True
        )
        if sys.stdin.isatty():
            input("press Enter to play the sweep ")

    with closing(SerialSource(port, baud)) as source:
        return play_grips(source, sweep, guess, names, hold)


@app.command
def play_file(
    file: Annotated[InFile, Help("Recording of `hapscene touch`, or CSV, WAV, NPZ, MAT, .hsrec")],
    /,
    *,
    compensator: Annotated[
        str | None, Help("Compensator: adaptive, flat, inverse, naive (default: adaptive, flat without accelerometer)")
    ] = None,
    out: Annotated[OutFolder | None, Help("Folder for the simulated vibration (default: out/NAME)")] = None,
    seed: Seed = 0,
    output: OutputOptions = OutputOptions(),
    recording: RecordingOptions = RecordingOptions(),
) -> None:
    """Play a recorded acceleration on a handle, real or simulated.

    Without --handle, the handle is simulated: its vibration is written as
    felt.wav, and its error relative to the recording is printed.

    examples:
      hapscene device play-file touch.npz --handle-file my.handle --out out/felt
      hapscene device play-file oak.csv --rate 10000 --compensator inverse \\
          --units acceleration=m/s2
      hapscene device play-file touch.npz --handle serial --handle-option port=COM3
    """
    if output.handle is not None:
        if out is not None:
            raise HandleError("--out is only valid for the simulated handle; remove --out or --handle")
        _play_on(output, file, compensator, recording)
        return
    out = out or Path("out", base_name(file))
    from hapscene.dsp.spectrogram import spectrogram_error
    from hapscene.handle.compensator import find_compensator
    from hapscene.handle.handle_file import load_handle
    from hapscene.handle.handle_loop import play
    from hapscene.handle.plant import Plant, Sensor
    from hapscene.io.files import refusing, whole_folder
    from hapscene.view.sound import write_wave

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
    result = f"{file.name}, {compensator} compensator: spectrogram error {100 * error:.1f} %"
    with whole_folder(out) as folder:
        full_m_s2 = write_wave(played.acceleration_m_s2, rate_Hz, folder / "felt.wav")
    print_lines([result])
    print(f"latency {1e3 * played.latency_s:.1f} ms; full scale of felt.wav is {full_m_s2:.3g} m/s²")
    if played.hits or played.clips:
        print(f"the coil hit a stop {played.hits} times; the force was clipped {played.clips} times")
    print_files([out / "felt.wav"])


def _play_on(options: OutputOptions, file: Path, compensator: str | None, recording: RecordingOptions) -> None:
    """Play a recording on a real handle."""
    from hapscene.handle.live_process import compensator_of, open_output, play_recording, report

    desired, rate_Hz = _desired(file, recording)
    output = open_output(str(options.handle), options.handle_option or {})
    try:
        known = None if options.handle_file is None else str(options.handle_file)
        handle = compensator_of(output, known, compensator)
        print_lines([f"playing {file.name}, {len(desired) / rate_Hz:.3g} s, on {output.name}"])
        stream = play_recording(desired, rate_Hz, output, handle)
    finally:
        output.close()
    found = report(stream, output)
    print(f"latency {1e3 * found['latency_s']:.1f} ms")
    if found["limited"] > 0:
        share = found["limited"] / (len(desired) / rate_Hz * output.rate_Hz)
        print(f"{100 * share:.1f} % was attenuated, since it exceeds the limit {output.ceiling / output.gain:.3g}")
    wrong = [f"{word} {found[word]}" for word in (*output.counts, "clipped", "not_finite") if found[word]]
    if wrong:
        print(f"errors of the output: {', '.join(wrong)}")


def _desired(file: Path, options: RecordingOptions) -> "tuple[NDArray[np.float64], float]":
    """Read the acceleration of a file [m/s²] and its sample rate [Hz]."""
    from hapscene.capture.io.recording import load_recording
    from hapscene.render.recording import Recording, RecordingError

    if file.suffix == ".npz" and options.rate is None:
        try:
            recording = Recording.load(file)
            return recording.a_m_s2.ravel(), recording.a_rate_Hz
        except RecordingError:
            pass  # not written by `hapscene touch`: the next reader reads it, or raises
    read = load_recording(file, **options.reading())
    return read.acceleration_m_s2, read.rate_Hz
