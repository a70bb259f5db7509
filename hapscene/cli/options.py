"""Kinds of option values, and the groups of options that several commands share."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from hapscene.cli.paths import check_out_folder, check_swatch, check_there
from hapscene.errors import HapsceneError

if TYPE_CHECKING:
    from cyclopts import Token

    from hapscene.device.driver_registry import DeviceChoice

__all__ = [
    "AsJson",
    "Compensator",
    "Count",
    "Counts",
    "Dark",
    "Device",
    "Grip",
    "Help",
    "InFile",
    "InFiles",
    "InFolder",
    "InPaths",
    "MeshOptions",
    "Names",
    "Numbers",
    "OutFile",
    "OutFolder",
    "OutputOptions",
    "PageOptions",
    "Pairs",
    "Port",
    "Positive",
    "ReadOptions",
    "RecordingOptions",
    "Seed",
    "SwatchName",
    "Table",
    "Vector",
    "WorkerOptions",
]

LOCALHOST: Final = "127.0.0.1"

HOST: Final = (
    "Address to serve at; 0.0.0.0 for other devices in the same network: whoever has the printed address may use the "
    "page, without a password. In the painter that includes saving and exporting to any file that you may write."
)


def Help(text: str) -> Parameter:
    """The help of an option: a noun phrase, and its unit. The default is added where it is not in the text."""
    return Parameter(help=text)


def comma_separated(kind: Callable[[str], Any]) -> Callable[[Any, Sequence["Token"]], tuple[Any, ...]]:
    """A converter of "1000,5000" to values of a kind, each once."""

    def values(type_: Any, tokens: Sequence["Token"]) -> tuple[Any, ...]:
        parts = [part.strip() for part in tokens[0].value.split(",")]
        if not all(parts):
            raise ValueError(f"expected values separated by commas, got {tokens[0].value!r}")
        return tuple(dict.fromkeys(kind(part) for part in parts))

    return values


def _pairs(type_: Any, tokens: Sequence["Token"]) -> dict[str, str]:
    """Pairs as in "force=N,speed=mm/s"."""
    found: dict[str, str] = {}
    for item in (item for token in tokens for item in token.value.split(",")):
        key, _, value = (part.strip() for part in item.partition("="))
        if not (key and value) or key in found:
            raise ValueError(f"expected NAME=VALUE, each name once, as in force=N,speed=mm/s, got {item!r}")
        found[key] = value
    return found


Positive = Annotated[float, Parameter(validator=Number(gt=0.0, lt=math.inf))]
Count = Annotated[int, Parameter(validator=Number(gte=0))]
Port = Annotated[int, Parameter(validator=Number(gte=0, lte=65535))]
Vector = tuple[float, float, float] | None
Numbers = Annotated[tuple[float, ...], Parameter(converter=comma_separated(float), n_tokens=1, metavar="NUMBER,…")]
Counts = Annotated[tuple[int, ...], Parameter(converter=comma_separated(int), n_tokens=1, metavar="COUNT,…")]
Names = Annotated[tuple[str, ...], Parameter(converter=comma_separated(str), n_tokens=1, metavar="NAME,…")]
Pairs = Annotated[
    dict[str, str] | None,
    Parameter(converter=_pairs, n_tokens=-1, accepts_keys=False, metavar="NAME=VALUE,…"),
]


def _check(check: Callable[[str | Path], None]) -> Parameter:
    """A check of each path of an option, before the command runs."""

    def each(type_: Any, value: Any) -> None:
        for path in value if isinstance(value, (list, tuple)) else [value]:
            if path is not None:
                check(path)

    return Parameter(validator=each)


InFile = Annotated[Path, _check(check_there)]
InFiles = Annotated[list[str], _check(check_there), Parameter(consume_multiple=True, metavar="FILE…")]
InFolder = Annotated[Path, _check(partial(check_there, what="folder")), Parameter(metavar="FOLDER")]
InPaths = Annotated[list[str], _check(partial(check_there, what="file or folder"))]
SwatchName = Annotated[str, _check(check_swatch), Help("Swatch: a name, or a .swatch file.")]
OutFile = Annotated[Path | None, Parameter(alias="-o")]
OutFolder = Annotated[
    Path, _check(check_out_folder), Parameter(alias="-o", metavar="FOLDER", help="Folder for the results.")
]
AsJson = Annotated[bool, Parameter(name="--json", help="Print JSON.")]
Dark = Annotated[bool, Help("Draw pictures on a dark background.")]
Table = Annotated[InFile | None, Parameter(name="--from", help="Draw this table of an earlier run; measure nothing.")]
Seed = Annotated[Count, Help("Seed of the random numbers.")]
Device = Annotated[str, Help("Simulated device: omni, phantom-1.0 or premium-1.5.")]
Grip = Annotated[str, Help("Grip of the hand: light, medium or firm.")]
Compensator = Annotated[str, Help("Compensator of the handle: adaptive, flat, inverse, naive, none.")]


@Parameter(name="*", group="Mesh files")
@dataclass(frozen=True)
class ReadOptions:
    """How a mesh file is read."""

    unit: Annotated[str | None, Help("Unit of a mesh whose file carries none: m, cm, mm, um, in, ft")] = None
    up: Annotated[Literal["y", "z"] | None, Help("Axis that points up (default: y in glTF, else z)")] = None
    scale: Annotated[Positive, Help("Scale factor")] = 1.0
    accept_damaged: Annotated[bool, Help("Load what is readable of a damaged STEP file")] = False

    def reading(self) -> dict[str, Any]:
        """The keyword arguments of a reader, apart from the unit."""
        return {"up": self.up, "scale": self.scale, "accept_damaged": self.accept_damaged}


@Parameter(name="*", group="Mesh files")
@dataclass(frozen=True)
class MeshOptions(ReadOptions):
    """How a mesh file is read, and what its surface is."""

    swatch: Annotated[str | None, Help("Swatch of the whole mesh: a name, or a .swatch file")] = None
    two_sided: Annotated[bool, Help("Feel the inner side of the mesh as well")] = False


@Parameter(name="*", group="Recordings: what their files do not say")
@dataclass(frozen=True)
class RecordingOptions:
    """What a recording's file does not say."""

    rate: Annotated[Positive | None, Help("Sample rate [Hz]")] = None
    columns: Annotated[Pairs, Help("Column of each quantity, as in acceleration=accel,speed=v")] = None
    units: Annotated[Pairs, Help("Unit of each quantity, as in acceleration=g,force=N,speed=mm/s")] = None

    def reading(self) -> dict[str, Any]:
        """The keyword arguments of `load_recording`."""
        return {"rate_Hz": self.rate, "columns": self.columns or {}, "units": self.units or {}}


