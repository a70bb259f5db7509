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
| `io.formats`, `io.datasets` | columns of a recording's file; column maps of published data sets |
| `io.recording` | a recording in SI units: `load_recording` |
| `io.streams` | checks and filters its streams |
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
| `io.hatt`, `io.hjif` | import from the Penn Haptic Texture Toolkit; export as MPEG haptics |
| `record.recorder`, `io.hsrec` | recording from a probe on a serial port (`hapscene.wire`), crash-safe |
| `record.coverage`, `record.coverage_page` | forces and speeds that a recording still lacks |
| `record.time_alignment` | several recordings of one event joined on one clock: `join` |
| `batch`, `batch_job` | fit thousands of recordings: `fit_batch` |
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
