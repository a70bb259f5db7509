"""Reproduction of the haptography paper: `hapscene lab reproduce`. Each module covers one figure or study.

| module | does |
|---|---|
| `reproduction` | list of the figures; runs all of them and writes the page and the table of numbers |
| `result` | a figure's result: its numbers beside those of the paper, and its drawings |
| `material` | the surfaces: recordings if a folder is given, otherwise signals synthesised from the shipped swatches |
| `prediction_figure` | Figs. 2, 4 and 5: two materials, linear prediction, recorded and synthetic acceleration |
| `interpolation_table` | Section 3, Future Work: interpolation of coefficients, poles and cepstral coefficients |
| `handle_figure` | Fig. 7: Bode plots of the handle for five users with three trials each, and up to 1000 Hz |
| `remote_figure` | Fig. 8: two taps and five drags on wood by teleoperation |
| `tap_study` | Section 2: realism ratings of taps, computed from spectra |
| `paper_page` | the page |
| `penn_toolkit` | laws of level and spectrum over force and speed, from models of another toolkit |
"""
