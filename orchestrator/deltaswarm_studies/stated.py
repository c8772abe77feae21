"""Check that the numbers in a finding's text occur among the results that it rests on."""

import math
import re
from collections.abc import Iterable, Iterator

NUMBER = r"\d+(?:\.\d+)?"
RATIOS = re.compile(rf"({NUMBER})(?:(?: to | or )({NUMBER}))? times")
SHARES = re.compile(rf"({NUMBER})(?: to ({NUMBER}))? % (?:more|fewer|less|longer|sooner|later)")
MEDIANS = re.compile(rf"({NUMBER})(?: s)? instead of ({NUMBER})")


def unsupported(text: str, estimates: Iterable[float], medians: Iterable[float]) -> Iterator[str]:
    """Yield each number in a finding's text that is not among the results, as written there.

    `0.5 to 0.7 times` must be ratios among the `estimates`, whichever side is above, `12 % more` the change that one of
    them is, and `65 instead of 409` two of the `medians`, all rounded as the words have them.
    """
    ratios = [side for ratio in estimates if ratio > 0 for side in (ratio, 1 / ratio)]
    shares = [abs(ratio - 1) * 100 for ratio in ratios]
    words = " ".join(text.split())
    for pattern, found in ((RATIOS, ratios), (SHARES, shares), (MEDIANS, list(medians))):
        for match in pattern.finditer(words):
            if not all(_is_among(stated, found) for stated in match.groups() if stated):
                yield match.group()


def _is_among(stated: str, found: Iterable[float]) -> bool:
    """Return whether a number, rounded to as many decimals as are stated, is the stated one."""
    decimals = len(stated.partition(".")[2])
    half = 0.5 * 10.0**-decimals
    return any(math.isclose(number, float(stated), rel_tol=0, abs_tol=half * (1 + 1e-9)) for number in found)
