"""Benchmarks of time and accuracy: `hapscene lab bench`.

| module | content |
|---|---|
| `run` | runs the whole benchmark: start here |
| `case` | meshes and tool paths |
| `tick_time`, `start_time` | time of contact, tick, `run` and `step`; start of a process |
| `crowd`, `deform` | many bodies, at rest and moving; a deforming body |
| `accuracy` | errors of force and proxy |
| `synthesis`, `surface_fit` | synthesis without a tick; fits |
| `twin_time`, `handle` | closed loop of hand, device and handle; error and time of the handle's compensators |
| `against`, `against_worker` | comparison with another checkout: `hapscene lab bench --against`; its worker process |
| `side_by_side`, `side_by_side_page` | other renderers: `python -m hapscene_evidence.bench.run BUILD docs/results` |
| `path_driver` | hapscene as one of these renderers, and their file formats |
| `sheet`, `machine` | the figures; properties of the machine |
| `chart`, `page` | pictures, and docs/results/benchmark.md |
"""
