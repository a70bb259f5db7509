"""Reports on swatches.

| module | content |
|---|---|
| `page` | HTML report on a swatch: `write_report` |
| `numbers` | comparison of a texture with a recording |
| `plots` | plots of the report |
| `compare` | perceptual differences between surfaces, in just noticeable differences (JND) |
"""

__all__: list[str] = []
