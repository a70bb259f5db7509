"""`hapscene handle`: identify a handle, show what is known of it, play through it."""

import argparse
import sys
from contextlib import closing
from pathlib import Path
from typing import Any, Final

from hapscene.command.console import name_made, tell, tell_over
from hapscene.command.options import (
    add_command,
    add_group,
    add_out_folder,
    add_pairs,
    add_recording_options,
    base_name,
    baud,
    check_out_folder,
    check_there,
    folder,
    force,
    number,
    rate,
    recording_options,
    seconds,
    seed,
    whole,
)
from hapscene.errors import CaptureError, HandleError, no_such
from hapscene.wire.port import BAUD

# `hapscene handle play`.


def _add_play(commands: Any) -> None:
    command = add_command(commands, "play", _play)
    command.add_argument("file", metavar="FILE", help="a recording of `hapscene touch`, or CSV, WAV, NPZ, MAT, .hsrec")
    command.add_argument(
        "--handle",
        action="append",
        default=[],
        metavar="FILE|NAME",
        help="an identified handle (default: the assumed one); audio, serial or usb: a real one to play on. May be "
        "given once for each",
    )
    add_pairs(command, "--option", "of the real one, as port=/dev/ttyACM0")
    command.add_argument(
        "--grip", type=whole("a grip", 1), metavar="N", help="hold it as in its Nth grip (default: their mean)"
    )
    command.add_argument("--compensator", help="none, naive, inverse, … (default adaptive; flat where none is heard)")
    add_out_folder(command, None, "out/NAME, as out/oak")
    command.add_argument("--seed", type=seed, default=0, help="of the accelerometer's noise (default 0)")
    add_recording_options(command)


def _play(options: argparse.Namespace) -> int:
    """Play an acceleration through the simulated handle, and write what would be felt; or on a real one.

    for example:
      hapscene handle play touch.npz --handle my.handle --out out/felt
      hapscene handle play oak.csv --rate 10000 --units acceleration=m/s2 --compensator inverse --out out/oak
      hapscene handle play tap.wav --units 'acceleration=50 m/s2' --handle my.handle --grip 1 --out out/light
      hapscene handle play oak.csv --rate 10000 --units acceleration=m/s2 --handle audio --option gain=0.01
      hapscene handle play touch.npz --handle my.handle --handle serial --option port=/dev/ttyACM0
    """
    from hapscene.device.driver_registry import DRIVERS

    names = [name for name in options.handle if name in DRIVERS.names()]
    files = [name for name in options.handle if name not in names]
    if max(len(names), len(files)) > 1:
        raise HandleError("--handle may be given once for an identified handle's file, and once for a real one's name")
    options.handle = next(iter(files), None)
    if names:
        return _play_on(names[0], options)
    if options.option:
        raise HandleError("--option needs --handle with the name of a real handle: audio, serial, usb")
    options.compensator = options.compensator or "adaptive"
    if options.handle is None and options.grip is not None:
        raise HandleError("--grip needs --handle: the assumed handle has but one")
    check_there(options.handle, HandleError)
    options.out = options.out or f"out/{base_name(options.file)}"
    check_out_folder(options.out)
    from hapscene.dsp.spectrogram import spectrogram_error
    from hapscene.files import refusing, whole_folder
    from hapscene.handle.compensator import find_compensator
    from hapscene.handle.handle_file import load_handle
    from hapscene.handle.plant import Plant
    from hapscene.handle.playback import play
    from hapscene.handle.playback_report import write_playback, write_wave
    from hapscene.handle.sensor import Sensor

    find_compensator(options.compensator)
    nominal = plant = Plant()
    sensor = Sensor()
    if options.handle is not None:
        handle = load_handle(options.handle)
        nominal = plant = handle.plant
        sensor = handle.sensor
        if options.grip is not None:
            if not 1 <= options.grip <= len(handle.grips):
                raise HandleError(no_such("grip", str(options.grip), map(str, range(1, len(handle.grips) + 1))))
            plant = handle.plant_in(handle.grips[options.grip - 1])
    check_there(options.file, CaptureError)
    desired, rate_Hz = _desired(options)
    with refusing(HandleError, options.file):
        how = {"compensator": options.compensator, "nominal": nominal, "seed": options.seed, "sensor": sensor}
        played = play(desired, rate_Hz, plant, **how)
        error = spectrogram_error(desired, played.acceleration_m_s2, rate_Hz)
    told = f"{Path(options.file).name} by {options.compensator}: spectrogram error {100 * error:.1f} %"
    with whole_folder(options.out) as out:
        full_m_s2 = write_wave(played.acceleration_m_s2, rate_Hz, out / "felt.wav")
        write_playback(desired, played, rate_Hz, plant, told, out / "felt.png")
    tell([told])
    print(f"felt {1e3 * played.latency_s:.1f} ms late; full scale of felt.wav is {full_m_s2:.3g} m/s²")
    if played.hits or played.clips:
        print(f"the coil met a stop {played.hits} times; the force was cut {played.clips} times")
    name_made([Path(options.out) / name for name in ("felt.png", "felt.wav")])
    return 0


