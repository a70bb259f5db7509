"""The haptography handle: its plant, the compensators that drive it, and how well they do."""

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from hapscene.handle.compensator import COMPENSATORS as COMPENSATORS
    from hapscene.handle.fit import identify as identify
    from hapscene.handle.handle_file import load_handle as load_handle
    from hapscene.handle.handle_file import save_handle as save_handle
    from hapscene.handle.identification import Identification as Identification
    from hapscene.handle.plant import Plant as Plant
    from hapscene.handle.playback import Played as Played
    from hapscene.handle.playback import play as play
    from hapscene.handle.response import estimate_response as estimate_response
    from hapscene.handle.spectrogram import spectrogram_error as spectrogram_error

_WHERE: Final = {
    "COMPENSATORS": "compensator",
    "Identification": "identification",
    "Plant": "plant",
    "Played": "playback",
    "estimate_response": "response",
    "identify": "fit",
    "load_handle": "handle_file",
    "play": "playback",
    "save_handle": "handle_file",
    "spectrogram_error": "spectrogram",
}
__all__ = [
    "COMPENSATORS",
    "Identification",
    "Plant",
    "Played",
    "estimate_response",
    "identify",
    "load_handle",
    "play",
    "save_handle",
    "spectrogram_error",
]


def __getattr__(name: str) -> Any:
    """Load a public name when it is first asked for: whoever wants a plant need not wait for the compiler."""
    if name not in _WHERE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_WHERE[name]}"), name)
    globals()[name] = value
    return value
