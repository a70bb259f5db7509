"""Plans that the tests of this room use, and people who answer them."""

from collections.abc import Callable

from hapscene.study.plan import Plan, parse_plan
from hapscene.study.trial_order import Trial, trials

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


def one_block(kind: str, repeats: int) -> Plan:
    """A plan with a single block, of "alive" and "steady"."""
    names = '["alive", "steady"]' if kind == "rating" else '[["alive", "steady"]]'
    name = "stimuli" if kind == "rating" else "pairs"
    block = f'[[blocks]]\nname = "one"\nkind = "{kind}"\n{name} = {names}\nrepeats = {repeats}\n'
    return parse_plan(TEXT.split("[[blocks]]")[0] + block)


def asked(plan: Plan, person: str, place: int, answer: Callable[[Trial], int]) -> list[tuple[Trial, int]]:
    """The trials of a person and what was answered, without files."""
    found: list[tuple[Trial, int]] = []
    order = trials(plan, person, place)
    try:
        trial = next(order)
        while True:
            found.append((trial, answer(trial)))
            trial = order.send((found[-1][1], None))
    except StopIteration:
        return found
