"""The painter: what may be done to a scene, shown small enough to be quick, saved so that nothing is lost.

| module | does |
|---|---|
| `session` | brush, fill and all else that may be done to a scene, each a step that can be undone: start here |
| `painting`, `document`, `swatch_tuning`, `history` | its parts: scene and who watches, file, swatches, steps |
| `change_watch` | what changed since a view last looked |
| `paintable_mesh` | a mesh prepared to be painted: which faces a ray, the brush or a fill reaches |
| `parameter` | a swatch's numbers with their limits |
| `display` | the scene as it is shown: reduced, in chunks |
| `shelf`, `gallery` | the swatches to choose from, told in words and by ear; the same as a page to read |
| `web` | the page in the browser: `page` is where it starts, `tools` what the pointer does, `…_panel` what is set |

No module but those of `web` knows a browser, or imports viser.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
