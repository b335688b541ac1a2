"""Pictures as files of others have them: turned, deep, transparent, in stacks."""

import struct

import numpy as np
import pytest
from PIL import Image

from fdjax.errors import InputError
from fdjax.target.image import image

BOX = (0.0, 0.0, 8.0, 4.0)
RAMP = np.array([[10, 60, 110, 160], [60, 110, 160, 210]], np.uint8)
"""As a viewer shows it, top row first."""


def values(path, **options):
    return image(path, extent=BOX, **options).field.values


def shown(grey):
    return np.flipud(np.asarray(grey, float)).T


def tiff(path, pixels, *, tags=()):
    """An uncompressed grey TIFF of unsigned numbers, with more or other tags."""
    data = pixels.astype(pixels.dtype.newbyteorder("<")).tobytes()
    rows, columns = pixels.shape[-2:]
    own = {
        256: columns, 257: rows, 258: 8 * pixels.itemsize, 259: 1, 262: 1, 273: 8, 277: 1,
        278: rows, 279: len(data),
    } | dict(tags)  # fmt: skip
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, own[tag]) for tag in sorted(own))
    head = struct.pack("<2sHI", b"II", 42, 8 + len(data))
    path.write_bytes(head + data + struct.pack("<H", len(own)) + entries + bytes(4))
    return path


@pytest.mark.parametrize("suffix", ["jpg", "png", "tif"])
@pytest.mark.parametrize("turn", range(1, 9))
def test_turned_as_the_tag_says(tmp_path, suffix, turn):
    grey = np.kron(RAMP, np.ones((8, 8), np.uint8))
    undo = {2: 0, 3: 3, 4: 1, 5: 5, 6: 2, 7: 6, 8: 4}  # of Image.Transpose, that brings it back
    picture = Image.fromarray(grey)
    if turn > 1:
        picture = picture.transpose(Image.Transpose(undo[turn]))
    exif = Image.Exif()
    exif[274] = turn
    path = tmp_path / f"f.{suffix}"
    picture.save(path, exif=exif, **({"quality": 100} if suffix == "jpg" else {}))
    np.testing.assert_allclose(values(path), shown(grey / 255), atol=0.02)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.uint32])
@pytest.mark.parametrize("photometric", [0, 1])
def test_depth_and_which_end_is_white(tmp_path, dtype, photometric):
    most = np.iinfo(dtype).max
    path = tiff(tmp_path / "f.tif", (RAMP / 255 * most).astype(dtype), tags={262: photometric})
    if dtype is np.uint32 and not photometric:
        with pytest.raises(InputError, match="no picture that can be read"):
            image(path, extent=BOX)
        return
    right = RAMP / 255 if photometric else 1 - RAMP / 255
    np.testing.assert_allclose(values(path), shown(right), atol=1e-3)


@pytest.mark.parametrize("bits", [1, 2, 4])
def test_few_bits(tmp_path, bits):
    grey = np.array([[0, 255], [255, 0]], np.uint8)
    colours = Image.fromarray(grey).convert("P", palette=Image.Palette.ADAPTIVE, colors=2)
    colours.save(tmp_path / "f.png", bits=bits)
    np.testing.assert_allclose(values(tmp_path / "f.png"), shown(grey / 255))


def test_what_is_transparent_is_no_target(tmp_path):
    picture = np.zeros((6, 8, 2), np.uint8)
    picture[2:4, :, 0] = np.linspace(50, 200, 8)
    picture[2:4, :, 1] = 255
    Image.merge("LA", [Image.fromarray(picture[..., k].copy()) for k in (0, 1)]).save(
        tmp_path / "f.png"
    )
    got = np.flipud(values(tmp_path / "f.png").T)
    np.testing.assert_allclose(got[2:4], picture[2:4, :, 0] / 255)
    assert np.isfinite(got[[1, 4]]).all()  # beside what is seen
    assert np.isnan(got[[0, 5]]).all()


@pytest.mark.parametrize("suffix", ["tif", "gif", "png"])
@pytest.mark.parametrize("count", [2, 5])
def test_stacks_are_refused(tmp_path, suffix, count):
    pages = [Image.fromarray(np.full((16, 16), 50 * k, np.uint8)) for k in range(count)]
    pages[0].save(tmp_path / f"f.{suffix}", save_all=True, append_images=pages[1:])
    with pytest.raises(InputError, match=f"holds {count} pages, frames or slices; one is needed"):
        image(tmp_path / f"f.{suffix}", extent=BOX)


@pytest.mark.parametrize(
    ("description", "words"),
    [
        ("ImageJ=1.53\nimages=7\nslices=7\n", "holds 7 pages"),
        ('{"shape": [3, 2, 4]}', "holds 3 pages"),
        ('{"shape": [2, 4]}', None),
        ('{"shape": [2, 4, 3]}', None),
    ],
)
def test_descriptions_that_tell_a_stack(tmp_path, description, words):
    Image.fromarray(RAMP).save(tmp_path / "f.tif", description=description)
    if words is None:
        assert values(tmp_path / "f.tif").shape == (4, 2)
        return
    with pytest.raises(InputError, match=words):
        image(tmp_path / "f.tif", extent=BOX)


@pytest.mark.parametrize(
    ("tags", "words"),
    [({284: 2}, "planes that may be colours or slices"), ({339: 2}, "signed numbers")],
)
def test_types_that_are_not_certain_are_named(tmp_path, tags, words):
    path = tiff(tmp_path / "f.tif", RAMP.astype(np.uint32), tags=tags)
    with pytest.raises(InputError, match=words):
        image(path, extent=BOX)


def test_one_grey_is_no_picture(tmp_path):
    Image.new("L", (5, 5), 128).save(tmp_path / "f.png")
    with pytest.raises(InputError, match=r"one grey, 0\.502 of white"):
        image(tmp_path / "f.png", extent=BOX)
