"""Computes the swatches of `swatches/computed`: python swatches/compute.py

These swatches are computed, not measured. Each combines a height profile with an assumed material and models a steel
ball on a hand-held tool that slides over it:

1. **Trace.** The ball (radius R) rests on the highest point below it. A periodic profile is dilated by the ball and
   expanded into its Fourier series h_n. A random profile has the self-affine height spectrum
   C(q) ∝ (1 + (q L)²)^−(H + ½) over the spatial frequency q, with the corner length L and the Hurst exponent H; with
   H = 3/2 it falls with the exponent −4, that of cusps.
2. **Contact.** The Hertzian contact patch, of radius a = (¾ F R/E*)^⅓, averages wavelengths shorter than itself:
   |W|² = 1/(1 + π/4 (2π q a)³), the contact filter of rolling-noise models.
3. **Speed.** f = q v: a spectral line of period λ is at v/λ, a corner of length L at v/L.
4. **Tool.** The mass of the tool on the Hertzian contact stiffness k = (6 E*² R F)^⅓, in series with the stiffness of
   the tool, follows the profile below its resonance and is isolated from it above. The hand damps it relative to the
   ground, the loss of the material relative to the profile. Acceleration is (2π f)² · height.
5. **Level.** A random profile or a weave has the level of a similar surface that was measured, P ∝ F^α v^β. Another
   periodic profile has the level of steps 1 to 4, with two corrections. A tool that is shaken beyond its resonance
   leaves the surface and strikes it again, so the power does not fall where the linear model would isolate the tool or
   flatten the profile: P₀ is the largest of all slower and lighter strokes. And the pressing force bounds it:
   P = P₀/(1 + P₀/A²) with A = F/(√2 m).

Step 3 is geometry. The two Hertz formulas follow from F = 4/3 E* √R d^(3/2). The levels and exponents of step 5 are
fitted to models of the Penn Haptic Texture Toolkit (see `LIKE`). In 99 of its 100 surfaces the power grows with speed
(median exponent 2.0), in 76 with force (median 0.2); the other exponents of force, down to −0.2, are taken as 0. H, L
and the damping of the hand are chosen so that the spectra of random profiles are like those of the same surfaces. The
filter of the patch and the bound are assumptions without a cited source. The provenance of each swatch lists the
material constants that come from a table.

**Reference level**: the root mean square at 1 N and 0.1 m/s. It is 0.15 to 7.5 m/s² (median 0.8) for the 100 surfaces
of the toolkit, and 0.25 (silk) to 7.3 m/s² (sandpaper P60) for these swatches.

Forces and speeds of the models are spaced by a constant ratio. The line spectral frequencies of a spectral line are
proportional to its frequency, so that interpolation between two models puts the line at the correct frequency.
"""

import io
import math
import sys
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.linalg import solve_toeplitz

from hapscene.dsp.ar_filter import power_gain
from hapscene.dsp.warped_prediction import warp_at, warped_angle
from hapscene.surface.look import Look
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_file import save_swatch
from hapscene.surface.taps import Taps
from hapscene.surface.texture import Texture
from hapscene.swatches.library import entry_of, write_index

Array = NDArray[np.float64]

