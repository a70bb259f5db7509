"""Benchmarks of time and accuracy: `hapscene lab bench`. Start with `run`, which runs all of them; `sheet` holds the
figures, `page` writes docs/results/benchmark.md, `against` compares two checkouts, `side_by_side` other renderers."""
