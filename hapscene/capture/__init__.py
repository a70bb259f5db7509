"""Haptography: from a recording of a tool on a surface to a swatch, and how good it is.

```python
import numpy as np
import hapscene

force_N, speed_m_s = np.full(20_000, 1.0), np.full(20_000, 0.1)  # two seconds at 10 kHz
wood = hapscene.load_swatch("wood")
acceleration_m_s2 = hapscene.capture.synthesize(wood, force_N, speed_m_s, 10_000.0)  # or recorded
swatch = hapscene.capture.fit(acceleration_m_s2, 10_000.0, force_N=force_N, speed_m_s=speed_m_s)
```

| module | does |
|---|---|
| `recording_source`, `recording_file` | read a recording; `axis` makes its three axes one |
| `channel` | checks and cleans its streams |
| `segment`, `change_point` | what the tool does when; `segment_plot` draws it |
| `order` | chooses the order of the models on held-out data |
| `whittle`, `whittle_search` | AR models over the sensor's white noise |
| `piece`, `level` | what is fitted to, and how loud it is over force and speed |
| `texture_fit`, `linear_prediction` | fit the models over force and speed |
| `excitation` | chooses the noise that drives them |
| `tap_fit` | fits taps |
| `friction`, `stiffness` | fit the friction coefficients and the stiffness |
| `swatch_fit` | the above in order: `fit` |
| `synthesis` | plays a swatch along force and speed: `synthesize` |
| `metric`, `metric_residual`, `metric_vibrotactile` | how near a model is to a recording |
| `report`, `report_*` | a page about a swatch: spectra, order, residual, friction, taps |
| `compare`, `compare_*` | how different two surfaces feel, in what a person can tell |
| `hatt`, `hatt_file`, `hatt_tap`, `hatt_batch`, `arma`, `xml_source` | files of the Penn Haptic Texture Toolkit |
| `hjif` | MPEG haptics files |
| `record`, `record_meter` | record from a probe on a serial port (`hapscene.wire`) |
| `record_file` | the crash-safe file of such a recording: `load_record` |
| `record_simulator` | a probe without hardware |
| `batch`, `batch_input`, `batch_manifest`, `batch_pool`, `batch_worker` | fit thousands of recordings: `fit_batch` |
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