def _play_on(name: str, options: argparse.Namespace) -> int:
    """Play on a real handle."""
    from hapscene.handle.live_process import compensator_of, open_output, play_recording, report

    if options.grip is not None or options.out is not None:
        raise HandleError("--grip and --out are of the simulated handle; how a real one is held nobody can tell it")
    check_there(options.handle, HandleError)
    check_there(options.file, CaptureError)
    desired, rate_Hz = _desired(options)
    output = open_output(name, dict(options.option))
    try:
        handle = compensator_of(output, options.handle, options.compensator)
        tell([f"playing {Path(options.file).name}, {len(desired) / rate_Hz:.3g} s, on {output.name}"])
        stream = play_recording(desired, rate_Hz, output, handle)
    finally:
        output.close()
    found = report(stream, output)
    print(f"felt {1e3 * found['latency_s']:.1f} ms after it is asked for")
    if handle is not None and handle[0].kind == 3:
        learnt_g, known_g = 1e3 * handle[0].theta[0], 1e3 * handle[0].nominal[0]
        print(f"learnt while it played: a handle of {learnt_g:.3g} g, where {known_g:.3g} g was identified")
    if found["limited"] > 0:
        share = found["limited"] / (len(desired) / rate_Hz * output.rate_Hz)
        print(f"{100 * share:.1f} % was made quieter: it asks for more than {output.ceiling / output.gain:.3g} allows")
    wrong = [f"{word} {found[word]}" for word in (*output.counts, "clipped", "not_finite") if found[word]]
    if wrong:
        print(f"not all went well: {', '.join(wrong)}")
    return 0


def _desired(options: argparse.Namespace) -> tuple[Any, float]:
    """The acceleration of the file and its rate."""
    from hapscene.capture.io.recording import load_recording
    from hapscene.recording import Recording, RecordingError

    if Path(options.file).suffix == ".npz" and options.rate is None:
        try:
            recording = Recording.load(options.file)
            return recording.a_m_s2.ravel(), recording.a_rate_Hz
        except RecordingError:
            pass  # an npz of another kind, whose fault the next reader tells
    read = load_recording(options.file, **recording_options(options))
    return read.acceleration_m_s2, read.rate_Hz


HZ: Final = "a frequency is a number of Hz"


def add_handle(commands: Any) -> None:
    summary = "the haptography handle: identify one, show it, play an acceleration through it"
    add_group(commands, "handle", summary, _add_identify, _add_show, _add_play)


def _add_identify(commands: Any) -> None:
    command = add_command(commands, "identify", _identify)
    source = command.add_mutually_exclusive_group(required=True)
    source.add_argument("--simulated", action="store_true", help="a simulated handle in a simulated hand")
    source.add_argument("--port", help="a handle on a serial port (docs/handle-protocol.md): /dev/ttyACM0, COM3, …")
    source.add_argument(
        "--from",
        dest="files",
        nargs="+",
        metavar="FILE",
        help="recordings with columns force and acceleration, one for each grip",
    )  # fmt: skip
    command.add_argument(
        "-o", "--out", type=folder, metavar="PATH",
        help="a .handle file; or a folder, for that file, the Bode plot, the responses and the recordings "
        "(default out/NAME, as out/handle)",
    )  # fmt: skip
    command.add_argument(
        "--grips", type=whole("a number of grips"), default=5, metavar="N", help="how many grips to play (default 5)"
    )
    command.add_argument("--name", default="handle", help="of the handle (default: handle)")
    sweep = command.add_argument_group("the sweep")
    sweep.add_argument("--low", type=number(HZ), default=10.0, metavar="HZ", help="where it begins (default 10)")
    sweep.add_argument(
        "--high", type=number(HZ), default=1000.0, metavar="HZ", help="where it ends (default 1000; paper 200)"
    )
    sweep.add_argument("--seconds", type=seconds, default=10.0, metavar="N", help="how long it takes (default 10)")
    sweep.add_argument("--force", type=force, default=1.0, metavar="N", help="largest force [N] (default 1)")
    device = command.add_argument_group("the device")
    device.add_argument("--force-limit", type=force, metavar="N", help="peak force of the actuator [N] (default 6.6)")
    device.add_argument(
        "--travel-limit",
        type=number("a travel is a number of m"),
        metavar="M",
        help="travel of the coil to a stop [m] (default 0.005)",
    )
    device.add_argument("--accelerometer", type=rate, metavar="HZ", help="its bandwidth, one pole (default 1600)")
    device.add_argument("--baud", type=baud, default=BAUD, help=f"speed of the port (default {BAUD})")
    command.add_argument("--seed", type=seed, default=0, help="of the simulated noise and grips (default 0)")
    add_recording_options(command)


