"""Targets of every kind: what they mean, their gradients, and what they refuse."""

import pickle

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from fdjax.errors import InputError
from fdjax.part.part import Part
from fdjax.target.array import array
from fdjax.target.image import image
from fdjax.target.raster import Raster
from fdjax.target.read import read
from fdjax.target.target import Target, expression

BOX = (0.0, 0.0, 80.0, 40.0)
PLATE = Part.plate(shapely.box(*BOX))


def test_solid_is_one_less_porosity():
    solid = expression("0.1 + 0.4*x/80", quantity="solid")
    porosity = expression("0.9 - 0.4*x/80")
    x, y = np.array([0.0, 20.0, 80.0]), np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(solid(x, y), [0.9, 0.8, 0.5], rtol=1e-14)
    np.testing.assert_allclose(solid(x, y), porosity(x, y), rtol=1e-14)
    np.testing.assert_allclose(solid.solid(x, y), [0.1, 0.2, 0.5], rtol=1e-14)


def test_constants_fill_the_shape_and_axes_broadcast():
    assert expression("0.5")(np.zeros((3, 1)), np.zeros((1, 4))).shape == (3, 4)
    assert expression("0.5")(jnp.zeros((2, 3)), jnp.zeros((2, 3))).shape == (2, 3)


@pytest.mark.parametrize(("unit", "mm"), [("mm", 1.0), ("in", 25.4), ("mil", 0.0254), ("cm", 10.0)])
def test_unit_of_the_expression(unit, mm):
    target = expression("0.3 + x/1000 + y/500", unit=unit)
    assert float(target(7 * mm, 11 * mm)) == pytest.approx(0.3 + 0.007 + 0.022)


@pytest.mark.parametrize("unit", ["feet", "", "2mm", "0.5mm", 3])
def test_unknown_unit(unit):
    with pytest.raises(InputError, match="unit"):
        expression("x", unit=unit)


def test_unknown_quantity():
    with pytest.raises(InputError, match="neither porosity nor solid"):
        expression("0.5", quantity="density")


def test_a_function_of_jax_or_numpy():
    for xp in (np, jnp):
        target = Target(lambda x, y, xp=xp: 0.5 + 0.1 * xp.sin(x), quantity="solid")
        got = target(np.array([1.0, 2.0]), np.zeros(2))
        assert isinstance(got, np.ndarray)
        np.testing.assert_allclose(got, 0.5 - 0.1 * np.sin([1.0, 2.0]), rtol=1e-12)
    with pytest.raises(InputError, match="no function"):
        Target(0.5)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"gives shape \(2,\)"):
        Target(lambda x, y: np.zeros(2))(np.zeros(3), np.zeros(3))


@settings(max_examples=25, deadline=None)
@given(
    st.tuples(*[st.floats(-1, 1)] * 3),
    st.tuples(st.integers(1, 7), st.integers(1, 7)),
    st.tuples(st.floats(0, 80), st.floats(0, 40)),
)
def test_arrays_reproduce_linear_fields(abc, shape, place):
    a, b, c = abc
    b, c = b * (shape[0] > 1), c * (shape[1] > 1)  # one sample along an axis: constant along it
    x, y = np.linspace(0, 80, shape[0])[:, None], np.linspace(0, 40, shape[1])[None, :]
    field = array(a + b * x + c * y, extent=BOX)
    assert float(field(*place)) == pytest.approx(a + b * place[0] + c * place[1], abs=1e-12)


def test_arrays_are_bilinear_clamped_and_scaled():
    samples = Raster([[0.0, 1.0], [2.0, 7.0]], (0.0, 0.0, 1.0, 1.0))
    x, y = np.array([0.25, -5, 9.0, np.nan]), np.array([0.5, -5, 0.5, 0.5])
    wanted = [0.75 * 0.5 + 0.25 * (1 + 3.5), 0.0, 4.5, np.nan]
    np.testing.assert_allclose(samples(x, y), wanted)
    np.testing.assert_allclose(jax.jit(samples)(x, y), wanted)
    target = array(np.array([[0, 100]]), extent=BOX, low=0.2, high=0.203, quantity="solid")
    assert float(target.solid(1.0, 40.0)) == pytest.approx(0.5)
    for extent in [(0, 0, 0, 1), (0, 1, 1, 0), (0, 0, np.nan, 1)]:
        with pytest.raises(InputError, match="is no box"):
            array(np.zeros((2, 2)), extent=extent)


def test_image_lies_with_its_top_row_at_the_largest_y(tmp_path):
    # black top left, white bottom right
    Image.fromarray(np.array([[0, 51], [102, 255]], np.uint8)).save(tmp_path / "f.png")
    for target in (
        image(tmp_path / "f.png", extent=BOX),
        read(str(tmp_path / "f.png"), extent=BOX),
    ):
        x, y = np.array([0.0, 80.0, 0.0, 80.0]), np.array([40.0, 40.0, 0.0, 0.0])
        np.testing.assert_allclose(target(x, y), [0.0, 0.2, 0.4, 1.0], atol=1e-12)
    scaled = image(tmp_path / "f.png", extent=BOX, low=0.5, high=0.3, quantity="solid")
    assert float(scaled.solid(80.0, 40.0)) == pytest.approx(0.46)


@pytest.mark.parametrize("mode", ["1", "L", "P", "RGB", "RGBA", "LA", "I;16"])
def test_images_of_every_depth(tmp_path, mode):
    grey = np.array([[0, 255, 255], [255, 0, 0]], np.uint8)
    if mode == "I;16":
        picture = Image.fromarray(grey.astype(np.uint16) * 257)
    else:
        picture = Image.fromarray(grey).convert(mode)
    picture.save(tmp_path / "f.png")
    samples = image(tmp_path / "f.png", extent=BOX).field
    np.testing.assert_array_equal(samples.values, np.flipud(grey / 255).T)  # type: ignore[attr-defined]


