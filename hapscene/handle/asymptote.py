"""The mass of the handle at first sight, from where acceleration over force is flat."""

from collections.abc import Sequence

import numpy as np

from hapscene.errors import HandleError
from hapscene.handle.identification import Interval
from hapscene.handle.response import Response


def asymptote(responses: Sequence[Response]) -> tuple[float, Interval]:
    """First estimate of m_h [kg]: |F/A| in the octave in which it is flattest over all grips; and that octave [Hz].

    At high frequency |A/F| → 1/m_h. Below, spring and hand bend it, above, amplifier and accelerometer; the flattest
    octave lies between. What bend is left there, about 1 %, the fit of the whole model takes out.
    """
    best: tuple[float, float, Interval] | None = None
    lowest = max(response.frequency_Hz[0] for response in responses)
    highest = min(response.frequency_Hz[-1] for response in responses)
    whole = highest > 1.9 * lowest  # mean frequencies of bands lie inside the octave that was played
    for low in np.geomspace(lowest, max(highest / 2.0, lowest), 50) if whole else ():
        parts = []
        for response in responses:
            within = (response.frequency_Hz >= low) & (response.frequency_Hz <= 2.0 * low)
            parts.append(np.log(np.abs(response.response[within])))
        level = np.concatenate(parts)
        if len(level) >= 3 and (best is None or level.std() < best[0]):
            best = float(level.std()), float(np.exp(-level.mean())), (float(low), float(2.0 * low))
    if best is None:
        raise HandleError("the responses share no octave in which the mass of the handle could be seen")
    return best[1], best[2]
