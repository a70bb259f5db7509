"""Many files of the Penn Haptic Texture Toolkit at once: paired, imported, the broken ones named."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

from hapscene.capture.hatt import import_noted
from hapscene.capture.xml_source import root_name
from hapscene.errors import HapsceneError, SwatchError
from hapscene.surface.swatch_file import SUFFIX, save_swatch


@dataclass
class Outcome:
    """What became of a batch: the swatches made, and one sentence for each file that was not."""

    made: list[Path] = field(default_factory=list)
    broken: list[str] = field(default_factory=list)


def import_many(
    files: Iterable[str | Path],
    folder: str | Path,
    say: Callable[[str], None] = lambda line: None,
    outcome: Outcome | None = None,
) -> Outcome:
    """Imports models files with the taps files of the same name, into `folder`/<name>.swatch.

    `Models_X.xml` and `Taps_X.xml` belong together; a single one of each does whatever its name. A folder stands for
    the .xml files in it. Each swatch is written whole or not at all; a broken file stops none of the others.

    Args:
        files: XML files and folders.
        folder: where the swatches go; made where it is missing.
        say: told a line for each swatch, and a second one where models with zeros were turned into models without.
        outcome: filled in as the batch goes on, for a caller that may be interrupted; None for a new one.

    Raises:
        SwatchError: the folder cannot be made.
    """
    outcome = Outcome() if outcome is None else outcome
    pairs = _pairs(files, outcome)
    target = Path(folder)
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SwatchError(f"{target}: cannot be made: {error.strerror or error}") from None
    taken: dict[str, Path] = {}
    for i, (name, (models, taps)) in enumerate(pairs, 1):
        path = target / (name + SUFFIX)
        try:
            if path.name.casefold() in taken:
                raise SwatchError(f"{models}: would be {path.name}, as {taken[path.name.casefold()]}: another folder?")
            taken[path.name.casefold()] = models
            swatch, converted = import_noted(models, taps)
            save_swatch(swatch, path)
        except HapsceneError as error:
            outcome.broken.append(str(error))
            say(f"{i}/{len(pairs)}  {models.name}: broken")
            continue
        outcome.made.append(path)
        say(f"{i}/{len(pairs)}  {models.name} → {path.name}")
        if converted:
            say(f"  {converted}")
    return outcome


def _pairs(files: Iterable[str | Path], outcome: Outcome) -> list[tuple[str, tuple[Path, Path | None]]]:
    """(name, (models file, its taps file or None)) in the order given."""
    paths: list[Path] = []
    for file in map(Path, files):
        paths += sorted(file.glob("*.xml")) if file.is_dir() else [file]
    models: list[Path] = []
    taps: list[Path] = []
    for path in dict.fromkeys(paths):
        try:
            kind = root_name(path)
        except HapsceneError as error:
            outcome.broken.append(str(error))
            continue
        if kind not in ("modelSet", "tapSet"):
            outcome.broken.append(f"{path}: the root element: expected <modelSet> or <tapSet>, found <{kind}>")
            continue
        (models if kind == "modelSet" else taps).append(path)
    if len(models) == len(taps) == 1:
        return [(_key(models[0]), (models[0], taps[0]))]
    by_place = {(path.parent, _key(path)): path for path in taps}
    by_name = {_key(path): path for path in taps}
    pairs = []
    for path in models:
        partner = by_place.get((path.parent, _key(path)), by_name.get(_key(path)))
        if partner in taps:
            taps.remove(partner)
        pairs.append((_key(path), (path, partner)))
    outcome.broken += [f"{path}: expected Models_{_key(path)}.xml among the files, found none" for path in taps]
    return pairs


def _key(path: Path) -> str:
    """What a file is called without the toolkit's prefix."""
    return path.stem.removeprefix("Models_").removeprefix("Taps_") or path.stem
