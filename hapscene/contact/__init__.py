"""Contact computation: ray casts with Embree, and the proxy (god-object) that stays on the surface."""
