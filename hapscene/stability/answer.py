"""One answer of a case with a known one, and whether it is near enough."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Answer:
    """One answer: what was expected of it and what was found.

    Attributes:
        id: of the case.
        what: the quantity and its unit; a yes or no is 1 or 0.
        expected, found: its values.
        tolerance: largest error allowed.
        at_most: the answer is a bound: only what is over it is an error.
    """

    id: str
    what: str
    expected: float
    found: float
    tolerance: float
    at_most: bool = False

    @property
    def error(self) -> float:
        """Relative; absolute, in the quantity's unit, where 0 is expected. NaN where none was found."""
        apart = self.found - self.expected
        apart = 0.0 if self.at_most and apart < 0.0 else abs(apart)
        return apart / abs(self.expected) if self.expected else apart

    @property
    def ok(self) -> bool:
        return bool(self.error <= self.tolerance)