RATE_HZ = 10_000.0
TIP_M = 1.6e-3  # radius of the steel ball; assumed
MASS_KG = 0.1  # mass of the tool and the fingers that move with it; assumed
TOOL_HZ = 300.0  # resonance of the tool on a rigid surface; assumed
TAP_DAMPING = 0.05  # damping ratio of taps, added to half the loss factor of the material; assumed
HAND_DAMPING = 0.4  # damping ratio of the hand on a sliding tool; gives the shape of measured spectra, as above
FORCES_N = (0.25, 1.0, 3.0)
SPEED_COUNT = 14
SPEED_MAX_M_S = 0.4
SPEED_MIN_M_S = 0.01
FELT_HZ = 20.0  # lower frequencies are not perceived as texture; the models end here
HARMONIC_MIN = 0.1  # least acceleration of a harmonic, relative to the first line
LINE_COUNT = 3  # most harmonics of a periodic profile
NOISE_ORDER = 10
STIFFNESS_MAX_N_M = 700.0  # highest stiffness that a Phantom Omni renders
TAP_SHARE = 0.08  # tap amplitude relative to v ω of a free mass; gives wood 50 m/s² per m/s, as in the measured swatch
TAP_M_S = 0.3
TIP = 212e9, 0.293  # steel, as below: Young's modulus [Pa], Poisson's ratio
LICENCE = "MIT"
SOURCE = (
    "Computed, not measured: {what}, on {material}, under a steel ball of 1.6 mm radius that 0.1 kg press and hold. "
    "Model: the ball's trace; Hertz's contact with a filter of its patch; a mass on that contact; see "
    "swatches/compute.py. {level} {tables}Assumed, from no source: {assumed}.{more} "
    "Stiffness is what the contact has at 1 N, and 700 N/m at most, which devices render."
)
BOUND = "Level: that of the trace, bounded by the pressing force and never falling with force or speed (assumed)."
HATT = (
    "Level: {level.rms_m_s2:g} m/s² rms at 1 N and 0.1 m/s, its power with the exponents {level.force:g} of force and "
    "{level.speed:g} of speed, as fitted to {level.like} of the Penn Haptic Texture Toolkit (Culbertson, López Delgado "
    "& Kuchenbecker 2014)."
)

ASSUMED = ("elasticity", "loss", "friction", "the filter", "mass and damping of tool and hand")

# Sources of material constants. Each text begins with the quantity.
DOWLING = "elasticity by N. E. Dowling, Mechanical Behavior of Materials, table 5.2"
GERE = "elasticity within the range of J. M. Gere, Mechanics of Materials, 5th ed."
IRVINE = "loss by T. Irvine, Damping Properties of Materials (2004), table 2"
ONTARIO = "friction by eCampusOntario, Physics Fundamentals, table A.1, clean and dry"
LUST = "friction within the range of the Lust CDA3000 Engineering Guide, table 7.21, dry"
SCHNEIDER = (
    "friction at rest by the reference chart of Schneider & Company, greasy as what is touched, a little less sliding"
)


@dataclass(frozen=True)
class Material:
    """Assumed mechanical constants and appearance of a material.

    Attributes:
        said: name of the material in the provenance.
        young_Pa, poisson, loss: Young's modulus, Poisson's ratio, loss factor.
        friction: static and dynamic friction coefficient on steel.
        albedo_rgb, roughness: colour; roughness from 0 (mirror) to 1 (matt).
        tables: sources of constants; the other constants are assumed.
    """

    said: str
    young_Pa: float
    poisson: float
    loss: float
    friction: tuple[float, float]
    albedo_rgb: tuple[float, float, float]
    roughness: float
    tables: tuple[str, ...] = ()

    @property
    def contact_Pa(self) -> float:
        """Effective modulus E* of the contact with the steel tip [Pa]."""
        return 1.0 / ((1 - self.poisson**2) / self.young_Pa + (1 - TIP[1] ** 2) / TIP[0])


