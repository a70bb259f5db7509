"""Fits the models of a swatch to recordings; `hapscene.capture` exports `fit_swatch` and `FitOptions`.

| module | content |
|---|---|
| `swatch` | `fit_swatch`, which runs all fits; `verdict` on what the swatch can be used for |
| `segment`, `change_point` | segmentation by interaction state, and of sliding where the vibration changes |
| `windows`, `texture` | analysis windows of sliding; AR models over force and speed |
| `order`, `whittle` | choice of the model order on held-out data; AR models with sensor noise |
| `modulation` | amplitude modulation of the texture |
| `taps`, `friction`, `stiffness`, `contact` | fits of the other quantities |
| `synthesis` | `synthesize`: acceleration of a swatch for given force and speed |
| `distance` | spectral distances, band powers, amplitude modulation |
"""

__all__: list[str] = []
