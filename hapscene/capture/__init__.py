"""Haptography: from a recording of a tool on a surface to a swatch, and how good it is.

```python
import numpy as np
import hapscene

force_N, speed_m_s = np.full(20_000, 1.0), np.full(20_000, 0.1)  # two seconds at 10 kHz
wood = hapscene.load_swatch("wood")
acceleration_m_s2 = hapscene.capture.synthesize(wood, force_N, speed_m_s, rate_Hz=10_000.0)  # or recorded
swatch = hapscene.capture.fit(acceleration_m_s2, 10_000.0, force_N=force_N, speed_m_s=speed_m_s)
```

| module | does |
|---|---|
| `recording_source`, `recording_file` | read a recording: `load_recording` |
| `streams` | checks and cleans its streams |
| `segment`, `change_point` | what the tool does when; `segment_plot` draws it |
| `texture_pieces` | what a texture is fitted to, and how loud it is over force and speed |
| `order_search`, `whittle` | the order of the models, on held-out data; AR models over the sensor's white noise |
| `texture_fit` | the models over force and speed |
| `tap_fit`, `friction`, `stiffness` | the other fits |
| `swatch_fit` | the above in order: `fit` |
| `synthesis` | plays a swatch along force and speed: `synthesize` |
| `metric` | how near a model is to a recording |
| `report`, `report_numbers`, `report_plots` | a page about a swatch: spectra, order, residual, friction, taps |
| `compare` | how different two surfaces feel, in what a person can tell |
| `hatt`, `hatt_file`, `arma` | files of the Penn Haptic Texture Toolkit |
| `hjif` | MPEG haptics files |
| `record`, `record_file` | record from a probe on a serial port (`hapscene.wire`), crash-safe |
| `record_many` | from several at once, each in a process of its own |
| `record_simulator` | a probe without hardware |
| `clock_offset`, `recording_join` | how the clocks of two recordings differ; several files made one: `join` |
| `batch`, `batch_job` | fit thousands of recordings: `fit_batch` |
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
