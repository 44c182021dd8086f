"""Intervals: of shares, Wilson's for what is estimated, Clopper and Pearson's bound for what is promised; Student's of means."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import NormalDist, fmean, stdev


def wilson(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Wilson's score interval of a probability (E. B. Wilson, JASA 22, 1927).

    Args:
        successes: Of the trials.
        trials: At least 1.
        confidence: That the interval has the probability.

    Returns:
        Its ends.
    """
    if not 0 <= successes <= trials or trials < 1:
        raise ValueError(f"{successes} successes of {trials} trials: there must be a trial, and no more successes than trials")
    z = NormalDist().inv_cdf(0.5 + confidence / 2)
    share, more = successes / trials, z * z / trials
    middle = (share + more / 2) / (1 + more)
    half = z * math.sqrt(share * (1 - share) / trials + more / (4 * trials)) / (1 + more)
    # By hand where rounding would put an end that is 0 or 1 beside it.
    return (0.0 if successes == 0 else middle - half, 1.0 if successes == trials else middle + half)


def least_share(successes: int, trials: int, confidence: float = 0.95) -> float:
    """Clopper and Pearson's lower bound of a probability (Biometrika 26, 1934): held with at least this confidence, however few the trials.

    The probability p at which `successes` and more of the trials have the probability 1 - confidence.
    """
    if not 0 <= successes <= trials or trials < 1:
        raise ValueError(f"{successes} successes of {trials} trials: there must be a trial, and no more successes than trials")
    # Logarithms, as the coefficients are beyond the range of a float from some thousand trials on.
    counts = range(successes, trials + 1)
    ways = [math.lgamma(trials + 1) - math.lgamma(k + 1) - math.lgamma(trials - k + 1) for k in counts]
    low, high = 0.0, successes / trials
    for _ in range(60):
        middle = (low + high) / 2
        if not low < middle < high:
            break
        yes, no = math.log(middle), math.log1p(-middle)
        tail = math.fsum(math.exp(way + k * yes + (trials - k) * no) for way, k in zip(ways, counts, strict=True))
        low, high = (low, middle) if tail > 1 - confidence else (middle, high)
    return low


def trials_for(share: float, confidence: float) -> int:
    """Trials of which all must succeed for `least_share` to be at least `share`: ln(1 - confidence) / ln(share), rounded up."""
    return math.ceil(math.log(1 - confidence) / math.log(share))


def student(values: Sequence[float], confidence: float = 0.95) -> tuple[float, float]:
    """Student's interval of the mean of what independent values are drawn from (Biometrika 6, 1908).

    Args:
        values: At least two.
        confidence: That the interval has the mean.

    Returns:
        Its ends.
    """
    n = len(values)
    if n < 2:
        raise ValueError(f"{n} values: an interval of a mean needs two")
    half = student_quantile(0.5 + confidence / 2, n - 1) * stdev(map(float, values)) / math.sqrt(n)
    middle = fmean(values)
    return middle - half, middle + half


def student_quantile(probability: float, freedom: int) -> float:
    """The value that Student's t of so many degrees of freedom is below with a probability of at least a half.

    By bisection in the angle atan(t / sqrt(freedom)), whose density is a power of its cosine: there the integral is a finite sum.
    """
    if not 0.5 <= probability < 1 or freedom < 1:
        raise ValueError(
            f"a quantile for {probability} of {freedom} degrees of freedom: there must be one, and a probability from 0.5 to 1"
        )
    low, high = 0.0, math.pi / 2
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if 0.5 + _between_angles(middle, freedom) / 2 < probability else (low, middle)
    return math.sqrt(freedom) * math.tan((low + high) / 2)


def _between_angles(angle: float, freedom: int) -> float:
    """Probability that |t| is below sqrt(freedom) tan(angle): Abramowitz and Stegun, 26.7.3 and 26.7.4."""
    sine, cosine = math.sin(angle), math.cos(angle)
    odd = freedom % 2
    term, total = (cosine, 0.0) if odd else (1.0, 0.0)
    for k in range(1 + odd, freedom, 2):
        total += term
        term *= cosine * cosine * k / (k + 1)
    return 2.0 / math.pi * (angle + sine * total) if odd else sine * total
