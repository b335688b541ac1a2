"""Meshes that are given: looked through before anything is laid, and mended where that is plain."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from fdjax.errors import InputError
from fdjax.mesh.size import MOST_CELLS
from fdjax.mesh.triangulation import Triangulation

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

DIAGONALS = ("rising", "falling", "alternating")
"""How quads are split: all from their first corner, all from their second, or in turn."""

_FLAT = 1e-6
"""A triangle lower than this share of its longest side has no inside."""

_CLOSE = 1e-9
"""Nodes nearer to each other than this share of a mesh's size are one."""


@dataclass(frozen=True, eq=False)
class Given:
    """A mesh as it was given, with what was mended, one line each.

    >>> given = Given.of([(0, 0), (1, 0), (1, 1), (0, 1), (5, 5)], quads=[(0, 3, 2, 1)])
    >>> given.mesh.triangles.tolist()
    [[0, 2, 3], [0, 1, 2]]
    >>> given.notes
    ('mesh: 1 node is in no element and left out', 'mesh: all elements run clockwise; turned')
    """

    mesh: Triangulation
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, nodes: Any, triangles: Any = (), quads: Any = (), *, name: str = "mesh") -> "Given":
        """The mesh of nodes, (n, 2), mm, and of elements, (t, 3) and (q, 4), numbers from 0.

        Quads are split by their shorter diagonal, as long as both halves have an inside. Elements
        that run clockwise are turned, nodes in no element left out. Raises `InputError`, which
        begins with `name`, for nodes that are not finite, elements that name nodes which there are
        not, that are flat, or that overlap, and for more than 10^6 triangles.
        """
        xy = _array(nodes, 2, float, f"{name}: nodes")
        if not np.isfinite(xy).all():
            raise InputError(f"{name}: node {np.argmin(np.isfinite(xy).all(1))} is not finite")
        own = [
            _array(each, corners, int, f"{name}: {what}")
            for each, corners, what in ((triangles, 3, "triangles"), (quads, 4, "quads"))
        ]
        if not any(map(len, own)):
            raise InputError(f"{name}: it has no triangle or quad")
        if len(own[0]) + 2 * len(own[1]) > MOST_CELLS:
            raise InputError(f"{name}: more than {MOST_CELLS:.0e} triangles")
        for each in own:
            beyond = (each < 0) | (each >= len(xy))
            if beyond.any():
                raise InputError(
                    f"{name}: an element names node {each[beyond][0]}; there are {len(xy)}, "
                    "numbered from 0"
                )
        made = np.concatenate([own[0], _split(xy, own[1])])
        notes = []
        used, number = np.unique(made, return_inverse=True)
        if len(used) < len(xy):
            notes.append(f"{name}: {_are(len(xy) - len(used), 'node')} in no element and left out")
        xy, first = _joined(xy[used])
        made = first[number.reshape(-1, 3)]
        if len(xy) < len(used):
            notes.append(
                f"{name}: {_are(len(used) - len(xy), 'node')} on others and joined to them"
            )
        made, turned = _turned(xy, made, name)
        if turned:
            notes.append(f"{name}: {turned} clockwise; turned")
        _check_apart(xy, made, name)
        return cls(Triangulation(xy, made), tuple(notes))


def _array(values: Any, columns: int, kind: type, what: str) -> Any:
    """An array with so many columns, or a line that says what it is."""
    try:
        array = np.asarray(values, float)
    except (TypeError, ValueError):
        raise InputError(f"{what}: rows of {columns} numbers are needed") from None
    if array.size == 0:
        return np.zeros((0, columns), kind)
    if array.ndim != 2 or array.shape[1] != columns:
        raise InputError(f"{what}: an array of shape {array.shape}; (n, {columns}) is needed")
    if kind is float:
        return array
    if not (array == np.floor(array)).all():
        raise InputError(f"{what}: numbers of nodes must be whole")
    return array.astype(np.intp)


def _are(count: int, noun: str) -> str:
    return f"1 {noun} is" if count == 1 else f"{count} {noun}s are"


def _joined(xy: Floats) -> tuple[Floats, Ints]:
    """Nodes of which those at one place are one, and the new number of each."""
    size = float(np.ptp(xy, axis=0).max())
    near = KDTree(xy).query_pairs(_CLOSE * size, output_type="ndarray")
    linked = coo_array((np.ones(len(near)), tuple(near.T)), shape=(len(xy), len(xy)))
    count, number = connected_components(linked, directed=False)
    first = np.zeros(count, np.intp)
    first[number[::-1]] = np.arange(len(xy))[::-1]
    return xy[first], number.astype(np.intp)


def twice_areas(xy: Floats, triangles: Ints) -> Floats:
    """Twice the area of triangles, below 0 where they run clockwise."""
    a, b, c = np.moveaxis(xy[triangles], 1, 0)
    return (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]