@Parameter(name="*", group="Processes")
@dataclass(frozen=True)
class WorkerOptions:
    """Where work is done in parallel."""

    jobs: Annotated[Count | None, Help("Number of processes on this computer (default: one per core)")] = None
    scheduler: Annotated[str | None, Help("Dask cluster to work on instead, as tcp://host:8786")] = None

    def __post_init__(self) -> None:
        if self.jobs is not None and self.scheduler is not None:
            raise HapsceneError("--jobs is for processes here, --scheduler for a cluster: give one of the two")


@Parameter(name="*", group="Page in the browser")
@dataclass(frozen=True)
class PageOptions:
    """Where a page is served."""

    port: Annotated[Port, Help("Port; 0 for any free one")] = 0
    host: Annotated[str, Help(HOST)] = LOCALHOST
    no_browser: Annotated[bool, Help("Print the address, and open no browser")] = False


@Parameter(name="*", group="Output of the vibrations")
@dataclass(frozen=True)
class OutputOptions:
    """What plays the acceleration channel."""

    handle: Annotated[str | None, Help("Output: audio, serial or usb")] = None
    handle_option: Annotated[Pairs, Help("Options of the output's driver, as port=/dev/ttyACM0")] = None
    handle_file: Annotated[Path | None, Help("Handle file of `hapscene device identify`, for its compensator")] = None

    def chosen(self) -> "DeviceChoice | None":
        """The output. Raises DeviceError where it is unknown."""
        from hapscene.device.driver_registry import DeviceChoice

        if self.handle is None:
            return None
        choice = DeviceChoice(self.handle, self.handle_option or {})
        choice.checked(handle=True)
        return choice
