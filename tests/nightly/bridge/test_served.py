"""`hapscene serve` as a process, over real sockets."""

from pathlib import Path

import pytest

from tests.bridge.here import client_file
from tests.bridge.served import Served


def test_it_answers_and_ends_with_ctrl_c_and_says_what_came(tmp_path: Path) -> None:
    served = Served(tmp_path)
    client = client_file.Client(port=served.port)
    assert client.order("start", p=[0.0, 0.0, 0.1]) == {"done": "start"}
    client.frame(aim=(0.0, 0.0, 0.1))
    assert client.poll(60.0)
    said = served.end()
    assert served.process.returncode == 0 and "ended; " in said and "frames " in said and "Traceback" not in said
    with pytest.raises((TimeoutError, ConnectionError)):
        client_file.Client(port=served.port, patience_s=0.3)
