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

| module | does |
|---|---|
| `recording_source`, `recording_file` | read a recording: `load_recording` |
| `streams` | checks and cleans its streams |
| `fit` | fit a swatch to a recording: `fit_swatch`; play one along force and speed: `synthesize` |
| `report` | a page about a swatch; how different two surfaces feel |
| `hatt`, `hatt_file` | files of the Penn Haptic Texture Toolkit |
| `hjif` | MPEG haptics files |
| `record`, `record_file` | record from a probe on a serial port (`hapscene.wire`), crash-safe |
| `record_many` | from several at once, each in a process of its own |
| `record_simulator` | a probe without hardware |
| `clock_offset`, `recording_join` | how the clocks of two recordings differ; several files made one: `join` |
| `batch` | fit thousands of recordings: `fit_batch` |
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
