"""Scenes of one body."""

import trimesh

import hapscene
from hapscene.scene.mesh import Mesh


def scene_of(kind, swatch="wood"):
    creation = trimesh.creation
    if kind == "sphere":
        made = creation.icosphere(subdivisions=4, radius=0.05)
    else:
        made = creation.box((0.08, 0.08, 0.08)).subdivide().subdivide()
    scene = hapscene.Scene()
    scene.add(Mesh.from_trimesh(made, "m"), name="body", swatch=swatch)
    return scene
