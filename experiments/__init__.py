"""Experiments made with hapscene: stability beyond the critical limits, and teleoperation over a line with delay.

Installed as `hapscene_experiments`. One study a file: each that one command alone calls stands by itself for that.

| module | does |
|---|---|
| `stability_page` | docs/stability.md from all of the cases: `python -m hapscene_experiments.stability_page` |
| `stabiliser_case` | every stabiliser on the same cases: rest, energy, stiffness kept, cost |
| `friction_case` | friction with known answers: F1 to F4 |
| `texture_case` | no filter explodes, no texture drives a hand: L1 to L3, and textures on bare motors |
| `life_case` | textures that live, switch and go on, folded into the force of a stiff wall |
| `handle_case` | the handle's sensor later and slower than believed; coils that meet their stops |
| `moving_case` | walls that move, tools that fly through, pushed bodies, games that stall |
| `border_case` | a border between stiff and soft under a stroke, sharp and blended |
| `field_case` | guides, magnets and viscosities that are too much for a device |
| `zoo_case`, `zoo_hand` | the zoo's hard meshes and paths in closed loop, and the hand that goes along them |
| `held_out` | swatches of one part of a recording against another part: `python -m hapscene_experiments.held_out` |
| `delay_study` | position–position and wave variables over a line with delay: `python -m …delay_study FOLDER` |
| `teleoperation` | what a hand feels through leader and follower, by compensator |
| `level_prior` | how loud surfaces get with force and speed, learnt from many: `python -m …level_prior FOLDER` |
| `haptography` | the tables of docs/haptography.md: `python -m …haptography RECORDINGS PAGE` |
| `paper` | the haptography paper, its figures and numbers beside ours: `hapscene lab reproduce` |
"""
