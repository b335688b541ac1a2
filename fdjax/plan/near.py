"""Which of some points are nearest to a place."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_FEW = 200
"""Up to so many points are all looked at: less work than to load the library that keeps a tree."""


class Near:
    """Points, shape (n, 2), whose nearest are asked for."""

    def __init__(self, points: Floats) -> None:
        self._points = points
        self._tree = None
        if len(points) > _FEW:
            from scipy.spatial import KDTree

            self._tree = KDTree(points)

    def query(self, places: Floats, count: int) -> tuple[Floats, NDArray[np.intp]]:
        """Distances and numbers of the `count` nearest points to each place, nearest first.

        Shapes: places (m, 2), answers (m, count). Which of equally distant ones comes first is left
        open.

        >>> gaps, near = Near(np.array([(0.0, 0), (3, 0), (1, 0)])).query(np.zeros((1, 2)), 2)
        >>> gaps.tolist(), near.tolist()
        ([[0.0, 1.0]], [[0, 2]])
        """
        if self._tree is not None:
            gaps, near = self._tree.query(places, count)
            shape = len(places), count  # of one neighbour it has one dimension less
            return np.reshape(gaps, shape), np.reshape(near, shape)
        gaps = np.hypot(*(places[:, None] - self._points).T).T
        near = np.argsort(gaps, axis=1, kind="stable")[:, :count]
        return np.take_along_axis(gaps, near, axis=1), near