MATERIALS = {
    "aluminium": Material(
        "aluminium", 70.3e9, 0.345, 1e-4, (0.61, 0.47), (0.80, 0.81, 0.83), 0.35, (DOWLING, IRVINE, ONTARIO)
    ),
    "steel": Material("steel", *TIP, 3e-4, (0.25, 0.20), (0.62, 0.64, 0.67), 0.3, (DOWLING, IRVINE, LUST)),
    "brass": Material(
        "brass wire", 101e9, 0.350, 1e-3, (0.51, 0.44), (0.78, 0.63, 0.30), 0.35, (DOWLING, IRVINE, ONTARIO)
    ),
    "acrylic": Material("acrylic", 2.7e9, 0.35, 0.05, (0.40, 0.35), (0.45, 0.68, 0.86), 0.3, (DOWLING, LUST)),
    "corundum": Material("corundum in resin", 20e9, 0.25, 0.03, (0.70, 0.60), (0.62, 0.36, 0.22), 1),
    "silk": Material("silk yarn", 80e6, 0.35, 0.15, (0.25, 0.20), (0.80, 0.55, 0.67), 0.6),
    "linen": Material("linen yarn", 20e6, 0.35, 0.20, (0.35, 0.30), (0.85, 0.78, 0.62), 0.95),
    "cotton": Material("cotton yarn", 10e6, 0.35, 0.25, (0.45, 0.38), (0.20, 0.29, 0.47), 0.95),
    "glass": Material("glass", 69e9, 0.20, 0.005, (0.25, 0.20), (0.66, 0.82, 0.80), 0.1, (DOWLING, SCHNEIDER)),
    "soft rubber": Material("soft rubber", 1.5e6, 0.49, 0.25, (1.10, 0.95), (0.20, 0.20, 0.22), 0.8),
    "hard rubber": Material("hard rubber", 20e6, 0.49, 0.15, (0.80, 0.65), (0.30, 0.27, 0.27), 0.65, (GERE,)),
    "soft foam": Material("open-cell polyurethane foam", 60e3, 0.30, 0.40, (0.70, 0.60), (0.93, 0.84, 0.45), 1),
    "firm foam": Material("closed-cell polyethylene foam", 1e6, 0.25, 0.30, (0.50, 0.45), (0.92, 0.93, 0.95), 0.85),
    "granite": Material("granite", 49.6e9, 0.213, 0.01, (0.45, 0.40), (0.55, 0.50, 0.49), 0.35, (DOWLING,)),
    "slate": Material("slate", 40e9, 0.25, 0.01, (0.45, 0.40), (0.30, 0.34, 0.38), 0.85),
    "sandstone": Material("sandstone", 15e9, 0.25, 0.02, (0.60, 0.50), (0.80, 0.66, 0.47), 1),
}


@dataclass(frozen=True)
class Level:
    """Level of a measured surface: rms at 1 N and 0.1 m/s [m/s²], exponents of the power over force and speed [1]."""

    like: str
    rms_m_s2: float
    force: float
    speed: float


LIKE = {
    level.like: level
    for level in (
        # least squares over the models of a surface, 20 to 450 Hz, in ralee9/PennHaTT_MLHD at commit 12ca9ff; two
        # exponents of force, −0.1 and −0.08, are taken as 0
        Level("Whiteboard", 0.38, 0.04, 0.92),
        Level("Frosted Acrylic", 0.88, 0.0, 1.17),
        Level("Textured Rubber", 0.74, 0.89, 0.89),
        Level("EPDM Foam", 0.78, 0.05, 1.97),
        Level("Pink Foam", 0.52, 0.64, 2.10),
        Level("Polyethylene Foam", 1.07, 0.15, 2.32),
        Level("Aluminum", 0.48, 0.40, 1.44),
        Level("Metal Shelving", 0.64, 0.33, 1.12),
        Level("Ceramic", 0.56, 0.12, 0.70),
        Level("Terra Cotta", 1.40, 0.22, 1.80),
        Level("Stone Tile 2", 2.73, 0.0, 1.11),
        Level("Denim", 0.59, 0.21, 2.24),
        Level("Canvas 2", 0.76, 0.20, 2.40),
        Level("Silk 2", 0.25, 0.17, 1.97),
    )
}


@dataclass(frozen=True)
class Surface:
    """A periodic or random height profile on a material.

    Attributes:
        what: description of the profile in the provenance.
        period_m: period of the profile; 0 for a random profile.
        form: "wave" (sinusoid), "wires" (cylinders side by side) or "ribs" (half cylinders on a plane); "" if random.
        depth_m: peak-to-peak height of a wave, diameter of wires, height of ribs.
        sharpness: frequency of a spectral line divided by its width; higher for a more regular profile.
        level: level of a measured surface; None for the level of the model.
        corner_m, hurst: corner length L and Hurst exponent H of a random profile.
        grain_m: diameter of grains that the ball touches one at a time; 0 if the profile has no grains.
    """

    what: str
    material: str
    form: str = ""
    depth_m: float = 0.0
    period_m: float = 0.0
    sharpness: float = 30.0
    level: Level | None = None
    corner_m: float = 0.02
    hurst: float = 1.6
    grain_m: float = 0.0
    more: str = ""


def grating(period_mm: float, depth_um: float) -> Surface:
    """A sinusoidal grating."""
    what = f"a sinusoidal grating of {period_mm:g} mm, {depth_um:g} µm deep"
    return Surface(what, "acrylic", "wave", 1e-6 * depth_um, 1e-3 * period_mm)


