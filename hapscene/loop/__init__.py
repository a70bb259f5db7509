"""The closed loop of device, tick and handle, and the one driver that runs it, simulated or in real time."""
