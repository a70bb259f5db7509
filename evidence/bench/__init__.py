"""Benchmarks of time and accuracy: `hapscene lab bench`. `run` measures everything, `sheet` holds the figures, `page`
writes docs/results/benchmark.md, `against` compares two checkouts, `side_by_side` other renderers."""
