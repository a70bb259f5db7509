"""Device drivers, one small file each. `hapscene.device.driver` describes their interface."""
