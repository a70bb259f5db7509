"""`hapscene handle`: identify a handle, show what is known of it, play through it."""

import argparse
from pathlib import Path
from typing import Any, Final

from hapscene.command.handle_play import add_handle_play
from hapscene.command.recording_option import add_recording_options
from hapscene.command.word import add_command, baud, folder, force, name_made, number, rate, seconds, seed, whole
from hapscene.wire.port import BAUD

HZ: Final = "a frequency is a number of Hz"


def add_handle(commands: Any) -> None:
    """Declare the group and its commands."""
    group = commands.add_parser(
        "handle",
        help="the haptography handle: identify one, show it, play an acceleration through it",
        description="The haptography handle: what it is, and what a hand would feel through it.",
        epilog="hapscene handle COMMAND --help says more.",
    )
    words = group.add_subparsers(required=True, metavar="COMMAND")
    for add in (_add_identify, _add_show, add_handle_play):
        add(words)


def _add_identify(commands: Any) -> None:
    command = add_command(
        commands,
        "identify",
        _identify,
        "play a swept sine through a handle in several grips, and find its parameters, with intervals",
        "hapscene handle identify --simulated --out out/handle",
        "hapscene handle identify --port /dev/ttyACM0 --grips 5 --out out/mine",
        "hapscene handle identify --from a.csv b.csv --rate 10000 --units acceleration=m/s2,force=N -o my.handle",
        "python -m hapscene.handle.port_simulator   # a handle to try --port with, without hardware",
    )
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
        "-o", "--out", required=True, type=folder, metavar="PATH",
        help="a .handle file; or a folder, for that file, the Bode plot, the responses and the recordings",
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
    from hapscene.handle.fit import identify
    from hapscene.handle.loop import ACCELEROMETER_HZ
    from hapscene.handle.plant import Plant
    from hapscene.handle.portrait import lines
    from hapscene.handle.result import write_result
    from hapscene.handle.sweep import Sweep

    given = {"force_limit_N": options.force_limit, "travel_limit_m": options.travel_limit}
    guess = Plant(**{name: value for name, value in given.items() if value is not None})
    sweep = Sweep(options.low, options.high, options.seconds, options.force)
    recordings, provenance = _recordings(options, sweep, guess)
    responses = [recording.response((options.low, options.high)) for recording in recordings]
    handle = identify(
        responses,
        recordings[0].rate_Hz,
        [recording.name for recording in recordings],
        guess,
        ACCELEROMETER_HZ if options.accelerometer is None else options.accelerometer,
        options.name,
        provenance,
    )
    print("\n".join(lines(handle)))
    name_made(write_result(handle, responses, [] if options.files else recordings, Path(options.out)))
    return 0


def _recordings(options: argparse.Namespace, sweep: Any, guess: Any) -> tuple[list[Any], str]:
    """The recordings of all grips, and where they come from."""
    from dataclasses import replace

    from hapscene.errors import HandleError
    from hapscene.handle.fit import GRIP_MAX
    from hapscene.handle.measure import load_grips, play_grips
    from hapscene.handle.source import SimulatedSource, grip_names, simulated_grips

    if options.files:
        return load_grips(
            options.files, options.rate, options.columns, options.units
        ), f"from {', '.join(options.files)}"
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
    import sys
    from contextlib import closing

    from hapscene.handle.measure import play_grips
    from hapscene.handle.port import PortSource

    def share(done: float) -> None:
        if sys.stdout.isatty():
            print(f"\r{100 * done:3.0f} %", end="" if done < 1.0 else "\n", flush=True)

    def hold(i: int) -> None:
        print(f"grip {names[i]}: hold the handle so, and keep still for {sweep.sweep_s + 1:.0f} s", flush=True)
        if sys.stdin.isatty():
            input("press Enter to play ")

    with closing(PortSource(options.port, options.baud, share)) as source:
        return play_grips(source, sweep, guess, names, hold)


def _add_show(commands: Any) -> None:
    command = add_command(
        commands,
        "show",
        _show,
        "tell what is known of a handle: parameters, intervals, grips, coherence",
        "hapscene handle show my.handle",
        "hapscene handle show my.handle --json",
    )
    command.add_argument("file", metavar="FILE", help="a .handle file")
    command.add_argument("--json", action="store_true", help="print JSON")


def _show(options: argparse.Namespace) -> int:
    from hapscene.handle.handle_file import handle_to_json, load_handle
    from hapscene.handle.portrait import lines

    handle = load_handle(options.file)
    print(handle_to_json(handle).rstrip() if options.json else "\n".join(lines(handle)))
    return 0
