"""Generates the pages of the web site that have no file in docs/; mkdocs.yml registers this file as a hook.

The README is the first page. The reference of commands, effects, drivers and the Python API is generated from the
code. `make docs` builds the site.
"""

import contextlib
import io
import os
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

from griffe import Extension, Object
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

import hapscene
from hapscene.cli import app, main
from hapscene.device.driver_registry import DRIVERS
from hapscene.surface.effect import EFFECTS
from hapscene.swatches.library import load_swatch, shipped_swatches
from hapscene.swatches.site import touch_page

ROOT = Path(__file__).resolve().parents[1]

DOCUMENTS = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "RELEASING.md": "releasing.md",
    "SECURITY.md": "security.md",
    "CODE_OF_CONDUCT.md": "code-of-conduct.md",
    "CHANGELOG.md": "changelog.md",
}
"""Documents outside docs/, and the names of their pages."""

PICTURE = re.compile(r'<picture>\s*<source [^>]*srcset="([^"]+)">\s*<img src="([^"]+)"([^>]*)>\s*</picture>')

SOUND = re.compile(r"\[sound]\(gallery/(\w+)\.wav\)")
"""Link of the gallery to a sound, which the site follows by a link to a page to touch."""

SHARED_LINE = re.compile(r"^    (\w+(?:, \w+)+): (.+(?:\n {5,}.+)*)", re.MULTILINE)
"""A line in a section of a docstring that describes several names, as in `low_m, high_m: corners`."""


class SharedLine(Extension):
    """Makes griffe, which reads the docstrings, repeat a shared line for each name, so that each name has its type."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        if obj.docstring:
            obj.docstring.value = SHARED_LINE.sub(
                lambda line: "\n".join(f"    {name}: {line[2]}" for name in line[1].split(", ")), obj.docstring.value
            )


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages."""
    for document, page in DOCUMENTS.items():
        text = (ROOT / document).read_text(encoding="utf-8")
        files.append(File.generated(config, page, content=linked(text)))
    for page, text in (("cli", command_page()), ("effects", effect_page()), ("drivers", driver_page())):
        files.append(File.generated(config, f"reference/{page}.md", content=text))
    for name in shipped_swatches():
        content = touch_page(load_swatch(name))
        files.append(File.generated(config, f"results/gallery/{name}-touch.html", content=content))
    modules = public_modules()
    home: dict[int, str] = {}
    for module in modules:
        content = module_page(module, modules, home)
        files.append(File.generated(config, f"reference/{module.__name__}.md", content=content))
    reference = next(section["Reference"] for section in config.nav or () if "Reference" in section)
    reference.append({"Python API": [{m.__name__: f"reference/{m.__name__}.md"} for m in modules]})
    return files


def linked(text: str) -> str:
    """Adapt the links of a document of the root to the site; a link to a file without a page becomes code."""
    text = re.sub(r'(?<=[("])docs/', "", text)
    for document, page in DOCUMENTS.items():
        text = text.replace(f"]({document})", f"]({page})")
    return re.sub(r"\[([^]]+)\]\((?!\w+://)([^)#]+)(?<!\.md)\)", r"`\1`", text)


def command_page() -> str:
    """Return the page of the command line: the help of each command."""
    parts = ["# Command line", "The output of `hapscene COMMAND --help` for each command."]
    with environment(COLUMNS="100"):
        for words in commands():
            name = " ".join(("hapscene", *words))
            output = io.StringIO()
            with contextlib.redirect_stdout(output):
                main([*words, "--help"])
            parts.append(f"{'#' * min(2 + (len(words) > 1), 3)} {name}\n\n```text\n{output.getvalue().strip()}\n```")
    return "\n\n".join(parts) + "\n"


