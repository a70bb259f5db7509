"""`hapscene plugins`."""

import argparse
import json
import math
from typing import Any

from hapscene.command.console import tell
from hapscene.command.options import add_command


def add_plugins(commands: Any) -> None:
    command = add_command(commands, "plugins", _plugins)
    command.add_argument("--json", action="store_true", help="print JSON")


def _plugins(options: argparse.Namespace) -> int:
    """List the effects there are: parameters, units, defaults, and where they come from.

    for example:
      hapscene plugins --json
    """
    from hapscene.surface.effect_registry import listed

    effects = listed()
    if options.json:
        print(json.dumps([_described(item) for item in effects.values()], indent=2, ensure_ascii=False))
        return 0
    for item in effects.values():
        lines = [f"{item.name}  ({item.distribution} {item.version}, {item.module})"]
        if item.plugin is None:
            tell([*lines, f"  cannot be used: {item.error}"])
            continue
        lines.append(f"  {item.plugin.summary}")
        if item.plugin.scope == "scene":
            more = "".join(f", {name}" for name in (*item.plugin.arrays, "bodies"))
            lines.append(f"  of the scene: settings={{{item.name!r}: {{…}}}} takes its parameters{more}")
        if item.plugin.params:
            lines.append(f"  {'parameter':<24} {'default':<8} {'unit':<8} meaning")
        rows = (
            f"  {param.name:<24} {param.default:<8g} {param.unit:<8} {param.meaning}" for param in item.plugin.params
        )
        tell([*lines, *rows])
    if not effects:
        print("no effect is installed: is hapscene itself installed?")
        return 0
    print("\nA swatch gives the parameters where it names them, and always the stiffness_N_m that all effects share;")
    print("`hapscene swatch show NAME` tells them. Effects of the scene belong to no swatch: Renderer(settings={…}),")
    print("or `hapscene touch SCENE --effects wall,weight --set weight.mass_kg=0.2`.")
    return 0


def _described(item: Any) -> dict[str, Any]:
    """One effect as JSON; a bound that is infinite is null."""
    described = {key: getattr(item, key) for key in ("name", "distribution", "version", "module", "error")}
    if item.plugin is not None:
        described |= {"summary": item.plugin.summary, "scope": item.plugin.scope, "arrays": list(item.plugin.arrays)}
        keys = ("name", "unit", "default", "minimum", "maximum", "meaning")
        described["parameters"] = [
            {key: None if (value := getattr(param, key)) in (math.inf, -math.inf) else value for key in keys}
            for param in item.plugin.params
        ]
    return described
