"""Where the tool touches: rays through Embree, and the proxy that stays on the surface."""
