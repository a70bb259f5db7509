"""Summarises in one line what a fitted swatch can be used for."""

from hapscene.capture.fit.swatch import QUALITY
from hapscene.surface.swatch import Swatch

__all__ = ["verdict"]


def verdict(swatch: Swatch) -> str:
    """Verdict on a fitted swatch: "usable", "usable for …; not measured: …", or "record more: …" with the reason."""
    measured = {
        "texture": swatch.texture is not None,
        "taps": swatch.taps is not None,
        "friction": "friction_dynamic" not in swatch.absent,
        "stiffness": "stiffness_N_m" not in swatch.absent,
    }
    if QUALITY in swatch.absent:
        return f"record more: {swatch.absent[QUALITY]}"
    usable = [name for name, known in measured.items() if known]
    missing = [name for name, known in measured.items() if not known]
    assumed = [word for name, word in (("force_N", "force"), ("speed_m_s", "speed")) if name in swatch.absent]
    if not usable:
        return f"record more: {swatch.absent.get('texture', 'no quantity was measured')}"
    if not missing and not assumed:
        return "usable"
    found = ", ".join(usable)
    if assumed and swatch.texture is not None:
        found = found.replace("texture", f"texture (at an assumed {' and '.join(assumed)})")
    return f"usable for {found}" + (f"; not measured: {', '.join(missing)}" if missing else "")