def _split(xy: Floats, quads: Ints) -> Ints:
    """Two triangles of each quad, by its shorter diagonal, unless the other alone is inside."""
    if not len(quads):
        return np.zeros((0, 3), np.intp)
    ways = [quads[:, [0, 1, 2, 0, 2, 3]], quads[:, [1, 2, 3, 1, 3, 0]]]
    sense = np.sign(twice_areas(xy, ways[0][:, :3]) + twice_areas(xy, ways[0][:, 3:]))
    inside = [
        np.minimum(*(sense * twice_areas(xy, way[:, k : k + 3]) for k in (0, 3))) for way in ways
    ]
    length = [np.hypot(*(xy[quads[:, k]] - xy[quads[:, k + 2]]).T) for k in (0, 1)]
    second = (inside[1] > 0) & ((length[1] < length[0]) | (inside[0] <= 0))
    return np.where(second[:, None], ways[1], ways[0]).reshape(-1, 3)


def _turned(xy: Floats, triangles: Ints, name: str) -> tuple[Ints, str]:
    """The triangles counterclockwise, and in words which were not."""
    area = twice_areas(xy, triangles)
    sides = xy[triangles] - xy[np.roll(triangles, 1, 1)]
    flat = np.abs(area) <= _FLAT * (sides**2).sum(2).max(1)
    if flat.any():
        k = int(np.argmax(flat))
        x, y = xy[triangles[k]].mean(0)
        raise InputError(
            f"{name}: {_are(int(flat.sum()), 'element')} flat, the first at ({x:.4g}, {y:.4g}) mm"
        )
    back = area < 0
    words = "all elements run" if back.all() else f"{_are(int(back.sum()), 'element')} running"
    made = np.where(back[:, None], triangles[:, ::-1], triangles)
    # Each begins where it did.
    made = np.where(back[:, None], np.roll(made, 1, 1), made)
    return made, words if back.any() else ""


def _check_apart(xy: Floats, triangles: Ints, name: str) -> None:
    """Raise `InputError` where triangles lie on one another, or a node on another's side."""
    sides = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, count = np.unique(sides, axis=0, return_counts=True)
    if (count > 2).any():
        x, y = xy[edges[np.argmax(count > 2)]].mean(0)
        raise InputError(f"{name}: more than two elements share the side at ({x:.4g}, {y:.4g}) mm")
    faces = shapely.polygons(xy[triangles])
    if shapely.coverage_is_valid(faces):
        return
    wrong = shapely.coverage_invalid_edges(faces)
    at = wrong[~shapely.is_empty(wrong)][0]
    x, y = shapely.get_coordinates(at).mean(0)
    raise InputError(
        f"{name}: elements overlap, or a node of one lies on a side of another, at "
        f"({x:.4g}, {y:.4g}) mm"
    )


def lattice(counts: tuple[int, int], diagonal: str, *, beyond: int = 0) -> Triangulation:
    """A unit square's quads, split into triangles, and so many more rows `beyond` each side.

    - `counts`: quads along x and along y; `diagonal`: one of `DIAGONALS`.

    >>> len(lattice((3, 2), "alternating").triangles)
    12
    """
    n, m = (count + 2 * beyond for count in counts)
    i, j = np.meshgrid(np.arange(n + 1), np.arange(m + 1), indexing="ij")
    xy = (np.stack([i, j], -1) - beyond) / np.array(counts)
    node = i * (m + 1) + j
    a, b, c, d = (each.ravel() for each in (node[:-1, :-1], node[1:, :-1], node[1:, 1:],
                                            node[:-1, 1:]))  # fmt: skip
    rising = np.stack([a, b, c, a, c, d], 1)
    falling = np.stack([a, b, d, b, c, d], 1)
    first = {"rising": True, "falling": False, "alternating": (i + j)[:-1, :-1].ravel() % 2 == 0}
    triangles = np.where(np.reshape(first[diagonal], (-1, 1)), rising, falling)
    return Triangulation(xy.reshape(-1, 2), triangles.reshape(-1, 3))


def fringed(mesh: Triangulation) -> Triangulation:
    """The mesh with the mirror image of the triangle beyond each side of its rim.

    So the sides of the rim are laid where they are inside a part, and the edges of a dual reach
    them.
    """
    rim = ~mesh.inner
    left = mesh.beside[rim, 0]
    own = np.maximum(left, mesh.beside[rim, 1])
    # Counterclockwise in the mesh, so that beyond lies to the right.
    a, b = np.where((left >= 0)[:, None], mesh.edges[rim], mesh.edges[rim, ::-1]).T
    c = mesh.triangles[own].sum(1) - a - b
    along = mesh.xy[b] - mesh.xy[a]
    inward = np.stack([-along[:, 1], along[:, 0]], 1)
    height = ((mesh.xy[c] - mesh.xy[a]) * inward).sum(1) / (along**2).sum(1)
    tip = mesh.xy[c] - 2 * height[:, None] * inward
    new = len(mesh.xy) + np.arange(len(a))
    return Triangulation(
        np.concatenate([mesh.xy, tip]),
        np.concatenate([mesh.triangles, np.stack([b, a, new], 1)]),
    )