def mesh(period_mm: float, wire_mm: float) -> Surface:
    """Woven wire."""
    what = f"woven wire of {wire_mm:g} mm, {period_mm:g} mm apart"
    return Surface(what, "brass", "wires", 1e-3 * wire_mm, 1e-3 * period_mm)


def weave(material: str, period_mm: float, yarn_mm: float, like: str) -> Surface:
    """A plain weave, modelled as cylinders of the yarn diameter, much less regular than wires."""
    what = f"a plain weave with a crown each {period_mm:g} mm, of yarn of {yarn_mm:g} mm"
    return Surface(what, material, "wires", 1e-3 * yarn_mm, 1e-3 * period_mm, sharpness=1.0, level=LIKE[like])


def ribs(period_mm: float, height_mm: float) -> Surface:
    """Half-round ribs on a plane."""
    what = f"half-round ribs of {height_mm:g} mm, {period_mm:g} mm apart"
    return Surface(what, "acrylic", "ribs", 1e-3 * height_mm, 1e-3 * period_mm)


def sandpaper(grit: int, grain_um: float) -> Surface:
    """Sandpaper. Its level is the power law over grain diameter through Sandpaper 100, 220 and 320 of the toolkit.

    They have 4.19, 2.21 and 1.30 m/s² at 141, 68 and 36 µm, the mean grains of these CAMI grits. The exponents of force
    and speed are means over the four sandpapers of the toolkit.
    """
    what = f"sandpaper of FEPA grit P{grit}, grain of {grain_um:g} µm"
    level = Level("four sandpapers", float(f"{4.19 * (grain_um / 141) ** 0.86:.2g}"), 0.32, 0.96)
    more = (
        " Grain: the mean diameter in charts of FEPA's P grades (stusshed.wordpress.com, March 2008; sizes.com), not "
        "in the standard itself, ISO 6344; the level is proportional to grain^0.86."
    )
    return Surface(what, "corundum", level=level, grain_m=1e-6 * grain_um, more=more)


def noise(what: str, material: str, like: str, corner_mm: float = 20.0, hurst: float = 1.6) -> Surface:
    """A random profile with the level of a measured surface."""
    more = f" Heights: a corner at {corner_mm:g} mm and a Hurst exponent of {hurst:g}, chosen for a spectrum like its."
    return Surface(what, material, level=LIKE[like], corner_m=1e-3 * corner_mm, hurst=hurst, more=more)


SURFACES = {
    "grating-0.5mm-10um": grating(0.5, 10), "grating-0.7mm-20um": grating(0.7, 20),
    "grating-1mm-10um": grating(1, 10), "grating-1mm-50um": grating(1, 50),
    "grating-2mm-50um": grating(2, 50), "grating-2mm-200um": grating(2, 200), "grating-4mm-400um": grating(4, 400),
    "sandpaper-p60": sandpaper(60, 269), "sandpaper-p120": sandpaper(120, 125), "sandpaper-p180": sandpaper(180, 82),
    "sandpaper-p240": sandpaper(240, 58.5), "sandpaper-p400": sandpaper(400, 35),
    "sandpaper-p800": sandpaper(800, 21.8),
    "mesh-0.5mm": mesh(0.5, 0.2), "mesh-1mm": mesh(1, 0.4), "mesh-2mm": mesh(2, 0.8),
    "weave-silk": weave("silk", 0.25, 0.15, "Silk 2"), "weave-linen": weave("linen", 0.8, 0.5, "Canvas 2"),
    "weave-denim": weave("cotton", 1.2, 0.7, "Denim"),
    "ribs-3mm": ribs(3, 0.3), "ribs-6mm": ribs(6, 1),
    "glass": noise("float glass", "glass", "Whiteboard", hurst=1.85),
    "glass-frosted": noise("frosted glass", "glass", "Frosted Acrylic"),
    "rubber-soft": noise("a moulded sheet", "soft rubber", "EPDM Foam", 0.5, 0.5),
    "rubber-hard": noise("a moulded sheet", "hard rubber", "Textured Rubber", 0.5, 0.5),
    "foam-soft": noise("a cut face", "soft foam", "Pink Foam", 0.5, 0.5),
    "foam-firm": noise("a cut face", "firm foam", "Polyethylene Foam", 0.5, 0.5),
    "steel-lapped": noise("a lapped face", "steel", "Aluminum", hurst=1.85),
    "aluminium-brushed": noise("a brushed face, across", "aluminium", "Metal Shelving"),
    "granite-polished": noise("a polished face", "granite", "Ceramic", hurst=1.85),
    "slate": noise("a split face", "slate", "Terra Cotta"),
    "sandstone": noise("a sawn face", "sandstone", "Stone Tile 2"),
}  # fmt: skip


