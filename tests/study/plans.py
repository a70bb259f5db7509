"""Plans that the tests of this room use, and people who answer them."""

TEXT = """
title = "Is life noticed?"
channel = "headphones"
seed = 1
people = 12
[stimuli.alive]
swatch = "wood"
[stimuli.steady]
swatch = "wood"
life = false
[stimuli.rough]
swatch = "paper"
[[blocks]]
name = "real"
kind = "rating"
stimuli = ["alive", "steady", "rough"]
repeats = 4
[[blocks]]
name = "life"
kind = "2ifc"
pairs = [["alive", "steady"]]
repeats = 8
[[blocks]]
name = "louder"
kind = "2ifc"
pairs = [["alive", "steady"], ["rough", "steady"]]
repeats = 4
[[blocks]]
name = "gain"
kind = "staircase"
stimulus = "alive"
parameter = "gain_dB"
levels = [0.25, 8.0, 32]
trials = 20
"""
