"""Damaged floor plans: a plan, or a `DataError` that names the file; never anything else."""

import io

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from modlhmp.floor_plan import load_floor_plan
from modlhmp.storage import DataError

YAML = "image: plan\nresolution: 0.5\norigin: [-1.0, 2.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
GOOD = YAML.encode()
GREY = np.arange(0, 240, 5, dtype=np.uint8).reshape(6, 8)


def encoded(image, form):
    """The bytes of an image file."""
    file = io.BytesIO()
    image.save(file, form)
    return file.getvalue()


IMAGES = {
    "png": encoded(Image.fromarray(GREY), "PNG"),
    "palette": encoded(Image.fromarray(GREY).convert("P"), "PNG"),
    "wide": encoded(Image.fromarray(GREY.astype(np.uint16) * 257), "PNG"),
    "pgm": encoded(Image.fromarray(GREY), "PPM"),
    "text": b"P2\n8 6\n255\n" + " ".join(map(str, GREY.ravel())).encode(),
    "tiff": encoded(Image.fromarray(GREY.astype(np.float32) / 255), "TIFF"),
    "packed tiff": encoded(Image.fromarray(GREY).convert("RGB"), "TIFF"),
    "gif": encoded(Image.fromarray(GREY), "GIF"),
    "bmp": encoded(Image.fromarray(GREY), "BMP"),
    "jpeg": encoded(Image.fromarray(GREY), "JPEG"),
}


def cells_or_refused(folder, image, text=GOOD):
    """Cells, or None where the plan is refused by name."""
    (folder / "plan.yaml").write_bytes(text)
    (folder / "plan").write_bytes(image)
    try:
        return load_floor_plan(folder / "plan.yaml").cells
    except DataError as error:
        assert "plan.yaml" in str(error)
        assert "\n" not in str(error)
        return None


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One folder, whose files every example overwrites."""
    return tmp_path_factory.mktemp("plans")


@pytest.mark.parametrize("form", IMAGES)
def test_an_image_that_is_cut_off(folder, form):
    image = IMAGES[form]
    assert cells_or_refused(folder, image).shape == (6, 8)
    for end in (*range(60), *range(60, len(image), 19)):
        cells = cells_or_refused(folder, image[:end])
        assert cells is None or cells.shape == (6, 8)


@settings(max_examples=300)
@given(
    key=st.sampled_from(["image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh", "mode"]),
    value=st.one_of(
        st.text(max_size=12),
        st.from_regex(r"[-+.0-9eE_:x\[\]{},&*!~'\"%@`|>]{1,30}", fullmatch=True),
        st.integers(-(10**30), 10**30).map(str),
    ),
)
def test_a_yaml_file_with_another_value(folder, key, value):
    lines = [line for line in YAML.splitlines() if not line.startswith(key)]
    cells_or_refused(folder, IMAGES["png"], "\n".join([*lines, f"{key}: {value}"]).encode("utf-8", "surrogatepass"))


@pytest.mark.parametrize(
    "text",
    [b"image: " + b"[" * 5000, b"a: &a [*a]\n" + YAML.encode(), b"a: 2001-12-14t21:59:43.10-99:99\n", b"\xff\xfe"],
)
def test_a_yaml_file_made_to_break_readers(folder, text):
    """Nested or referring to itself without end, a time that is none, another encoding."""
    assert cells_or_refused(folder, IMAGES["png"], text) is None
