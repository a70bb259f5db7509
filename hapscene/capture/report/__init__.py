"""Reports on swatches.

| module | does |
|---|---|
| `page` | one HTML page on a swatch: `write_report` |
| `numbers` | the figures on the page: a model of half a recording, judged by the other half |
| `plots` | the plots on the page |
| `states` | a picture of a recording's interaction states |
| `compare` | differences between surfaces in just noticeable differences |
"""

__all__: list[str] = []
