"""Evidence: what is measured of hapscene. Installed as `hapscene_evidence` from a checkout; it is not in the wheel.

| package | does |
|---|---|
| `bench` | time and accuracy of the tick, other renderers beside it: `hapscene lab bench` |
| `chart` | speed against accuracy, eight questions: `hapscene lab chart` |
| `paper` | the haptography paper, its figures and numbers beside ours: `hapscene lab reproduce` |
| `page` | the pages of all three, as Markdown and as HTML |
"""
