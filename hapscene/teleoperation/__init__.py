"""Teleoperation: a follower touches a real surface, a leader with the haptography handle feels it; all simulated.

    operation = hapscene.teleoperation.Operation(scene, (0, 0, 0.01), line=Impairment(delay_s=0.05))
    operated = operation.run(Intent.along(path, "light"))

| module | does |
|---|---|
| `follower`, `leader`, `tool` | a tick of each end: device, hand, handle, accelerometer |
| `coupling`, `port` | how they are tied together; the position–position controller; the timeout |
| `wave`, `queue` | wave variables, passive over any line; messages that wait for their turn |
| `message`, `link` | what they tell each other; a line that delays, loses and reorders |
| `loop`, `operation` | both in one compiled loop: `Operation` |
| `datagram`, `pace`, `session`, `process` | each a process of its own, over UDP |
| `site`, `experiment`, `experiment_plot` | the haptography paper's experiment |
| `delay_study`, `delay_plot` | what delay does to both schemes |
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hapscene.teleoperation.coupling import Coupling as Coupling
    from hapscene.teleoperation.experiment import write_experiment as write_experiment
    from hapscene.teleoperation.link import Impairment as Impairment
    from hapscene.teleoperation.operation import Operated as Operated
    from hapscene.teleoperation.operation import Operation as Operation

_WHERE = {
    "Coupling": "coupling",
    "Impairment": "link",
    "Operated": "operation",
    "Operation": "operation",
    "write_experiment": "experiment",
}

__all__ = ["Coupling", "Impairment", "Operated", "Operation", "write_experiment"]


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_WHERE[name]}"), name)
