"""Drivers of devices that can be plugged in, one small file each; `hapscene.device.driver` has their contract."""
