"""Perceptual studies: a plan of what is played and asked, one participant's session, and the analysis of answers.

```python
import tempfile
import hapscene
plan = hapscene.study.parse_plan('''
title = "Is the amplitude modulation noticed?"
people = 4
[stimuli.alive]
swatch = "wood"
[stimuli.steady]
swatch = "wood"
life = false
[[blocks]]
name = "livelier"
kind = "2ifc"
pairs = [["alive", "steady"]]
question = "Which of the two is livelier?"
repeats = 10
''')
with tempfile.TemporaryDirectory() as folder, hapscene.study.Sitting(plan, folder, "P01") as sitting:
    print(sitting.trial.block.question, [interval.stimulus.name for interval in sitting.trial.intervals])
    sitting.answer(0, latency_s=1.2)
```
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
