"""Many problems of one shape at once: what `vmap` of a solver does.

Problems lie side by side along the last axis, a few at a time, so that every operation has long
rows whatever the lattice. They run some iterations, and are sorted anew by how far each has come:
so none waits long for a slower one.
"""

import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

AT_ONCE = 200_000
"""Nodes side by side: with more they would not fit in a cache, with fewer rows are short."""


def batched(alone: Callable[..., Any], together: Callable[..., Any]) -> Callable[..., Any]:
    """A function of one problem, of which `vmap` is `together`: a function of any number of them.

    The leading axis of every argument and result of `together` counts the problems; nested maps
    are one.
    """
    many = jax.custom_batching.custom_vmap(together)

    @many.def_vmap
    def _of_many(count: int, are_batched: Any, *arguments: Any) -> tuple[Any, Any]:
        arguments = _repeated(count, are_batched, arguments)
        own = jax.tree.leaves(arguments)[0].shape[1]
        found = many(*jax.tree.map(lambda u: u.reshape(count * own, *u.shape[2:]), arguments))
        found = jax.tree.map(lambda u: u.reshape(count, own, *u.shape[1:]), found)
        return found, jax.tree.map(lambda _: True, found)

    one = jax.custom_batching.custom_vmap(alone)

    @one.def_vmap
    def _of_one(count: int, are_batched: Any, *arguments: Any) -> tuple[Any, Any]:
        found = many(*_repeated(count, are_batched, arguments))
        return found, jax.tree.map(lambda _: True, found)

    return one


def _repeated(count: int, are_batched: Any, arguments: tuple) -> tuple:
    return jax.tree.map(
        lambda u, own: u if own else jnp.broadcast_to(u, (count, *u.shape)),
        arguments,
        tuple(are_batched),
    )


def in_lanes(
    advance: Callable[[Any, Any], Any],
    problems: Any,
    states: Any,
    left: Callable[[Any, Any], Array],
    nodes: int,
) -> Any:
    """States of all problems after as many rounds as it takes until nothing is left to do.

    - `problems`, `states`: pytrees of arrays, the problems along the first axis.
    - `advance(problems, states)`: states after some iterations of a few problems, which lie along
      the last axis.
    - `left(problems, states)`: for each problem, along the first axis, a measure of what is left to
      do, zero when it is done.
    - `nodes`: those of one problem.
    """
    count = jax.tree.leaves(states)[0].shape[0]
    # A power of two: whole vectors of a processor.
    lots = -(-count // 2 ** int(math.log2(max(AT_ONCE / nodes, 1))))
    size = -(-count // lots)
    # The last one again makes the lots equal.
    own = jnp.minimum(jnp.arange(lots * size), count - 1)
    problems, states = jax.tree.map(lambda u: u[own], (problems, states))

    def one_round(states: Any) -> Any:
        order = jnp.argsort(left(problems, states))

        def lot(places: Array) -> Any:
            chosen = jax.tree.map(lambda u: jnp.moveaxis(u[places], 0, -1), (problems, states))
            return jax.tree.map(lambda u: jnp.moveaxis(u, -1, 0), advance(*chosen))

        found = jax.lax.map(lot, order.reshape(lots, size))
        return jax.tree.map(
            lambda old, new: old.at[order].set(new.reshape(old.shape)), states, found
        )

    states = jax.lax.while_loop(
        lambda states: (left(problems, states) > 0).any(), one_round, states
    )
    return jax.tree.map(lambda u: u[:count], states)
