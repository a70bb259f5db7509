"""Haptography: fits swatches to recordings of a tool on a surface, and evaluates the fits.

```python
import numpy as np
import hapscene
force_N, speed_m_s = np.full(20_000, 1.0), np.full(20_000, 0.1)  # two seconds at 10 kHz
wood = hapscene.load_swatch("wood")
acceleration_m_s2 = hapscene.capture.synthesize(wood, force_N, speed_m_s, rate_Hz=10_000.0)  # or recorded
recording = hapscene.capture.SurfaceRecording(10_000.0, acceleration_m_s2, force_N, speed_m_s)
swatch = hapscene.capture.fit_swatch(recording)
```

| module | contents |
|---|---|
| `recorder` | records from a probe on a serial port |
| `time_alignment` | aligns recordings with different clocks: `join` |
| `io` | reads recordings in several formats: `load_recording`; imports HaTT files |
| `fit` | fits a swatch to a recording: `fit_swatch`; synthesises vibration for force and speed: `synthesize` |
| `report` | HTML reports on swatches; perceptual comparison of surfaces |
| `batch` | fits swatches to many recordings in parallel: `fit_batch` |
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
