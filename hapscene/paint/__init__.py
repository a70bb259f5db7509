"""The painter: what may be done to a scene, shown small enough to be quick, saved so that nothing is lost.

| module | does |
|---|---|
| `session` | every operation on a scene, each a step that can be undone: start here |
| `canvas`, `keep`, `tuning` | what a session is built of: the steps, the file, the swatches and their numbers |
| `history`, `change` | the steps, packed; what changed since a view last looked |
| `shape`, `pick`, `brush`, `stroke`, `fill` | a mesh prepared to be painted, and which faces are reached |
| `parameter` | a swatch's numbers with their limits |
| `display`, `reduce` | the scene as it is shown: reduced, in chunks |
| `save`, `autosave` | the scene file, never over another's work; recovery of a killed process |
| `shelf`, `word`, `heard` | the swatches to choose from, told in words and by ear |

No module of these knows a browser, or imports viser.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
