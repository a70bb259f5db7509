"""An XML file from a stranger, read element by element with errors that name the place.

No entity is expanded, no other file or address is opened, sizes are capped.
"""

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hapscene.errors import SwatchError

Array = NDArray[np.float64]

BYTES_MAX: Final = 8 * 1024 * 1024
"""Largest file that is read [bytes]. Those of the Penn toolkit have 20 to 300 kB. The worst of this size, empty
elements alone, takes 260 MB to open."""


class XmlSource:
    """One file's elements, read with errors that name the file and the element."""

    def __init__(self, path: Path, root: str) -> None:
        self.path = path
        self.root = _parsed(path)
        if element_name(self.root) != root:
            raise self.error("the root element", f"<{root}>", f"<{element_name(self.root)}>")

    def error(self, where: str, expected: str, found: str) -> SwatchError:
        return SwatchError(f"{self.path}: {where}: expected {expected}, found {found}")

    def children(self, name: str, within: Any = None) -> list[Any]:
        return [child for child in (self.root if within is None else within) if element_name(child) == name]

    def text(self, name: str, within: Any = None) -> str | None:
        found = self.children(name, within)
        return " ".join("".join(found[0].itertext()).split()) if found else None

    def number(self, name: str, where: str = "", within: Any = None) -> float | None:
        """The number in the element, or None where the element is missing or empty."""
        text = self.text(name, within)
        return None if not text else self.value(text, f"{where}<{name}>")

    def required(self, name: str, where: str = "", within: Any = None) -> float:
        value = self.number(name, where, within)
        if value is None:
            raise self.error(f"{where}<{name}>", "a number", "nothing")
        return value

    def value(self, text: str, where: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = np.nan
        if not np.isfinite(value) or abs(value) > 1e100:
            raise self.error(where, "a finite number", repr(text[:40]))
        return value

    def numbers(self, element: Any, where: str, most: int) -> Array:
        """The numbers of an element: one in each `value`, or all in its text."""
        values = self.children("value", element)
        texts = ["".join(v.itertext()).strip() for v in values] or "".join(element.itertext()).split()
        if len(texts) > most:
            raise self.error(where, f"at most {most} numbers", f"{len(texts)}")
        return np.array([self.value(text, f"{where}, value {i}") for i, text in enumerate(texts, 1)])

    def listed(self, name: str, within: Any = None, where: str = "", most: int = 4096) -> Array:
        """The numbers of the element of that name; none where it is missing."""
        found = self.children(name, within)
        return self.numbers(found[0], f"{where}<{name}>", most) if found else np.empty(0)


def root_name(path: str | Path) -> str:
    """The name of a file's root element: "modelSet" or "tapSet" in files of the Penn toolkit."""
    return element_name(_parsed(Path(path)))


def _parsed(path: Path) -> Any:
    """The root element of a file, parsed without entities, network or huge trees."""
    from lxml import etree

    try:
        if not path.is_file():
            raise SwatchError(f"{path}: is no file" if path.exists() else f"{path}: no such file")
        with path.open("rb") as f:
            data = f.read(BYTES_MAX + 1)
    except OSError as error:
        raise SwatchError(f"{path}: cannot be read: {error.strerror or error}") from None
    if len(data) > BYTES_MAX:
        raise SwatchError(f"{path}: larger than {BYTES_MAX >> 20} MiB, which no file of the toolkit is")
    if b"<!DOCTYPE" in data.replace(b"\0", b""):  # before the parser sees it, in UTF-16 too
        raise SwatchError(f"{path}: has a DOCTYPE, which files of the toolkit have not; it is not read")
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, huge_tree=False, load_dtd=False, remove_comments=True, remove_pis=True
    )
    try:
        root = etree.fromstring(data, parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        raise SwatchError(f"{path}: not XML: {' '.join(str(error).split())[:200]}") from None
    if root is None or root.getroottree().docinfo.doctype:
        raise SwatchError(f"{path}: has a DOCTYPE or nothing in it; it is not read")
    return root


def element_name(element: Any) -> str:
    """An element's name without its namespace; "" for what is no element."""
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""
