"""What laying strokes gives."""

from dataclasses import dataclass

from fdjax.plan.toolpath import Road


@dataclass(frozen=True, eq=False)
class Laid:
    """The roads in the order in which they are laid, and as roads what was left out for room."""

    roads: tuple[Road, ...] = ()
    left_out: tuple[Road, ...] = ()
