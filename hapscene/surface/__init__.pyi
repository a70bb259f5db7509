from .effect import load_effect as load_effect
from .gain_modulation import GainModulation as GainModulation
from .taps import Tap as Tap
from .taps import Taps as Taps
from .texture import Texture as Texture
