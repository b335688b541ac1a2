"""Meshes from files of any kind that meshio reads. Loads it when a file is read, not before."""

import contextlib
import io
import warnings
from pathlib import Path

import numpy as np

from fdjax.errors import InputError
from fdjax.mesh.given import Given

_CORNERS = {"triangle": 3, "triangle6": 3, "triangle7": 3, "quad": 4, "quad8": 4, "quad9": 4}
"""Elements that are laid, with the number of their corners, which come first."""

_IGNORED = ("vertex", "line", "line3")
"""Elements that files have beside."""

_LEVEL = 1e-6
"""Share of a mesh's size by which its nodes may lie beside one plane."""


def read_mesh(path: Path, *, unit: float = 1.0) -> Given:
    """The mesh in a file: Gmsh, VTK, VTU, Abaqus, Nastran, SU2, OFF, STL and others, by its ending.

    - `unit`: of its coordinates, mm.

    Sides of elements of second order are taken as straight. Raises `InputError`, naming the file,
    for one that cannot be read, that holds other elements than triangles and quads, that is not
    level, and what `Given.of` raises.
    """
    import meshio

    # It prints what it thinks of a file, and ends the process over some.
    said = io.StringIO()
    try:
        with (
            warnings.catch_warnings(),
            contextlib.redirect_stdout(said),
            contextlib.redirect_stderr(said),
        ):
            warnings.simplefilter("ignore")
            mesh = meshio.read(path)
    except (Exception, SystemExit) as fault:
        why = said.getvalue() if isinstance(fault, SystemExit) else str(fault)
        why = next(iter(why.strip().splitlines()), type(fault).__name__).removeprefix("Error: ")
        raise InputError(f"{path}: is no mesh that can be read: {why}") from None
    points = np.asarray(mesh.points, float) * unit
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise InputError(f"{path}: its nodes have no x and y")
    others = {block.type for block in mesh.cells} - {*_CORNERS, *_IGNORED}
    if others:
        raise InputError(
            f"{path}: holds elements of kind {', '.join(sorted(others))}; triangles and quads are "
            "laid"
        )
    elements = {
        corners: np.concatenate(
            [
                np.zeros((0, corners), np.intp),
                *(
                    np.asarray(block.data)[:, :corners]
                    for block in mesh.cells
                    if _CORNERS.get(block.type) == corners
                ),
            ]
        )
        for corners in (3, 4)
    }
    if points.shape[1] == 3 and len(points):
        z = points[:, 2]
        size = float(np.ptp(points[:, :2], axis=0).max())
        if not np.ptp(z) <= _LEVEL * size:
            raise InputError(
                f"{path}: is not level: z from {z.min():.4g} to {z.max():.4g} mm; a layer is"
            )
    return Given.of(points[:, :2], elements[3], elements[4], name=str(path))