def test_transparent_image_is_refused(tmp_path):
    Image.new("RGBA", (3, 3), (9, 9, 9, 100)).save(tmp_path / "f.png")
    with pytest.raises(InputError, match="transparent"):
        image(tmp_path / "f.png", extent=BOX)


def test_broken_images_are_named(tmp_path):
    good = tmp_path / "good.png"
    Image.new("L", (300, 300), 9).save(good)
    data = good.read_bytes()
    for name, content in {
        "e.png": b"",
        "t.png": data[: len(data) // 2],
        "n.png": b"no image",
    }.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=rf"{name}: is no picture"):
            image(tmp_path / name, extent=BOX)
    with pytest.raises(InputError, match=r"missing\.png: no such file"):
        image(tmp_path / "missing.png", extent=BOX)
    with pytest.raises(InputError, match="picture"):
        image(tmp_path, extent=BOX)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (np.zeros(5), "1 axes"),
        (np.zeros((2, 2, 2)), "3 axes"),
        (np.zeros((0, 4)), "is empty"),
        (np.array([[0.1, np.nan]]), r"value \[0, 1\] is nan"),
        (np.array([[0.1], [np.inf]]), r"value \[1, 0\] is inf"),
        (np.array([["a", "b"]]), "real numbers"),
        (np.array([[1j]]), "real numbers"),
    ],
)
def test_bad_arrays_are_named(tmp_path, values, words):
    path = tmp_path / "f.npy"
    np.save(path, values)
    with pytest.raises(InputError, match=rf"f\.npy: .*{words}"):
        array(path, extent=BOX)
    with pytest.raises(InputError, match=f"array: .*{words}"):
        array(values, extent=BOX)


def test_array_files_that_are_none(tmp_path):
    path = tmp_path / "f.npy"
    np.save(path, np.full((40, 40), 0.5))
    assert float(read(str(path), extent=BOX)(3.0, 4.0)) == 0.5
    data = path.read_bytes()
    for content in (b"", data[:500], data[:20], b"0.1 0.2", pickle.dumps([0.5])):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"f\.npy: is no whole"):
            array(path, extent=BOX)
    np.save(path, np.array([[None]]), allow_pickle=True)
    with pytest.raises(InputError, match=r"f\.npy: is no whole"):
        array(path, extent=BOX)
    with path.open("wb") as file:
        np.savez(file, a=np.zeros((2, 2)))
    with pytest.raises(InputError, match=r"f\.npy: is an archive"):
        array(path, extent=BOX)
    with pytest.raises(InputError, match="no such file"):
        array(tmp_path / "missing.npy", extent=BOX)
    with pytest.raises(InputError, match="cannot be read"):
        array(tmp_path, extent=BOX)


def test_check_accepts_what_lies_inside_and_names_what_does_not():
    expression("x/80").check(PLATE)
    expression("0.1*3", quantity="solid").check(PLATE)
    with pytest.raises(InputError, match=r'solid "x/79" is 1\.01266 at \(80, .* mm; .* in 0\.\.1'):
        expression("x/79", quantity="solid").check(PLATE)
    with pytest.raises(InputError, match=r"is -0\.5 at \(.*, 0\) mm"):
        expression("y/40 - 0.5").check(PLATE)
    for text in ("1/(x - 80)", "log(x - 20)", "sqrt(-1)", "1e300**2"):
        with pytest.raises(InputError, match="must be finite"):
            expression(text).check(PLATE)


def test_check_looks_only_inside_the_outline():
    dip = expression("where(hypot(x - 40, y - 20) < 5, 2, 0.5)")
    with pytest.raises(InputError, match="is 2 at"):
        dip.check(PLATE)
    dip.check(Part.plate(shapely.box(*BOX).difference(shapely.Point(40, 20).buffer(6))))
    sliver = expression("where(x + y > 119.99, 1.5, 0.5)")
    with pytest.raises(InputError, match=r"is 1\.5 at \(80, 40\)"):
        sliver.check(PLATE)


@pytest.mark.parametrize(
    "target",
    [
        expression("0.65 + 0.1*sin(x/500)*cos(y/600)", unit="mil"),
        expression("0.72 - 0.2*exp(-((x - 40)**2 + (y - 20)**2)/200)", quantity="solid"),
        array(np.random.default_rng(3).uniform(0, 1, (9, 7)), extent=BOX),
        Target(lambda x, y: 0.5 + 0.1 * jnp.tanh(x - y)),
    ],
    ids=["expression", "solid", "array", "function"],
)
def test_gradients_agree_with_differences(target: Target):
    rng = np.random.default_rng(1)
    x, y = rng.uniform(1, 79, 20), rng.uniform(1, 39, 20)
    gx, gy = jax.jit(jax.grad(lambda x, y: target(x, y).sum(), argnums=(0, 1)))(x, y)
    _, forward = jax.jvp(target, (jnp.asarray(x), jnp.asarray(y)), (jnp.ones(20), jnp.zeros(20)))
    h = 1e-5
    np.testing.assert_allclose(gx, (target(x + h, y) - target(x - h, y)) / (2 * h), atol=1e-8)
    np.testing.assert_allclose(gy, (target(x, y + h) - target(x, y - h)) / (2 * h), atol=1e-8)
    np.testing.assert_allclose(forward, gx, rtol=1e-12)
