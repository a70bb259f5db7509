"""Charts of speed against accuracy: what an approximation costs, what it buys, and what to choose.

`question` says what a question is, `run` lists the eight questions; each of their modules asks one.
"""
