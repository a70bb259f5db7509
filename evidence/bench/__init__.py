"""Benchmarks: time and accuracy of hapscene on cases with known answers. `hapscene lab bench` runs them.

| module | does |
|---|---|
| `run` | the whole benchmark in order: start here |
| `case` | what is touched, and the tool's path |
| `tick_time`, `start_time` | time of contact, tick, `run` and `step`; of the start of a process |
| `crowd`, `deform` | many bodies, at rest and moving; a body whose shape changes |
| `accuracy` | error of force and proxy |
| `order`, `synthesis`, `surface_fit` | textures of many orders; synthesis without a tick; fits |
| `twin_time`, `handle` | the closed loop of hand, device and handle; the handle's compensators, error against time |
| `teleoperation` | what a hand feels through leader and follower: for `hapscene lab reproduce` |
| `against`, `against_worker` | another checkout in turn: `hapscene lab bench --against`; one of its processes |
| `side_by_side`, `side_by_side_page` | other renderers in turn: `python -m hapscene_evidence.bench.run BUILD docs` |
| `path_driver` | hapscene as one of them |
| `comparison` | ratios of two tables: `hapscene lab bench compare` |
| `sheet`, `machine` | the figures, the machine |
| `chart`, `page` | the pictures, and docs/benchmark.md |
"""