# The closed form.


@cache
def traced(surface: Surface, count: int = 1024) -> Array:
    """Return the amplitudes (n,) [m] of the perceptible harmonics of the ball's path over a periodic profile."""
    p, d = surface.period_m, surface.depth_m
    reach = max(math.ceil(TIP_M / p), 1)
    x = (np.arange(-reach * count, (reach + 1) * count) / count) * p
    near = (x + p / 2) % p - p / 2  # distance from the nearest top
    arc = np.sqrt(np.maximum((d / 2) ** 2 - near**2, 0.0))
    height = {"wave": d / 2 * np.cos(2 * np.pi * x / p), "wires": arc, "ribs": np.minimum(2 * arc, d)}[surface.form]
    ball = np.abs(x) <= TIP_M
    lift = np.sqrt(TIP_M**2 - x[ball] ** 2)
    at = reach * count + np.arange(count)
    offset = np.flatnonzero(ball) - reach * count
    path = np.array([np.max(height[(i + offset) % len(x)] + lift) for i in at])
    series = 2.0 * np.abs(np.fft.rfft(path))[1 : LINE_COUNT + 1] / count
    n = np.arange(1, LINE_COUNT + 1)
    perceptible = (n**2 * series > HARMONIC_MIN * series[0]) & (n * SPEED_MAX_M_S / p < 0.4 * RATE_HZ)
    return np.asarray(series[: np.argmin([*perceptible, False])])


def tool_response(surface: Surface, force_N: float, frequency_Hz: Array) -> Array:
    """Return the power response (n,) of the tool to the trace: a damped mass on the contact and tool stiffness."""
    r = frequency_Hz / resonance_Hz(surface, force_N)
    loss = MATERIALS[surface.material].loss
    return np.asarray((1 + (loss * r) ** 2) / ((1 - r**2) ** 2 + ((2 * HAND_DAMPING + loss) * r) ** 2))


def contact_N_m(surface: Surface, force_N: float) -> float:
    """Return the Hertzian contact stiffness [N/m]."""
    E, R = MATERIALS[surface.material].contact_Pa, _radius_m(surface)
    return float((6 * E**2 * R * force_N) ** (1 / 3))


def resonance_Hz(surface: Surface, force_N: float) -> float:
    """Return the resonance of the tool on the surface [Hz]."""
    tool_N_m = MASS_KG * (2 * math.pi * TOOL_HZ) ** 2
    stiffness = 1 / (1 / contact_N_m(surface, force_N) + 1 / tool_N_m)
    return math.sqrt(stiffness / MASS_KG) / (2 * math.pi)


def patch_response(surface: Surface, force_N: float, q_1_m: Array) -> Array:
    """Return the power response (n,) of the contact patch to spatial frequencies `q_1_m`."""
    a_m = (0.75 * force_N * _radius_m(surface) / MATERIALS[surface.material].contact_Pa) ** (1 / 3)
    return np.asarray(1 / (1 + math.pi / 4 * (2 * math.pi * q_1_m * a_m) ** 3))


def _radius_m(surface: Surface) -> float:
    """Return the effective radius of the contact [m]: of the tip, or of the tip against a grain."""
    return 1 / (1 / TIP_M + 2 / surface.grain_m) if surface.grain_m else TIP_M


def line_powers(surface: Surface, force_N: float, speed_m_s: float) -> Array:
    """Return the power of each spectral line (n,) [(m/s²)²] before step 5; the first line is at speed/period."""
    f = speed_m_s / surface.period_m * np.arange(1, len(traced(surface)) + 1)
    passed = tool_response(surface, force_N, f) * patch_response(surface, force_N, f / speed_m_s)
    return np.asarray(0.5 * (traced(surface) * (2 * np.pi * f) ** 2) ** 2 * passed)


