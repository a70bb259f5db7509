"""Every number that is a choice: what it means, its unit, where it is from, what breaks when it is changed."""

from typing import Final

__all__ = [
    "ACCELERATION_BAND_HZ",
    "ACCELERATION_RATE_HZ",
    "BLEND_S",
    "BLOCK_MAX",
    "CAST_MAX",
    "DAMPING_NS_M",
    "DEFAULT_GRIP",
    "EDGE_OVERLAP",
    "LEVEL_BOUND_DB",
    "LIFE_MAX",
    "LOOK_AHEAD",
    "NEAR_MAX",
    "ORDER_MAX",
    "PASSED_MAX",
    "PASS_MAX",
    "REACH_MAX_M",
    "SKIN_RATIO",
    "SKIN_RATIO_MIN",
    "SLIP_CUTOFF_HZ",
    "STIFFNESS_N_M",
    "TICK_S",
    "TINY",
]

# --- rates -----------------------------------------------------------------------------------------------

TICK_S: Final = 1e-3
"""Period of the force channel [s]. 1 kHz is what the Phantom Omni's driver runs at; slower lowers the
stiffness that stays stable (2b/T), faster costs time that a scene rarely needs."""

ACCELERATION_RATE_HZ: Final = 10_000.0
"""Rate of the acceleration channel [Hz]. Choi & Tan 2004 recommend 5 to 10 kHz for clean textures."""

BLOCK_MAX: Final = 256
"""Most acceleration samples that one tick can carry [count]. Sets the size of `Output`; a tick of 1 ms holds
10 of them at 10 kHz. Raising it costs memory that is cleared every tick."""

# --- contact ---------------------------------------------------------------------------------------------

SKIN_RATIO: Final = 5e-6
"""Skin, as a fraction of a mesh's bounding-box diagonal [1]: how far off a face the proxy is kept while it is
searched for (what is reported lies on the face itself). Embree works in float32, whose step is 6e-8 of the same
length: at a twentieth of this ratio rounding lets the proxy leak, at ten times it sharp corners are felt blunt."""

SKIN_RATIO_MIN: Final = 1.5e-6
"""Least skin, as a fraction of the largest body's diagonal [1], where small bodies lie beside large ones: 60 steps of
float32 at the body's end."""

EDGE_OVERLAP: Final = 0.5
"""How far each face reaches past its edges in the search, in skins [1]. Closes the cracks of T-junctions and of
faces that share no vertices. Must stay below 1, or a proxy on one side of a convex edge feels the other."""

LOOK_AHEAD: Final = 300.0
"""How far past its goal a ray looks, in skins [1]. A surface met at a slope s is seen when the proxy is still
`LOOK_AHEAD * s` skins away, so even a wall met at a slope of 1 in 10,000 is seen before rounding hides it."""

PASS_MAX: Final = 64
"""Most moves of the proxy within one tick [count], about 0.2 µs each. A tool that strokes needs 1 to 9; one that cuts
straight through a body can send the proxy over more faces than this. Then it is left where it has got to, a skin off
the surface, flagged `Flag.UNSETTLED`, and goes on in the next tick."""

NEAR_MAX: Final = 256
"""Most bodies that one tick casts against [count]: a ray each, 0.1 to 0.3 µs, for each move of the proxy. Where the
balls around more of them meet the tool's, the first of the scene are asked, and those that hold the proxy; the tick is
flagged `Flag.CROWDED`, the others are not felt there."""

CAST_MAX: Final = 2048
"""Most bodies that the proxy is cast against within one tick, over all its moves [count]: half a millisecond. With more
than 32 bodies near, a tick has fewer than `PASS_MAX` moves, with `NEAR_MAX` 8. Below that strokes would not settle."""

REACH_MAX_M: Final = 10_000.0
"""Farthest that a position may be from the origin of its frame [m]: of the tool, of a body, of a mesh's vertex. Beyond
it a float32 ray misses by a millimetre: such numbers are in another unit."""

PASSED_MAX: Final = 8
"""Most bodies that the tool can be let into at once [count]; one more holds as before. Sets the size of `Touch`."""

# --- description -----------------------------------------------------------------------------------------

SLIP_CUTOFF_HZ: Final = 20.0
"""Cut-off of the one-pole low-pass on slip speed and normal force that textures are chosen by [Hz]. As in
Culbertson, Unwin & Kuchenbecker 2014. Higher lets the encoder's steps (55 µm at 1 kHz = 55 mm/s) be heard,
lower makes the texture lag the hand."""

TINY: Final = 1e-15
"""Below this, what dies away in a low-pass or an observer counts as 0 [m/s, N, J]: 1e-18 m a tick, beyond any encoder.
At 0 it would go on into denormal numbers (below 1e-308), which take a processor many times longer."""

# --- surface ---------------------------------------------------------------------------------------------

STIFFNESS_N_M: Final = 500.0
"""Stiffness of a surface whose swatch gives none [N/m]. Below the 700 N/m at which CHAI3D caps the Omni."""

DAMPING_NS_M: Final = 0.0
"""Damping of a surface whose swatch gives none [N·s/m]."""

BLEND_S: Final = 0.01
"""In this time what is felt goes from one swatch of a blend to the other, or slower, as the paint does [s]. Much
shorter, and pieces of a soft border are felt one by one; longer, and at 0.1 m/s it is felt more than 1 mm behind."""

ORDER_MAX: Final = 576
"""Highest order of a texture's AR models [count]: order 120 at 10 kHz (Culbertson, Unwin & Kuchenbecker 2014) resampled
to 48 kHz. Sets the size of the filter's memory; smaller, what is resampled to an audio rate loses its resonances."""

LIFE_MAX: Final = 8
"""Most processes of a texture's slow gain [count]. Sets the size of their memory; recordings ask for 1 to 3."""

LEVEL_BOUND_DB: Final = 10.0
"""How far a texture's level may go beyond that of the largest force and speed recorded, up or down [dB]: twice the
force at twice the speed, with the mean exponents of the Penn Haptic Texture Toolkit's surfaces, is 8 dB."""

# --- handle ----------------------------------------------------------------------------------------------

ACCELERATION_BAND_HZ: Final = (20.0, 1000.0)
"""Band that the acceleration channel is for [Hz]: below it the motors act, above it no one feels it."""

# --- hand ------------------------------------------------------------------------------------------------

DEFAULT_GRIP: Final = "light"
"""How firmly the simulated hand holds, of `device.hand.GRIPS`, unless it is said: where walls bounce most easily."""
