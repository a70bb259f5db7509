"""No more than a scene needs: how finely each part of a scene is rendered.

`fidelity` says what may be coarser, and makes the coarser scene.
"""
