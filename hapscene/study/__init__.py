"""User studies of perception: a plan of stimuli and questions, sessions of participants, and the statistical analysis.

```python
import tempfile
import hapscene
plan = hapscene.study.parse_plan('''
title = "Is the amplitude modulation perceived?"
people = 4
[stimuli.modulated]
swatch = "wood"
[stimuli.steady]
swatch = "wood"
life = false
[[blocks]]
name = "modulation"
kind = "2ifc"
pairs = [["modulated", "steady"]]
question = "Which of the two varies more?"
repeats = 10
''')
with tempfile.TemporaryDirectory() as folder, hapscene.study.Session(plan, folder, "P01") as session:
    print(session.trial.block.question, [interval.stimulus.name for interval in session.trial.intervals])
    session.answer(0, latency_s=1.2)
```
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
