"""Asking people: a plan of a listening or feeling study, one person's sitting, and what the answers say.

```python
import tempfile
import hapscene

plan = hapscene.study.parse_plan('''
title = "Is life noticed?"
people = 4
[stimuli.alive]
swatch = "wood"
[stimuli.steady]
swatch = "wood"
life = false
[[blocks]]
name = "life"
kind = "abx"
pairs = [["alive", "steady"]]
repeats = 10
''')
with tempfile.TemporaryDirectory() as folder, hapscene.study.Sitting(plan, folder, "P01") as sitting:
    print(sitting.trial.question, [interval.stimulus["name"] for interval in sitting.trial.intervals])
    sitting.answer(0, latency_s=1.2)
```

| module | does |
|---|---|
| `plan` | the plan, a TOML file: `load_plan` |
| `trial_order` | what one person is asked, in which order: balanced over people, seeded |
| `staircase` | the adaptive threshold, by QUEST+ |
| `sitting` | one person's run of a plan, crash-safe: `Sitting` |
| `results_file` | the answers, a CSV that is only added to |
| `simulated_person` | people whose thresholds are known: `simulate` |
| `stimulus` | the samples or the swatch of an interval |
| `playing` | plays it: headphones, a handle, a device |
| `study_server` | the page on which a person answers |
| `study_report` | the page that says what they answered |
| `statistics` | thresholds, d′, ratings and proportions, with intervals: `analyse` |
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
