"""`hapscene handle play`."""

import argparse
from pathlib import Path
from typing import Any

from hapscene.command.recording_option import add_recording_options, recording_options
from hapscene.command.word import add_command, folder, name_made, seed, whole


def add_handle_play(commands: Any) -> None:
    command = add_command(
        commands,
        "play",
        _play,
        "play an acceleration through the simulated handle, and write what would be felt",
        "hapscene handle play touch.npz --handle my.handle --out out/felt",
        "hapscene handle play oak.csv --rate 10000 --units acceleration=m/s2 --compensator inverse --out out/oak",
        "hapscene handle play tap.wav --units 'acceleration=50 m/s2' --handle my.handle --grip 1 --out out/light",
    )
    command.add_argument("file", metavar="FILE", help="a recording of `hapscene touch`, or CSV, WAV, NPZ, MAT, .hsrec")
    command.add_argument("--handle", metavar="FILE", help="an identified handle (default: the assumed one)")
    command.add_argument(
        "--grip", type=whole("a grip", 1), metavar="N", help="hold it as in its Nth grip (default: their mean)"
    )
    command.add_argument("--compensator", default="adaptive", help="none, naive, inverse, … (default adaptive)")
    command.add_argument("--out", required=True, type=folder, metavar="DIR", help="folder to write into")
    command.add_argument("--seed", type=seed, default=0, help="of the accelerometer's noise (default 0)")
    add_recording_options(command)


def _play(options: argparse.Namespace) -> int:
    from hapscene.errors import HandleError, no_such
    from hapscene.handle.feel import write_feel, write_wave
    from hapscene.handle.handle_file import load_handle
    from hapscene.handle.plant import Plant
    from hapscene.handle.playback import play
    from hapscene.handle.spectrogram import spectrogram_error
    from hapscene.output import whole_folder

    nominal = plant = Plant()
    if options.handle is not None:
        handle = load_handle(options.handle)
        nominal = plant = handle.plant
        if options.grip is not None:
            if not 1 <= options.grip <= len(handle.grips):
                raise HandleError(no_such("grip", str(options.grip), map(str, range(1, len(handle.grips) + 1))))
            plant = handle.plant_in(handle.grips[options.grip - 1])
    elif options.grip is not None:
        raise HandleError("--grip needs --handle: the assumed handle has but one")
    desired, rate_Hz = _desired(options)
    played = play(desired, rate_Hz, plant, options.compensator, nominal, options.seed)
    error = spectrogram_error(desired, played.acceleration_m_s2, rate_Hz)
    told = f"{Path(options.file).name} by {options.compensator}: spectrogram error {100 * error:.1f} %"
    with whole_folder(options.out) as out:
        full_m_s2 = write_wave(played.acceleration_m_s2, rate_Hz, out / "felt.wav")
        write_feel(desired, played, rate_Hz, plant, told, out / "felt.png")
    print(told)
    print(f"felt {1e3 * played.latency_s:.1f} ms late; full scale of felt.wav is {full_m_s2:.3g} m/s²")
    if played.hits or played.clips:
        print(f"the coil met a stop {played.hits} times; the force was cut {played.clips} times")
    name_made([Path(options.out) / name for name in ("felt.png", "felt.wav")])
    return 0


def _desired(options: argparse.Namespace) -> tuple[Any, float]:
    """The acceleration of the file and its rate."""
    from hapscene.capture.recording_file import load_surface_recording
    from hapscene.recording import Recording, RecordingError

    if Path(options.file).suffix == ".npz" and options.rate is None:
        try:
            recording = Recording.load(options.file)
            return recording.a_m_s2.ravel(), recording.a_rate_Hz
        except RecordingError:
            pass  # an npz of another kind, whose fault the next reader tells
    read = load_surface_recording(options.file, **recording_options(options))
    return read.acceleration_m_s2, read.rate_Hz
