"""Benchmark: time and accuracy of the tick on cases with known answers, charted one against the other.

| module | does |
|---|---|
| `run` | the whole benchmark in order: start here |
| `case` | what is touched, and the tool's path |
| `tick_time` | time of contact and tick, of `run` and `step` |
| `loop_time` | the same with cold caches; the start of a process |
| `ray` | the rays of a path, counted and timed by themselves |
| `crowd`, `instance` | many bodies: one query per body, and Embree's instances instead |
| `paint`, `paint_page` | painting; and in a browser: `paint_click`, `paint_late` (the servo), `paint_delay` (sound) |
| `paint_browser`, `paint_hand`, `idle` | the browser, the hand and the empty loop for that |
| `accuracy` | how far force and proxy are from the truth |
| `projection` | the proxy's exact solution against alternating projection |
| `order` | textures: order against time and against recordings |
| `sheet`, `machine`, `peer` | the figures, the machine, other renderers' figures |
| `chart`, `page` | the pictures, and docs/benchmark.md |
"""
