"""Haptography: from a recording of a tool on a surface to a swatch, and how good it is.

```python
import numpy as np
import hapscene
force_N, speed_m_s = np.full(20_000, 1.0), np.full(20_000, 0.1)  # two seconds at 10 kHz
wood = hapscene.load_swatch("wood")
acceleration_m_s2 = hapscene.capture.synthesize(wood, force_N, speed_m_s, rate_Hz=10_000.0)  # or recorded
recording = hapscene.capture.SurfaceRecording(10_000.0, acceleration_m_s2, force_N, speed_m_s)
swatch = hapscene.capture.fit_swatch(recording)
```

| package | contents |
|---|---|
| `io` | reads recordings of all formats in SI units: `load_recording`; HaTT and HJIF files |
| `record` | records from a probe on a serial port, aligns several clocks, shows what a recording lacks |
| `fit` | fits a swatch to a recording: `fit_swatch`; plays one along force and speed: `synthesize` |
| `report` | a page about a swatch; how different two surfaces feel |
| `batch` | fits thousands of recordings: `fit_batch` |
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
