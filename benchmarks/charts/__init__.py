"""Charts of speed against accuracy, a question each: what an approximation costs, what it buys, and what to choose.

`question` says what a question is, `QUESTIONS` of `run` lists them; each other module asks one.
"""
