"""Plugins that come with hapscene, through the same entry points as anybody's."""
