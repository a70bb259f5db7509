"""Painted scenes for other programs, and back: what may be written and read.

    from hapscene.exchange import EXPORTS, export_scene, import_scene
    export_scene(scene, "painted.glb")
    scene = import_scene("painted.glb")

What each format keeps and loses is in docs/exchange.md, as measured by round trip.
"""

from hapscene.exchange.registry import EXPORTS, Export, export_scene, import_scene, is_mesh_of, painted_scene

__all__ = ["EXPORTS", "Export", "export_scene", "import_scene", "is_mesh_of", "painted_scene"]
