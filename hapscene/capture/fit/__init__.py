"""Fit the models of a swatch to recordings; `hapscene.capture` exports `fit_swatch` and `FitOptions`.

| module | does |
|---|---|
| `swatch` | all fits in order: `fit_swatch` |
| `segment`, `change_point` | cut a recording by interaction state, and sliding where its vibration changes |
| `windows`, `texture` | analysis windows of sliding; AR models over force and speed |
| `order`, `whittle` | the order of the models, on held-out data; AR models over the sensor's white noise |
| `modulation` | amplitude modulation of the texture |
| `taps`, `friction`, `stiffness`, `contact` | the other fits |
| `synthesis` | vibration of a swatch along force and speed: `synthesize` |
| `distance` | distances between spectra and between spectrograms |
"""

__all__: list[str] = []
