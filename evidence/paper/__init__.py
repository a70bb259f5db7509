"""The haptography paper, reproduced: `hapscene lab reproduce`. One figure of it a file; start with `reproduction`.

| module | does |
|---|---|
| `reproduction` | the table of figures, and the command: all of them, the page and the table of numbers |
| `finding` | what a figure gives: numbers, the paper's beside ours and how each is known, and drawings |
| `material` | the surfaces: recordings of real ones where they are given, else what shipped swatches synthesise |
| `prediction_figure` | Figs. 2, 4 and 5: two materials; linear prediction, real against synthetic |
| `handle_figure` | Fig. 7: Bode plots of the handle in five hands, three trials each; beyond it to 1000 Hz |
| `remote_figure` | Fig. 8: two taps and five drags on wood, felt through a leader |
| `tap_study` | the study of taps, with simulated raters |
| `paper_page` | the page: the figures, Table 1, what is assumed |
"""
