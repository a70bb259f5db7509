from .library import shipped_swatches as shipped_swatches
