"""Benchmarks: time and accuracy of hapscene on cases with known answers, charted one against the other.

Installed as `hapscene_benchmarks`; `hapscene lab bench` runs all but painting. One measurement a file: each that `run`
alone calls stands by itself because it measures one thing.

| module | does |
|---|---|
| `run` | the whole benchmark in order: start here |
| `case` | what is touched, and the tool's path |
| `tick_time` | time of contact and tick, of `run` and `step` |
| `loop_time` | the same with cold caches; the start of a process |
| `ray` | the rays of a path, counted and timed by themselves |
| `crowd` | many bodies, at rest and moving |
| `accuracy` | how far force and proxy are from the truth |
| `projection` | the proxy's exact solution against alternating projection |
| `order` | textures: order against time and against recordings |
| `synthesis` | textures made without a tick, beside SciPy's filter |
| `twin_time` | the closed loop of hand, device and handle |
| `handle` | the handle's compensators: error against time |
| `paint` | painting large meshes: `python -m hapscene_benchmarks.paint` |
| `paint_page` | the painter's page in a browser: `python -m hapscene_benchmarks.paint_page` |
| `paint_browser`, `idle`, `screen` | for that: the browser and a hand, an empty loop, a screen where there is none |
| `side_by_side`, `side_by_side_page` | other renderers, by `python -m hapscene_benchmarks.run` |
| `path_driver` | hapscene as one of them, in a process of its own |
| `sheet`, `machine`, `peer` | the figures, the machine, other renderers' figures |
| `charts` | speed against accuracy, a question each: `hapscene lab chart`; `charts.run` lists them |
| `comparison` | two tables of figures: `hapscene lab bench compare` |
| `chart`, `page`, `markdown` | the pictures, docs/benchmark.md, and what such pages are made of |
"""
