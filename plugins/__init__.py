"""Plugins that hapscene ships, registered through the same entry points as third-party plugins."""
