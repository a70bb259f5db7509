"""Reproduction of the haptography paper: `hapscene lab reproduce`. `reproduction` lists the figures, a module each."""
