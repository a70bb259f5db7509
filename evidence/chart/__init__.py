"""Charts of speed against accuracy for eight questions: `hapscene lab chart`.

`question` defines a question, `run` lists them; each question has one module. `measuring` holds what they share.
"""
