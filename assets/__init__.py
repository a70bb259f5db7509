"""Meshes and the demo scene that come with hapscene."""
