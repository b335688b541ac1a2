"""Meshes from arrays and files: what is mended, what is refused."""

from pathlib import Path

import meshio
import numpy as np
import pytest

from fdjax.errors import InputError
from fdjax.mesh.files import read_mesh
from fdjax.mesh.given import DIAGONALS, Given, fringed, lattice


def areas(mesh):
    a, b, c = np.moveaxis(mesh.xy[mesh.triangles], 1, 0)
    return ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2


@pytest.mark.parametrize("diagonal", DIAGONALS)
def test_a_lattice_fills_its_square(diagonal):
    mesh = lattice((5, 3), diagonal)
    assert (areas(mesh) > 0).all()
    assert areas(mesh).sum() == pytest.approx(1)
    # Euler: edges = nodes + triangles - 1.
    assert len(mesh.edges) == 24 + 30 - 1
    wider = lattice((5, 3), diagonal, beyond=1)
    assert areas(wider).sum() == pytest.approx(7 / 5 * 5 / 3)


def test_diagonals_run_as_they_are_named():
    slope = {}
    for diagonal in DIAGONALS:
        mesh = lattice((4, 4), diagonal)
        along = mesh.xy[mesh.edges[:, 1]] - mesh.xy[mesh.edges[:, 0]]
        slope[diagonal] = np.sign(along[:, 0] * along[:, 1])[np.abs(along).min(1) > 0]
    assert (slope["rising"] == 1).all()
    assert (slope["falling"] == -1).all()
    assert slope["alternating"].sum() == 0
    degree = np.bincount(lattice((4, 4), "alternating").edges.ravel())
    assert sorted(set(degree[degree > 3])) == [4, 5, 8]


def test_elements_are_turned_joined_and_cleared_with_a_note_each():
    whole = lattice((4, 3), "rising")
    turned = np.array(whole.triangles)
    turned[[3, 7]] = turned[[3, 7], ::-1]
    assert Given.of(whole.xy, turned).notes == ("mesh: 2 elements are running clockwise; turned",)
    soup = whole.xy[whole.triangles].reshape(-1, 2)
    given = Given.of(np.concatenate([soup, [(9, 9)]]), np.arange(len(soup)).reshape(-1, 3))
    assert len(given.mesh.xy) == 20
    assert areas(given.mesh).sum() == pytest.approx(1)
    assert given.notes == (
        "mesh: 1 node is in no element and left out",
        "mesh: 52 nodes are on others and joined to them",
    )


def test_a_quad_is_split_where_both_halves_have_an_inside():
    arrow = [(0, 0), (4, -1), (1, 0), (4, 1)]
    assert areas(Given.of(arrow, quads=[(0, 1, 2, 3)]).mesh).min() > 0
    long = [(0, 0), (4, 0), (5, 1), (1, 1)]
    mesh = Given.of(long, quads=[(0, 1, 2, 3)]).mesh
    assert [1, 3] in mesh.edges.tolist()


UNIT = [(0, 0), (1, 0), (1, 1), (0, 1)]


@pytest.mark.parametrize(
    ("nodes", "triangles", "said"),
    [
        (UNIT, [(0, 1, 4)], "names node 4; there are 4"),
        (UNIT, [(0, 1, -1)], "names node -1"),
        (UNIT, [(0, 1, 1.5)], "must be whole"),
        (UNIT, [(0, 1)], r"shape \(1, 2\); \(n, 3\) is needed"),
        (UNIT, [], "it has no triangle or quad"),
        ([(0, 0), (1, 0), (np.inf, 1)], [(0, 1, 2)], "node 2 is not finite"),
        ([(0, 0), (1, 0), (3, 0)], [(0, 1, 2)], r"1 element is flat, the first at \(1\.333, 0\)"),
        ([*UNIT, (0.6, 0.7)], [(0, 1, 2), (0, 1, 4)], "elements overlap, or a node"),
        ([*UNIT, (0.5, -1)], [(0, 1, 2), (0, 1, 3), (0, 1, 4)], "more than two elements share"),
        ([(0, 0), (2, 0), (1, 1), (1, -1)], [(0, 1, 2), (0, 3, 1), (1, 0, 2)], "more than two"),
        ([(0, 0), (2, 0), (1, 1), (1, 0), (0, -1), (2, -1)],
         [(0, 1, 2), (0, 4, 3), (3, 5, 1)], "or a node of one lies on a side"),
    ],
)  # fmt: skip
def test_meshes_that_cannot_be_laid_are_refused(nodes, triangles, said):
    with pytest.raises(InputError, match=said):
        Given.of(nodes, triangles)


def test_a_fringe_lies_outside_of_each_side_of_the_rim():
    mesh = lattice((4, 3), "falling")
    wider = fringed(mesh)
    new = wider.triangles[len(mesh.triangles) :]
    assert len(new) == 14
    assert (areas(wider) > 0).all()
    middle = wider.xy[new].mean(1)
    assert ((middle < 0) | (middle > 1)).any(1).all()
    assert wider.inner.sum() == len(mesh.edges)


def written(path: Path, kind: str = "triangle", z: float = 0.0, **options) -> Path:
    whole = lattice((4, 3), "rising")
    xyz = np.column_stack([whole.xy, z * whole.xy[:, 0]])
    elements = whole.triangles
    if kind == "quad":
        elements = np.array([(0, 4, 5, 1), (4, 8, 9, 5)])
    if kind == "tetra":
        elements = np.array([(0, 1, 2, 3)])
    beside = [("line", whole.edges[:2]), ("vertex", [[0]])] if path.suffix == ".vtk" else []
    meshio.Mesh(xyz, [(kind, elements), *beside]).write(path, **options)
    return path


@pytest.mark.parametrize("ending", ["vtk", "vtu", "inp", "bdf", "off", "stl", "obj", "msh", "mesh"])
def test_files_of_many_kinds_give_the_same_mesh(tmp_path, ending):
    options = {"file_format": "gmsh"} if ending == "msh" else {}
    given = read_mesh(written(tmp_path / f"plate.{ending}", **options), unit=25.4)
    assert len(given.mesh.triangles) == 24
    assert areas(given.mesh).sum() == pytest.approx(25.4**2, rel=1e-5)
    assert given.notes == ()


def test_quads_of_a_file_are_split(tmp_path):
    given = read_mesh(written(tmp_path / "plate.vtk", "quad"))
    assert len(given.mesh.triangles) == 4
    assert given.notes == (f"{tmp_path / 'plate.vtk'}: 14 nodes are in no element and left out",)


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.vtk", "hello", "is no mesh that can be read: Illegal VTK header"),
        ("a.msh", "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n", "is no mesh that can be read"),
        ("a.xyz", "1 2 3", "Could not deduce file format"),
        ("a.stl", "", "nodes"),
        ("a.vtu", "<x/>", "Expected tag 'VTKFile'"),
    ],
)
def test_what_is_no_mesh_is_refused_in_one_line(tmp_path, capsys, name, text, said):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError, match=said) as fault:
        read_mesh(path)
    assert str(path) in str(fault.value)
    assert "\n" not in str(fault.value)
    assert capsys.readouterr() == ("", "")


def test_a_solid_or_a_slope_is_refused(tmp_path):
    with pytest.raises(InputError, match="holds elements of kind tetra; triangles and quads"):
        read_mesh(written(tmp_path / "solid.vtk", "tetra"))
    with pytest.raises(InputError, match="is not level: z from 0 to 1 mm"):
        read_mesh(written(tmp_path / "slope.vtk", z=1.0))
