"""Simulated devices: a point mass, the Phantom Omni, the hand that holds them."""