def noise_density(surface: Surface, force_N: float, speed_m_s: float, frequency_Hz: Array) -> Array:
    """Return the power spectral density (n,) of a random profile before step 5, in an arbitrary unit."""
    q = frequency_Hz / speed_m_s
    height = (1 + (q * surface.corner_m) ** 2) ** -(surface.hurst + 0.5)
    passed = tool_response(surface, force_N, frequency_Hz) * patch_response(surface, force_N, q)
    return np.asarray((2 * np.pi * frequency_Hz) ** 4 * height * passed)


def power_m2_s4(surface: Surface, forces_N: Array, speeds_m_s: Array) -> Array:
    """Return the power (n, m) [(m/s²)²] at forces (n,) and speeds (m,) in ascending order (step 5)."""
    F = forces_N[:, None]
    if surface.level is not None:
        return surface.level.rms_m_s2**2 * F**surface.level.force * (speeds_m_s / 0.1) ** surface.level.speed
    linear = np.array([[line_powers(surface, F, v).sum() for v in speeds_m_s] for F in forces_N])
    linear = np.maximum.accumulate(np.maximum.accumulate(linear, axis=0), axis=1)
    return np.asarray(linear / (1 + linear * 2 * (MASS_KG / F) ** 2))


# Texture models.


def line_model(surface: Surface, force_N: float, speed_m_s: float) -> Array:
    """Return the warped filter of a periodic profile, with one pair of poles a spectral line.

    In a cascade of resonances, the power of a line is the inverse of its width, divided by the squared distances from
    the other lines. The widths are chosen to give the required powers; their mean is about f/`sharpness`.
    """
    power = line_powers(surface, force_N, speed_m_s)
    f = speed_m_s / surface.period_m * np.arange(1, len(power) + 1)
    warp = warp_at(RATE_HZ)
    angle = warped_angle(2 * np.pi * f / RATE_HZ, warp)
    steep = (1 - warp**2) / (1 + warp**2 - 2 * warp * np.cos(2 * np.pi * f / RATE_HZ))  # d angle over d ω
    apart = np.cos(angle)[:, None] - np.cos(angle)
    np.fill_diagonal(apart, 1.0)
    width = 1 / (power * steep * np.sin(angle) ** 2 * np.prod(apart**2, axis=1))
    share = width / steep * RATE_HZ / (2 * np.pi) / f  # width in Hz over frequency
    share *= np.exp(-np.mean(np.log(share))) / surface.sharpness
    width = np.clip(share, 0.2 / surface.sharpness, 5 / surface.sharpness) * f * 2 * np.pi / RATE_HZ * steep
    a = np.array([1.0])
    for theta, w in zip(angle, width, strict=True):
        r = math.exp(-w / 2)
        a = np.convolve(a, [1.0, -2 * r * math.cos(theta), r * r])
    return a


def noise_model(surface: Surface, force_N: float, speed_m_s: float, bins: int = 4096) -> Array:
    """Return the warped filter of a random profile, by linear prediction from its warped spectrum."""
    phase = np.linspace(0.0, np.pi, bins + 1)
    f = warped_angle(phase, -warp_at(RATE_HZ)) * RATE_HZ / (2 * np.pi)
    density = noise_density(surface, force_N, speed_m_s, np.maximum(f, 1.0))
    density = np.maximum(density, 1e-8 * density.max())  # limits the dynamic range; lower densities are not perceptible
    r = np.fft.irfft(density)[: NOISE_ORDER + 1]
    r[0] *= 1 + 1e-9
    return np.concatenate([[1.0], solve_toeplitz(r[:-1], -r[1:])])