def commands(parents: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Iterate over the command, its groups and all commands below it."""
    yield parents
    tree = app()
    for name in parents:
        tree = tree[name]
    for name in tree:
        if not name.startswith("-"):
            yield from commands((*parents, name))


@contextlib.contextmanager
def environment(**variables: str) -> Iterator[None]:
    """Set environment variables for a while."""
    before = dict(os.environ)
    os.environ.update(variables)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def effect_page() -> str:
    """Return the page of the effects that come with hapscene."""
    parts = [
        "# Effects",
        "An effect adds force and acceleration samples in each haptic tick. A swatch sets the parameters of a contact "
        "effect. `Renderer(settings={NAME: {…}})` sets the parameters of a scene effect (a field or a fixture), which "
        "acts also where nothing is touched. See [Write an effect](../tutorials/write-an-effect.md) and "
        "[Add fields and fixtures](../how-to/add-fields-and-fixtures.md).",
    ]
    for name, offer in EFFECTS.listed().items():
        effect = offer.plugin
        if offer.distribution != "hapscene" or effect is None:
            continue
        scope = "Scene effect" if effect.scope == "scene" else "Contact effect"
        more = f" Array settings: {', '.join(f'`{array}`' for array in effect.arrays)}." if effect.arrays else ""
        parts.append(f"## {name}\n\n{effect.summary} {scope}.{more}")
        rows = [f"| `{p.name}` | {p.default:g} | {p.unit} | {cell(p.meaning)} |" for p in effect.params]
        if rows:
            parts.append("\n".join(["| parameter | default | unit | meaning |", "|---|---|---|---|", *rows]))
    return "\n\n".join(parts) + "\n"


def driver_page() -> str:
    """Return the page of the device drivers that come with hapscene: what each driver declares."""
    parts = [
        "# Device drivers",
        "What each driver declares. No driver has been confirmed on hardware yet: each was tested against an emulator, "
        "and the assumptions below have not been checked on a real device. Pass options as `--option NAME=VALUE`. "
        "[Set up a device](../how-to/set-up-a-device.md) has the steps.",
    ]
    for name, offer in DRIVERS.listed().items():
        driver = offer.plugin
        if offer.distribution != "hapscene" or driver is None:
            continue
        parts.append(f"## {name}\n\n{driver.summary}")
        facts = [f"- Requires: {driver.needs}"] if driver.needs else []
        if driver.model is not None and driver.force:
            limits = driver.model.limits
            facts.append(f"- Maximum force: {limits.force_N:g} N; continuous: {driver.continuous_N:g} N")
            facts.append(f"- Stiffest wall: {limits.stiffness_N_m:g} N/m")
        if driver.watchdog_s < 1e9:
            facts.append(f"- The device's own watchdog ends the force after {driver.watchdog_s:g} s")
        if driver.release is not None:
            facts.append("- If the driver's process dies, the watchdog opens the device again and sends zero force")
        if driver.assumptions:
            facts.append("- Assumptions:\n" + "\n".join(f"    - {text}" for text in driver.assumptions))
        parts.append("\n".join(facts))
        rows = [f"| `{o.name}` | {cell(o.default)} | {cell(o.meaning)} |" for o in driver.options]
        if rows:
            parts.append("\n".join(["| option | default | meaning |", "|---|---|---|", *rows]))
    return "\n\n".join(part for part in parts if part) + "\n"


def cell(value: object) -> str:
    """Return a value as the text of a table's cell."""
    return "" if value is None else str(value).replace("|", "\\|")


def public_modules() -> list[ModuleType]:
    """Return hapscene, its public modules that have an `__all__`, and the module of errors."""
    found = [getattr(hapscene, name) for name in sorted(hapscene.__all__)]
    modules = [value for value in found if isinstance(value, ModuleType) and getattr(value, "__all__", None)]
    return [hapscene, *modules, import_module("hapscene.errors")]


def module_page(module: ModuleType, modules: list[ModuleType], home: dict[int, str]) -> str:
    """Return the page of a module: its docstring, then each public name except other modules.

    A name that is public in two modules is described once; `home` maps the identity of each described object to its
    path.
    """
    parts = [f"::: {module.__name__}\n    options: {{heading_level: 1, members: false, show_root_full_path: true}}"]
    for name in module.__all__:
        path, value = f"{module.__name__}.{name}", getattr(module, name)
        if isinstance(value, ModuleType):
            if value not in modules:
                parts.append(f"::: {path}\n    options: {{filters: ['!^_', '!^({'|'.join(module.__all__)})$']}}")
            continue
        first = home.setdefault(id(value), path) if isinstance(value, type | FunctionType) else path
        parts.append(f"::: {path}" if first == path else f"## {name} {{#{path}}}\nThe same as `{first}`.")
    return "\n\n".join(parts) + "\n"


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Let pictures with a light and a dark version follow the palette that the reader chose; link pages to touch."""
    markdown = SOUND.sub(r"\g<0>, [touch it](gallery/\1-touch.html)", markdown)
    return PICTURE.sub(r'<img src="\2#only-light"\3 loading="lazy"><img src="\1#only-dark"\3 loading="lazy">', markdown)


def on_page_content(html: str, **_: Any) -> str:
    """Link public names in the text to the reference."""
    return re.sub(r"<code>(hapscene\.[\w.]+)</code>", r'<autoref identifier="\1" optional>\g<0></autoref>', html)
