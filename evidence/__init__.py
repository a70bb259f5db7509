"""Benchmarks, charts and the reproduction of the paper. Installed from a checkout as `hapscene_evidence`.

| package | content |
|---|---|
| `bench` | time and accuracy of the tick, comparison with other renderers: `hapscene lab bench` |
| `chart` | speed against accuracy for eight questions: `hapscene lab chart` |
| `paper` | the haptography paper, its numbers beside those found here: `hapscene lab reproduce` |
| `page` | pages of all three, as Markdown and HTML |
"""
