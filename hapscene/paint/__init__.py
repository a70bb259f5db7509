"""The painter: paint swatches onto a scene, in a program (`model`) or in the browser (`web`).

    session = Session(scene, Path("cup.scene.json"))
    session.add_swatch("wood")
    session.begin_stroke("wood", radius_m=0.004)
    session.drag_to(origin_W_m, direction_W)     # as often as the pointer moves
    session.end_stroke()
    session.tune("wood", stiffness_N_m=350.0)
    session.undo()
    session.save()

`model.session` is the start; only the modules of `web` import viser.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
