"""Haptography: from a recording of a tool on a surface to a swatch, and how good it is.

    swatch = hapscene.capture.fit(acceleration_m_s2, rate_Hz, force_N=…, speed_m_s=…, tangential_force_N=…)

| module | does |
|---|---|
| `recording_file` | reads a recording |
| `channel` | checks and cleans its streams |
| `order` | chooses the order of the models on held-out data |
| `texture_fit`, `linear_prediction` | fit the models over force and speed |
| `friction` | fits the friction coefficients |
| `swatch_fit` | the above in order: `fit` |
| `synthesis` | plays a swatch along force and speed: `synthesize` |
| `metric` | how near a model is to a recording |
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hapscene.capture.recording_file import load_surface_recording as load_surface_recording
    from hapscene.capture.swatch_fit import fit as fit
    from hapscene.capture.synthesis import synthesize as synthesize

_WHERE = {"fit": "swatch_fit", "load_surface_recording": "recording_file", "synthesize": "synthesis"}

__all__ = ["fit", "load_surface_recording", "synthesize"]


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_WHERE[name]}"), name)
