"""Level of detail: simplifies a scene as far as a person cannot perceive the difference.

| module | content |
|---|---|
| `coarser_mesh` | reduces a mesh, and keeps the borders of its painting |
| `trial` | measures how far a simplified scene differs from the original, in JND |
| `tune` | searches the simplest scene whose difference is not perceptible, and makes it |
"""
