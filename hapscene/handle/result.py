"""What an identification leaves on disk: the handle's file, and on wish the plot, the responses and the recordings."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hapscene.errors import HandleError
from hapscene.handle.bode import modelled, write_bode
from hapscene.handle.handle_file import SUFFIX, save_handle
from hapscene.handle.identification import Identification
from hapscene.handle.measure import GripRecording
from hapscene.handle.response import Response
from hapscene.output import whole_folder


def write_result(
    handle: Identification, responses: Sequence[Response], recordings: Sequence[GripRecording], path: Path
) -> list[Path]:
    """Write the handle's file to `path`; or, where that does not end in .handle, all there is into that folder.

    The folder has NAME.handle, bode.png, response.csv and a grip-N.npz for each recording. Gives what was written.

    Raises:
        HandleError: the file cannot be written, or the handle's name cannot be a file's.
        OSError: the folder cannot be written.
    """
    if path.suffix == SUFFIX:
        save_handle(handle, path)
        return [path]
    name = handle.name + SUFFIX
    if Path(name).name != name:
        raise HandleError(f"{handle.name!r} cannot be the name of a file: give another --name, or -o FILE{SUFFIX}")
    with whole_folder(path) as folder:
        save_handle(handle, folder / name)
        write_bode(handle, responses, folder / "bode.png")
        (folder / "response.csv").write_text(_table(handle, responses), encoding="utf-8", newline="\n")
        for i, recording in enumerate(recordings):
            recording.save(folder / f"grip-{i + 1}.npz")
        made = [path / file.name for file in sorted(folder.iterdir())]
    return made


def _table(handle: Identification, responses: Sequence[Response]) -> str:
    """Measured and modelled response and coherence over frequency, a row for each band and grip."""
    rows = [
        "grip,frequency_Hz,magnitude_m_s2_N,low_m_s2_N,high_m_s2_N,phase_rad,coherence,model_m_s2_N,model_phase_rad"
    ]
    for grip, response in zip(handle.grips, responses, strict=True):
        model = modelled(handle, grip, response.frequency_Hz)
        columns = (
            response.frequency_Hz,
            np.abs(response.response),
            *response.magnitude_interval(),
            np.angle(response.response),
            response.coherence,
            np.abs(model),
            np.angle(model),
        )
        name = '"' + grip.name.replace('"', '""') + '"'
        rows += [",".join([name, *(f"{value:.6g}" for value in row)]) for row in zip(*columns, strict=True)]
    return "\n".join(rows) + "\n"