def _identify(options: argparse.Namespace) -> int:
    """Play a swept sine through a handle in several grips, and find its parameters, with intervals.

    for example:
      hapscene handle identify --simulated
      hapscene handle identify --port /dev/ttyACM0 --grips 5 --out out/mine
      hapscene handle identify --from a.csv b.csv --rate 10000 --units acceleration=m/s2,force=N -o my.handle
    """
    for file in options.files or ():
        check_there(file, HandleError)
    options.out = options.out or f"out/{options.name}"
    from hapscene.handle.fit import identify
    from hapscene.handle.handle_loop import ACCELEROMETER_HZ
    from hapscene.handle.identification_report import describe_lines, write_result
    from hapscene.handle.plant import Plant
    from hapscene.handle.sweep import Sweep

    given = {"force_limit_N": options.force_limit, "travel_limit_m": options.travel_limit}
    guess = Plant(**{name: value for name, value in given.items() if value is not None})
    sweep = Sweep(options.low, options.high, options.seconds, options.force)
    recordings, provenance = _recordings(options, sweep, guess)
    responses = [recording.response((options.low, options.high)) for recording in recordings]
    names, rate_Hz = [recording.name for recording in recordings], recordings[0].rate_Hz
    bandwidth_Hz = ACCELEROMETER_HZ if options.accelerometer is None else options.accelerometer
    handle = identify(
        responses, rate_Hz, names, guess=guess, accelerometer_Hz=bandwidth_Hz, name=options.name, provenance=provenance
    )
    print("\n".join(describe_lines(handle)))
    name_made(write_result(handle, responses, [] if options.files else recordings, Path(options.out)))
    return 0


def _recordings(options: argparse.Namespace, sweep: Any, guess: Any) -> tuple[list[Any], str]:
    """The recordings of all grips, and where they come from."""
    from dataclasses import replace

    from hapscene.handle.fit import GRIP_MAX
    from hapscene.handle.force_source import SimulatedSource, grip_names, simulated_grips
    from hapscene.handle.measure import load_grips, play_grips

    if options.files:
        recordings = load_grips(options.files, options.rate, options.columns, options.units)
        return recordings, f"from {', '.join(options.files)}"
    if not 1 <= options.grips <= GRIP_MAX:
        raise HandleError(f"--grips must be 1 to {GRIP_MAX}, is {options.grips}")
    told = f"swept sine, {sweep.low_Hz:g} to {sweep.high_Hz:g} Hz, {sweep.sweep_s:g} s, at most {sweep.force_N:g} N"
    if options.simulated:
        grips = simulated_grips(options.grips, options.seed)
        source = SimulatedSource(guess, options.rate or 10_000.0, seed=options.seed)
        if options.accelerometer is not None:
            source.accelerometer_Hz = options.accelerometer

        def hold(i: int) -> None:
            name, k_u, b_u = grips[i]
            source.plant = replace(guess, k_u_N_m=k_u, b_u_Ns_m=b_u)
            print(f"playing grip {name}", flush=True)

        recordings = play_grips(source, sweep, guess, [name for name, _, _ in grips], hold)
        return recordings, f"simulated handle, seed {options.seed}; {told}"
    return _from_port(options, sweep, guess, grip_names(options.grips)), f"handle on {options.port}; {told}"


def _from_port(options: argparse.Namespace, sweep: Any, guess: Any, names: list[str]) -> list[Any]:
    """The sweep played through a real handle, the user told how to hold it."""
    from hapscene.handle.measure import play_grips
    from hapscene.handle.serial_handle import SerialSource

    def share(done: float) -> None:
        if sys.stdout.isatty():
            tell_over(f"{100 * done:3.0f} %")
            if done >= 1.0:
                tell([""])

    def hold(i: int) -> None:
        print(f"grip {names[i]}: hold the handle so, and keep still for {sweep.sweep_s + 1:.0f} s", flush=True)
        if sys.stdin.isatty():
            input("press Enter to play ")

    with closing(SerialSource(options.port, options.baud, share)) as source:
        return play_grips(source, sweep, guess, names, hold)


def _add_show(commands: Any) -> None:
    command = add_command(commands, "show", _show)
    command.add_argument("file", metavar="FILE", help="a .handle file")
    command.add_argument("--json", action="store_true", help="print JSON")


def _show(options: argparse.Namespace) -> int:
    """Tell what is known of a handle: parameters, intervals, grips, coherence.

    for example:
      hapscene handle show my.handle
      hapscene handle show my.handle --json
    """
    check_there(options.file, HandleError)
    from hapscene.handle.handle_file import handle_to_json, load_handle
    from hapscene.handle.identification_report import describe_lines

    handle = load_handle(options.file)
    tell(handle_to_json(handle).rstrip().splitlines() if options.json else describe_lines(handle))
    return 0
