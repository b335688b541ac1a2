"""Points in pairs, so that the distances within the pairs together are short."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from fdjax.plan.near import Near

Floats = NDArray[np.float64]

_NEIGHBOURS = 10
"""So many nearest points a point may be newly paired with."""

_GAIN = 1e-9


def pairs(points: Floats) -> NDArray[np.intp]:
    """Pairs of points, (n / 2, 2), of an even number of them, (n, 2), with little distance in all.

    The nearest two first; then, while one shortens the whole, two pairs exchange their partners so
    that a point is paired with one of its neighbours. On the nodes of a honeycomb's dual that is
    2 to 6 % above the least there is, in time that grows little faster than n.

    >>> pairs(np.array([(0.0, 0), (5, 0), (6, 0), (0.5, 0)])).tolist()
    [[0, 3], [1, 2]]
    """
    count = len(points)
    if not count:
        return np.zeros((0, 2), np.intp)
    distance, near = Near(points).query(points, min(_NEIGHBOURS + 1, count))
    mate = _nearest_first(points, distance, near)
    at: list[complex] = (points[:, 0] + 1j * points[:, 1]).tolist()
    neighbours = near.tolist()
    waiting = deque(range(count))
    while waiting:
        a = waiting.popleft()
        b = mate[a]
        now, best, exchange = abs(at[a] - at[b]), _GAIN, None
        for c in neighbours[a]:
            if c in (a, b):
                continue
            won = now - abs(at[a] - at[c])
            if won <= _GAIN:
                break
            d = mate[c]
            won += abs(at[c] - at[d]) - abs(at[b] - at[d])
            if won > best:
                best, exchange = won, (c, d)
        if exchange is not None:
            c, d = exchange
            mate[a], mate[c], mate[b], mate[d] = c, a, d, b
            waiting.extend((a, b, c, d))
    return np.array([(a, b) for a, b in enumerate(mate) if a < b], np.intp)


def _nearest_first(points: Floats, distance: Floats, near: NDArray[np.intp]) -> list[int]:
    """The partner of each point: always the two that are nearest of those left over."""
    mate = [-1] * len(points)
    own = np.repeat(np.arange(len(points)), near.shape[1])
    for place in np.argsort(distance.ravel(), kind="stable").tolist():
        a, b = int(own[place]), int(near.flat[place])
        if a != b and mate[a] < 0 and mate[b] < 0:
            mate[a], mate[b] = b, a
    left = [a for a, b in enumerate(mate) if b < 0]
    while left:
        a = left.pop()
        b = left.pop(int(np.argmin(np.hypot(*(points[left] - points[a]).T))))
        mate[a], mate[b] = b, a
    return mate
