"""`hapscene devices`."""

import argparse
import json
import math
import threading
from collections.abc import Sequence
from typing import Any, Final

from hapscene.command.console import complain, say, tell
from hapscene.command.options import add_command, add_pairs
from hapscene.errors import DeviceError

FIND_S: Final = 5.0
"""How long a driver may look for its device [s]."""


def add_devices(commands: Any) -> None:
    command = add_command(commands, "devices", _devices)
    command.add_argument("what", nargs="?", choices=("try",), help="try: a first run with a device, step by step")
    command.add_argument("name", nargs="?", metavar="NAME", help="of the device that is tried")
    add_pairs(command, "--option", "of the device")
    command.add_argument("--yes", action="store_true", help="do not wait for the Enter key; never more than 0.5 N")
    command.add_argument("--json", action="store_true", help="print JSON")


def _devices(options: argparse.Namespace) -> int:
    """List the devices that can be felt with: which drivers there are, what is plugged in, and what is in the way.

    `try` moves a device through its workspace, and then gives a small force, at most 0.5 N before you confirm more.

    for example:
      hapscene devices
      hapscene devices --json
      hapscene devices try falcon --option firmware=falcon.bin
    """
    from hapscene.device.driver_registry import DRIVERS

    if options.what == "try":
        from hapscene.play.first_run import try_device

        if options.name is None:
            raise DeviceError(f"say which one: {', '.join(DRIVERS.names())}")
        return try_device(options.name, dict(options.option), say, wait=not options.yes)
    offers = DRIVERS.listed()
    told = dict(options.option)
    found = {name: _found(offer.plugin, told) for name, offer in offers.items()}
    if options.json:
        listed = [_described(offer, found[name]) for name, offer in offers.items()]
        print(json.dumps(listed, indent=2, ensure_ascii=False))
        return 0
    for name, offer in offers.items():
        if offer.plugin is None:
            complain(f"{name}: cannot be used: {offer.error}")
            continue
        driver = offer.plugin
        lines = [f"{name:<15} {driver.summary}"]
        for one in found[name]:
            help_ = "" if one.remedy in one.trouble else f"; {one.remedy}"
            state = f"{one.trouble}{help_}" if one.trouble else "ready"
            lines.append(f"  {one.where}: {state}" if one.where else f"  {state}")
        if not found[name]:
            lines.append("  not plugged in" + (f"; needs {driver.needs}" if driver.needs else ""))
        tell(lines)
    say("`hapscene devices try NAME` is the first run with one; `hapscene play SCENE --device NAME` feels a scene\n")
    return 0


def _found(driver: Any, told: dict[str, Any]) -> Sequence[Any]:
    """What is plugged in; what a driver raises all the same, or does not answer, is its trouble."""
    from hapscene.device.driver import Found

    if driver is None:
        return ()
    known = {option.name for option in driver.options}
    found: list[Any] = [
        Found("", {}, f"looking for it took longer than {FIND_S:g} s", "unplug it, and plug it in again")
    ]

    def find() -> None:
        try:
            found[:] = driver.find(**driver.read_options({k: v for k, v in told.items() if k in known}))
        except Exception as error:  # a driver of anybody's; the others are listed all the same
            found[:] = [Found("", {}, f"looking for it failed: {type(error).__name__}: {error}")]

    looking = threading.Thread(target=find, daemon=True)  # a vendor's library may hang
    looking.start()
    looking.join(FIND_S)
    return list(found)


def _described(offer: Any, found: Sequence[Any]) -> dict[str, Any]:
    """One driver as JSON; what is infinite is null."""
    described = {key: getattr(offer, key) for key in ("name", "distribution", "version", "module", "error")}
    driver = offer.plugin
    if driver is None:
        return described
    described |= {key: getattr(driver, key) for key in ("summary", "needs", "simulated", "force", "orientation")}
    described |= {"buttons": driver.button_count, "rate_Hz": driver.rate_Hz, "handle": driver.open_handle is not None}
    described |= {"position": driver.open is not None, "assumptions": list(driver.assumptions)}
    limits = {"continuous_N": driver.continuous_N, "speed_m_s": driver.speed_m_s, "watchdog_s": driver.watchdog_s}
    if driver.model is not None:
        limits |= {"force_N": driver.model.limits.force_N, "stiffness_N_m": driver.model.limits.stiffness_N_m}
    described["limits"] = {key: value if math.isfinite(value) else None for key, value in limits.items()}
    described["workspace_m"] = [
        [value if math.isfinite(value) else None for value in corner] for corner in (driver.low_D_m, driver.high_D_m)
    ]
    described["options"] = [
        {"name": o.name, "default": o.default, "meaning": o.meaning, "choices": list(o.choices)} for o in driver.options
    ]
    described["found"] = [{"where": one.where, "trouble": one.trouble, "remedy": one.remedy} for one in found]
    return described
