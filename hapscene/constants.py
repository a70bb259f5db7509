"""Constants: meaning, unit, source, and what depends on the value."""

from typing import Final

__all__ = [
    "ACCELERATION_BAND_HZ",
    "ACCELERATION_RATE_HZ",
    "BLEND_S",
    "BLOCK_MAX",
    "BUNDLE_SUFFIX",
    "CAST_MAX",
    "DAMPING_NS_M",
    "DEFAULT_GRIP",
    "EDGE_OVERLAP",
    "LEVEL_BOUND_DB",
    "LIFE_MAX",
    "LOOK_AHEAD",
    "NEAR_MAX",
    "NUMBER_MAX",
    "ORDER_MAX",
    "PASSED_MAX",
    "PASS_MAX",
    "REACH_MAX_M",
    "SCENE_SUFFIX",
    "SCENE_SUFFIXES",
    "SKIN_RATIO",
    "SKIN_RATIO_MIN",
    "SLIP_CUTOFF_HZ",
    "STIFFNESS_N_M",
    "TICK_S",
    "TINY",
    "UNITLESS",
]

# --- files -----------------------------------------------------------------------------------------------

SCENE_SUFFIX: Final = ".scene.json"
"""Suffix of scene files."""

BUNDLE_SUFFIX: Final = ".scene.zip"
"""Suffix of bundles: scene, meshes and swatches in one file."""

SCENE_SUFFIXES: Final = (SCENE_SUFFIX, BUNDLE_SUFFIX)

UNITLESS: Final = ("stl", "obj", "ply", "off")
"""Suffixes of mesh files that state neither a unit of length nor a vertical axis, except in comments of hapscene."""

# --- rates -----------------------------------------------------------------------------------------------

TICK_S: Final = 1e-3
"""Period of the force channel [s]. The driver of the Phantom Omni runs at 1 kHz. A longer period lowers the largest
stable stiffness (2b/T); a shorter one costs time that a scene rarely needs."""

ACCELERATION_RATE_HZ: Final = 10_000.0
"""Sample rate of the acceleration channel [Hz]. Choi & Tan 2004 recommend 5 to 10 kHz for clean textures."""

BLOCK_MAX: Final = 256
"""Largest number of acceleration samples of a tick [count]. Sets the size of `Output`; a tick of 1 ms has 10 samples at
10 kHz. The memory is cleared in every tick."""

# --- contact ---------------------------------------------------------------------------------------------

SKIN_RATIO: Final = 5e-6
"""Skin as a fraction of a mesh's bounding-box diagonal [1]: distance of the proxy from the faces during the search. The
reported proxy lies on the face. Embree works in float32, whose resolution is 6e-8 of the diagonal: at 1/20 of this
ratio rounding lets the proxy through the surface, at 10 times the ratio sharp corners feel blunt."""

SKIN_RATIO_MIN: Final = 1.5e-6
"""Smallest skin as a fraction of the largest body's diagonal [1], for small bodies next to large ones: 60 times the
resolution of float32 at the end of the large body."""

EDGE_OVERLAP: Final = 0.5
"""Extension of each face beyond its edges in the search, in skins [1]. It closes cracks at T-junctions and between
faces that share no vertices. It must be below 1; otherwise a proxy at a convex edge touches the face on the other
side."""

LOOK_AHEAD: Final = 300.0
"""Length of a ray beyond its goal, in skins [1]. A surface approached at a slope s is found when the proxy is still
`LOOK_AHEAD * s` skins away, so that rounding does not hide it even at a slope of 1 in 10,000."""

PASS_MAX: Final = 64
"""Largest number of moves of the proxy within one tick [count], about 0.2 µs each. A stroke needs 1 to 9; a tool that
moves straight through a body can need more. The proxy then stays at its last position, a skin off the surface, the tick
has the flag `Flag.UNSETTLED`, and the next tick continues."""

NEAR_MAX: Final = 256
"""Largest number of bodies that one tick tests [count]: a ray each, 0.1 to 0.3 µs, for each move of the proxy. If the
bounding spheres of more bodies overlap that of the tool, the first bodies of the scene and those in contact are tested,
the others are ignored, and the tick has the flag `Flag.CROWDED`."""

CAST_MAX: Final = 2048
"""Largest number of rays within one tick, over all moves of the proxy [count]: half a millisecond. With more than 32
bodies nearby, a tick has fewer than `PASS_MAX` moves, with `NEAR_MAX` bodies 8; with fewer, strokes would not
settle."""

REACH_MAX_M: Final = 10_000.0
"""Largest coordinate of a position of the tool, a body or a vertex in its frame [m]. Beyond it a float32 ray is off by
a millimetre; such numbers are usually in a wrong unit."""

PASSED_MAX: Final = 8
"""Largest number of bodies that the tool can have penetrated at the same time [count]. Sets the size of `Touch`."""

# --- description -----------------------------------------------------------------------------------------

SLIP_CUTOFF_HZ: Final = 20.0
"""Cut-off of the one-pole low-pass filter on slip speed and normal force, which select the texture [Hz], as in
Culbertson, Unwin & Kuchenbecker 2014. A higher cut-off makes encoder steps (55 µm at 1 kHz = 55 mm/s) audible, a lower
one delays the texture."""

TINY: Final = 1e-15
"""Threshold below which a decaying state of a low-pass filter or an observer is set to 0 [m/s, N, J]: 1e-18 m per tick,
beyond any encoder. It avoids denormal numbers (below 1e-308), which are many times slower."""

# --- surface ---------------------------------------------------------------------------------------------

STIFFNESS_N_M: Final = 500.0
"""Default stiffness of a swatch [N/m]. Below the 700 N/m to which CHAI3D limits the Omni."""

DAMPING_NS_M: Final = 0.0
"""Default damping of a swatch [N·s/m]."""

NUMBER_MAX: Final = 1e9
"""Largest value of a parameter of a swatch, in its SI unit. Steel on steel, the stiffest contact, has about 1e8 N/m; a
larger value is a mistake or a wrong unit."""

BLEND_S: Final = 0.01
"""Shortest time of a transition between the swatches of a blend [s]. With a much shorter time, the subfaces of a soft
border could be felt one by one; with a longer one, the transition lags by more than 1 mm at 0.1 m/s."""

ORDER_MAX: Final = 576
"""Largest order of the AR models of a texture [count]: order 120 at 10 kHz (Culbertson, Unwin & Kuchenbecker 2014),
resampled to 48 kHz. Sets the size of the filter state; with a smaller limit, resampling to an audio rate would lose
resonances."""

LIFE_MAX: Final = 8
"""Most processes of a texture's slow gain [count]. Sets the size of their memory; recordings ask for 1 to 3."""

LEVEL_BOUND_DB: Final = 10.0
"""Largest extrapolation of a texture's level beyond the recorded forces and speeds, up or down [dB]. Twice the force at
twice the speed is 8 dB with the mean exponents of the surfaces in the Penn Haptic Texture Toolkit."""

# --- handle ----------------------------------------------------------------------------------------------

ACCELERATION_BAND_HZ: Final = (20.0, 1000.0)
"""Frequency band of the acceleration channel [Hz]: below it the motors render the force; above it, nothing is felt."""

# --- hand ------------------------------------------------------------------------------------------------

DEFAULT_GRIP: Final = "light"
"""Default grip of the simulated hand, a name of `device.hand.GRIPS`: the one with which walls are least stable."""