def texture_of(surface: Surface) -> Texture:
    """Return models at `FORCES_N` and `SPEED_COUNT` speeds, with exponents to extrapolate the level beyond them."""
    slowest = max(FELT_HZ * surface.period_m, SPEED_MIN_M_S)
    speeds = np.geomspace(slowest, SPEED_MAX_M_S, SPEED_COUNT)
    made = line_model if surface.period_m else noise_model
    places = [(F, v) for F in FORCES_N for v in speeds]
    a = np.array([made(surface, F, v) for F, v in places])
    power = power_m2_s4(surface, np.array(FORCES_N), speeds)
    level = np.log(power)
    slope_F = (level[-1, -1] - level[-2, -1]) / math.log(FORCES_N[-1] / FORCES_N[-2])
    slope_v = (level[-1, -1] - level[-1, -2]) / math.log(speeds[-1] / speeds[-2])
    warp = warp_at(RATE_HZ)
    texture = Texture.from_models(
        RATE_HZ,
        [F for F, _ in places],
        [float(f"{v:.4g}") for _, v in places],
        a=a,
        variance_m2_s4=power.ravel() / power_gain(a, warp),
        warp=warp,
        exponents=[round(slope_F, 3), round(slope_v, 3)],
    )
    lsf = np.round(texture.lsf_rad, 7)  # halves the size of the file
    variance = [float(f"{x:.6g}") for x in texture.variance_m2_s4]
    return replace(texture, lsf_rad=lsf, variance_m2_s4=np.array(variance))


def look_of(surface: Surface, pixels: int = 40) -> Look:
    """Return the appearance: a normal map of the crossing wires or yarns; other surfaces have a roughness only."""
    roughness = MATERIALS[surface.material].roughness
    if surface.form != "wires":
        return Look(roughness)
    p, r = surface.period_m, surface.depth_m / 2
    x, y = np.meshgrid(*2 * [(np.arange(pixels) + 0.5) / pixels * 2 * p])

    def strands(across: Array, along: Array, phase: float) -> Array:
        i, near = np.floor(across / p), across % p - p / 2
        arc = np.sqrt(np.maximum(r**2 - near**2, 0.0))
        wave = r / 2 * np.cos(np.pi * (along / p - 0.5) + np.pi * (i + phase))
        return np.where(arc > 0.0, arc + wave, -r)

    height = np.maximum(strands(x, y, 0.0), strands(y, x, 1.0))
    step = 2 * p / pixels
    slope = [(np.roll(height, -1, a) - np.roll(height, 1, a)) / (2 * step) for a in (1, 0)]
    normal = np.dstack([-slope[0], slope[1], np.ones_like(x)])  # rows go down, y goes up
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    file = io.BytesIO()
    Image.fromarray(np.rint((normal + 1) * 127.5).astype(np.uint8), "RGB").quantize(64).save(file, "PNG", optimize=True)
    return Look(roughness, size_m=2 * p, normal_png=file.getvalue())


def compute(name: str) -> Swatch:
    """Return the computed swatch of a surface."""
    surface = SURFACES[name]
    material = MATERIALS[surface.material]
    tap_Hz, damping = resonance_Hz(surface, 1.0), TAP_DAMPING + material.loss / 2
    omega = 2 * math.pi * tap_Hz
    stiffness = min(contact_N_m(surface, 1.0), STIFFNESS_MAX_N_M)
    return Swatch(
        name,
        stiffness_N_m=float(f"{stiffness:.3g}"),
        friction_static=material.friction[0],
        friction_dynamic=material.friction[1],
        texture=texture_of(surface),
        taps=Taps([TAP_M_S], [round(TAP_SHARE * omega * TAP_M_S, 2)], [round(tap_Hz, 1)], [round(damping * omega, 1)]),
        albedo_rgb=material.albedo_rgb,
        look=look_of(surface),
        provenance=SOURCE.format(
            what=surface.what,
            material=material.said,
            level=HATT.format(level=surface.level) if surface.level else BOUND,
            tables=f"Looked up: {'; '.join(material.tables)}. " if material.tables else "",
            assumed=", ".join(a for a in ASSUMED if not any(t.startswith(a) for t in material.tables)),
            more=surface.more,
        ),
        licence=LICENCE,
    )


def main(folder: Path) -> None:
    """Compute all swatches and write them to a folder with an index; each is tagged with its kind."""
    entries = []
    for name in SURFACES:
        swatch = compute(name)
        save_swatch(swatch, folder / f"{name}.swatch")
        file = (folder / f"{name}.swatch").read_bytes()
        entry = entry_of(swatch, file, tags=("computed", name.partition("-")[0]))
        entries.append(replace(entry, file=f"{name}.swatch"))
    write_index(folder, entries)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) == 2 else Path(__file__).parent / "computed")
