"""Messages of Haply's Inverse service: JSON that may be anything, read into numbers. Not a driver."""

import json
from typing import Any

IDENTITY = {"position": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)}
"""Of a transform; parts that are this are left out."""


def parse(text: str | bytes) -> dict[str, Any] | None:
    """A message of the service; None where it is none."""
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None


def listed(content: dict[str, Any], kind: str) -> list[dict[str, Any]]:
    """What a message says of its devices of a kind."""
    devices = content.get(kind)
    return [told for told in devices if isinstance(told, dict)] if isinstance(devices, list) else []


def first(content: dict[str, Any], kind: str, device_id: str | None = None) -> dict[str, Any]:
    """What a message says of its first device of a kind, or that of an id; empty where it says nothing."""
    for told in listed(content, kind):
        if device_id in (None, told.get("device_id")):
            return told
    return {}


def part(content: dict[str, Any], name: str) -> dict[str, Any]:
    inner = content.get(name)
    return inner if isinstance(inner, dict) else {}


def numbers(content: dict[str, Any], name: str, letters: str = "xyz") -> tuple[float, ...] | None:
    """A vector or a quaternion; None where it is none, or not finite."""
    inner = part(content, name)
    values = [inner.get(letter) for letter in letters]
    if any(isinstance(value, bool) or not isinstance(value, int | float) for value in values):
        return None
    if not all(abs(value) < 1e6 for value in values):  # type: ignore[arg-type]
        return None
    return tuple(float(value) for value in values)  # type: ignore[arg-type]


def is_identity(transform: dict[str, Any]) -> bool:
    for name, same in IDENTITY.items():
        if name in transform and numbers(transform, name, "xyzw"[: len(same)]) != same:
            return False
    return True


def force_message(device_id: str, field: str, force: tuple[float, float, float]) -> str:
    """The message that has a force given for one tick."""
    told = {field: dict(zip("xyz", force, strict=True))}
    return json.dumps({"inverse3": [{"device_id": device_id, "commands": {"set_cursor_force": told}}]})
