"""The Inverse3 driver: messages as published, in both versions; a missing service."""

import json

import pytest

from hapscene.errors import DeviceError
from hapscene_plugins.devices.inverse3 import DRIVER
from hapscene_plugins.devices.inverse3_messages import force_message


@pytest.mark.parametrize("field", ["vector", "values"])
def test_message_as_published(field: str) -> None:
    assert json.loads(force_message("05DA", field, (1.0, 0.0, -2.0))) == {
        "inverse3": [{"device_id": "05DA", "commands": {"set_cursor_force": {field: {"x": 1.0, "y": 0.0, "z": -2.0}}}}]
    }


def test_a_missing_service_is_an_error() -> None:
    with pytest.raises(DeviceError, match=r"inverse3: ws://127.0.0.1:9: no answer"):
        DRIVER.open(uri="ws://127.0.0.1:9")
    (found,) = DRIVER.find(uri="ws://127.0.0.1:9")
    assert "no answer" in found.trouble and "start Haply's" in found.remedy
