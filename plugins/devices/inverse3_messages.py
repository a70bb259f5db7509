"""Parse and create JSON messages of Haply's Inverse service. Not a driver."""

from typing import Any

import msgspec

IDENTITY = {"position": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)}
"""The identity transform. The service leaves out parts that equal it."""


def parse(text: str | bytes) -> dict[str, Any] | None:
    """Parse a message; None if it is not a JSON object."""
    try:
        content = msgspec.json.decode(text)
    except (msgspec.DecodeError, ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None


def listed(content: dict[str, Any], kind: str) -> list[dict[str, Any]]:
    """The entries of all devices of a kind in a message."""
    devices = content.get(kind)
    return [entry for entry in devices if isinstance(entry, dict)] if isinstance(devices, list) else []


def first(content: dict[str, Any], kind: str, device_id: str | None = None) -> dict[str, Any]:
    """The entry of the first device of a kind, or of the device with an id; empty if it is not listed."""
    for entry in listed(content, kind):
        if device_id in (None, entry.get("device_id")):
            return entry
    return {}


def part(content: dict[str, Any], name: str) -> dict[str, Any]:
    """The object under a key; empty if it is missing or not an object."""
    inner = content.get(name)
    return inner if isinstance(inner, dict) else {}


def numbers(content: dict[str, Any], name: str, letters: str = "xyz") -> tuple[float, ...] | None:
    """A vector or quaternion; None if it is missing, not numeric or too large."""
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


def force_message(device_id: str, field: str, force: tuple[float, float, float]) -> bytes:
    """Message that commands a force for one tick of the service."""
    command = {field: dict(zip("xyz", force, strict=True))}
    return msgspec.json.encode({"inverse3": [{"device_id": device_id, "commands": {"set_cursor_force": command}}]})
