"""How a lattice is sewn to itself: not at all, as a ring along eta, or along a cut to a hole."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Array, Bool, Float

from fdjax.grid import block_tridiagonal, operators
from fdjax.grid.algebraic import between_walls
from fdjax.grid.block_tridiagonal import Factors
from fdjax.grid.operators import GridEquations, Stencil
from fdjax.grid.transfer import Pair, each, interior, rejoined


@dataclass(frozen=True)
class Seam:
    """Which nodes of a lattice repeat others, and which stay where they are.

    - `closed`: a ring along eta: each of its nodes once in the columns between the first and the
      last, which are copies of those across the cut.
    - `tail`: of a C-grid: its side xi = 0 is the second row, which is the hole's wall from column
      `tail` to as many from the end, and elsewhere a cut, laid double, whose nodes are free. The
      first row is what lies across the cut: the third row, turned round. 0 for none.
    """

    closed: bool = False
    tail: int = 0

    def whole(self, r: Float[Array, "ni nj 2"]) -> Float[Array, "ni nj 2"]:
        """The lattice with the nodes that repeat others made copies of these."""
        if self.tail:
            return r.at[0].set(r[2, ::-1])
        return rejoined(r) if self.closed else r

    def free(self, pair: Pair) -> Pair:
        """Planes with zeros at nodes that stay where they are."""
        if not self.tail:
            return each(interior, pair)
        return each(lambda plane: interior(plane).at[1, self._wall].set(0.0), pair)

    @property
    def _wall(self) -> slice:
        return slice(self.tail, -self.tail)

    def own(self, pair: Pair) -> Pair:
        """The planes without the row that lies across the cut, where there is none to a hole."""
        return each(lambda plane: plane[1:], pair) if self.tail else pair

    def cold(self, r: Float[Array, "ni nj 2"]) -> Float[Array, "ni nj 2"]:
        """The transfinite lattice between the walls of this one, and the cut as it is."""
        if not self.tail:
            return between_walls(r)
        return self.whole(r.at[1:].set(between_walls(r[1:])))

    def mean_correction(self, equations: GridEquations, pair: Pair) -> Float[Array, "*lanes"]:
        """As `operators.mean_correction`, of the nodes that are free."""
        if not self.tail:
            return operators.mean_correction(equations, pair)
        inside = np.ones([count - 2 for count in pair[0].shape])
        inside[0, self.tail - 1 : -self.tail + 1] = 0
        return operators.mean_correction(equations, pair, inside)

    def folded(self, pair: Pair) -> Bool[Array, "*lanes"]:
        """Whether a cell has a corner that is not convex."""
        return operators.folded(self.own(pair))

    def factor(self, stencil: Stencil) -> Factors:
        """The equations at the interior nodes eliminated: of nodes that stay, no change."""
        return block_tridiagonal.factor(stencil, closed=self.closed, tail=self.tail)


OPEN = Seam()
