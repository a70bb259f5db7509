from .library import load_swatch as load_swatch
from .library import shipped_swatches as shipped_swatches
