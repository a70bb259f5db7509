"""Drivers: one small file each, found through the entry-point group `hapscene.devices`."""
