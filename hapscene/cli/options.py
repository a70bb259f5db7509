"""Types of option values, and groups of options that several commands share."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from cyclopts import Parameter
from cyclopts.validators import Number

from hapscene.cli.inputs import check_out_folder, check_swatch, check_there
from hapscene.errors import DeviceError, HapsceneError, no_such

if TYPE_CHECKING:
    from cyclopts import Token

    from hapscene.device.driver_registry import DeviceChoice

__all__ = [
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
    "TipRadius",
    "Vector",
    "WorkerOptions",
]

LOCALHOST: Final = "127.0.0.1"

HOST: Final = (
    "Address to serve the page at; 0.0.0.0 admits other devices of the network. Anyone with the address can use "
    "the page without a password; in the painter that includes writing to any file that you may write."
)


def Help(text: str) -> Parameter:
    """The help text of an option: a noun phrase with its unit. The help page adds the default."""
    return Parameter(help=text)


def comma_separated(kind: Callable[[str], object]) -> Callable[[object, Sequence["Token"]], tuple[object, ...]]:
    """Return a converter of text such as "1000,5000" to distinct values of type `kind`."""

    def values(type_: object, tokens: Sequence["Token"]) -> tuple[object, ...]:
        parts = [part.strip() for part in tokens[0].value.split(",")]
        if not all(parts):
            raise ValueError(f"expected values separated by commas, got {tokens[0].value!r}")
        return tuple(dict.fromkeys(kind(part) for part in parts))

    return values


def _pairs(type_: object, tokens: Sequence["Token"]) -> dict[str, str]:
    """Convert text such as "force=N,speed=mm/s" to a dictionary."""
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
Vector = Annotated[tuple[float, float, float] | None, Parameter(validator=Number(gt=-math.inf, lt=math.inf))]
Numbers = Annotated[tuple[float, ...], Parameter(converter=comma_separated(float), n_tokens=1, metavar="NUMBER,…")]
Counts = Annotated[tuple[int, ...], Parameter(converter=comma_separated(int), n_tokens=1, metavar="COUNT,…")]
Names = Annotated[tuple[str, ...], Parameter(converter=comma_separated(str), n_tokens=1, metavar="NAME,…")]
Pairs = Annotated[
    dict[str, str] | None,
    Parameter(converter=_pairs, n_tokens=-1, accepts_keys=False, metavar="NAME=VALUE,…"),
]


def _check(check: Callable[[str | Path], None]) -> Parameter:
    """Return a parameter that checks each path of an option before the command runs."""

    def each(type_: object, value: Any) -> None:
        for path in value if isinstance(value, (list, tuple)) else [value]:
            if path is not None:
                check(path)

    return Parameter(validator=each)


InFile = Annotated[Path, _check(check_there)]
InFiles = Annotated[list[str], _check(check_there), Parameter(consume_multiple=True, metavar="FILE…")]
InFolder = Annotated[Path, _check(partial(check_there, what="folder")), Parameter(metavar="FOLDER")]
InPaths = Annotated[list[str], _check(partial(check_there, what="file or folder"))]
SwatchName = Annotated[str, _check(check_swatch), Help("Name of a swatch, or .swatch file.")]
OutFile = Annotated[Path | None, Parameter(alias="-o")]
OutFolder = Annotated[
    Path, _check(check_out_folder), Parameter(alias="-o", metavar="FOLDER", help="Folder for the results.")
]
Dark = Annotated[bool, Help("Use a dark background for pictures.")]
Table = Annotated[InFile | None, Parameter(name="--from", help="Table of an earlier run to draw, without measuring.")]
TipRadius = Annotated[
    float, Parameter(validator=Number(gte=0.0, lte=1.0), help="Radius of the round tip of the tool [m]; 0 for a point.")
]
Seed = Annotated[Count, Help("Seed of the random number generator.")]
Device = Annotated[str, Help("Simulated device: omni, phantom-1.0 or premium-1.5.")]
Grip = Annotated[str, Help("Grip of the simulated hand: light, medium or firm.")]
Compensator = Annotated[str, Help("Compensator of the handle: adaptive, flat, inverse, naive or none.")]


@Parameter(name="*", group="Mesh files")
@dataclass(frozen=True)
class ReadOptions:
    """Options for reading a mesh file."""

    unit: Annotated[str | None, Help("Unit of length, if the file does not store it: m, cm, mm, um, in, ft")] = None
    up: Annotated[Literal["y", "z"] | None, Help("Up axis of the file (default: y in glTF, else z)")] = None
    scale: Annotated[Positive, Help("Scale factor")] = 1.0

    def reading(self) -> dict[str, Any]:
        """The keyword arguments of the mesh reader, without the unit."""
        return {"up": self.up, "scale": self.scale}


@Parameter(name="*", group="Mesh files")
@dataclass(frozen=True)
class MeshOptions(ReadOptions):
    """Options for reading a mesh file and for its surface."""

    swatch: Annotated[str | None, Help("Swatch of the whole mesh: a name, or a .swatch file")] = None
    two_sided: Annotated[bool, Help("Render contact on the inner side of the mesh as well")] = False


@Parameter(name="*", group="Recordings: properties that the file does not store")
@dataclass(frozen=True)
class RecordingOptions:
    """Properties of a recording that its file does not store."""

    rate: Annotated[Positive | None, Help("Sample rate [Hz]")] = None
    columns: Annotated[Pairs, Help("Column of each quantity, as in acceleration=accel,speed=v")] = None
    units: Annotated[Pairs, Help("Unit of each quantity, as in acceleration=g,force=N,speed=mm/s")] = None

    def reading(self) -> dict[str, Any]:
        """The keyword arguments of `load_recording`."""
        return {"rate_Hz": self.rate, "columns": self.columns or {}, "units": self.units or {}}


@Parameter(name="*", group="Parallel processes")
@dataclass(frozen=True)
class WorkerOptions:
    """Processes that work is distributed to."""

    jobs: Annotated[Count | None, Help("Number of processes on this computer (default: one per core)")] = None
    scheduler: Annotated[str | None, Help("Address of a Dask scheduler to use instead, as tcp://host:8786")] = None

    def __post_init__(self) -> None:
        if self.jobs is not None and self.scheduler is not None:
            raise HapsceneError("--jobs and --scheduler exclude each other: use --jobs for processes on this computer")


@Parameter(name="*", group="Page in the browser")
@dataclass(frozen=True)
class PageOptions:
    """Options of a page that is served to the browser."""

    port: Annotated[Port, Help("TCP port; 0 selects a free one")] = 0
    host: Annotated[str, Help(HOST)] = LOCALHOST
    no_browser: Annotated[bool, Help("Print the address of the page without opening a browser")] = False


@Parameter(name="*", group="Vibration output")
@dataclass(frozen=True)
class OutputOptions:
    """The output that plays the acceleration channel."""

    handle: Annotated[str | None, Help("Driver of the output: audio, serial or usb")] = None
    handle_option: Annotated[Pairs, Help("Options of that driver, as in port=/dev/ttyACM0")] = None
    handle_file: Annotated[Path | None, Help("Handle file of `device identify`, for its compensator")] = None

    def chosen(self) -> "DeviceChoice | None":
        """The chosen output, or None.

        Raises:
            DeviceError: no driver of a vibration output has that name, or an option is invalid.
        """
        from hapscene.device.driver_registry import DRIVERS, DeviceChoice

        if self.handle is None:
            return None
        outputs = [name for name, offer in DRIVERS.listed().items() if offer.plugin and offer.plugin.open_handle]
        if self.handle not in outputs:
            raise DeviceError(no_such("vibration output", self.handle, outputs))
        choice = DeviceChoice(self.handle, self.handle_option or {})
        choice.checked(handle=True)
        return choice
