import struct
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.errors import WriteError
from cmsreduce.report import response_picture


def test_png_has_its_size_and_its_curves(make_run, tmp_path: Path) -> None:
    from matplotlib.image import imread

    path = tmp_path / "response.png"
    response_picture(make_run(), path)
    header = path.read_bytes()[:24]
    assert header[:8] == b"\x89PNG\r\n\x1a\n"
    assert struct.unpack(">II", header[16:]) == (1200, 780)
    pixels = np.round(255 * imread(path)[..., :3]).astype(int)
    for colour in ((0x33, 0x33, 0x33), (0xE6, 0x9F, 0x00), (0x00, 0x72, 0xB2)):
        assert (abs(pixels - colour).max(axis=2) <= 8).sum() > 100


def test_svg_is_the_same_every_time(make_run, tmp_path: Path) -> None:
    run = make_run(name="$x$", configurations=("a $5", "b $6"))
    for name in ("one.svg", "two.svg"):
        response_picture(run, tmp_path / name, configuration=1)
    assert (tmp_path / "one.svg").read_bytes() == (tmp_path / "two.svg").read_bytes()


@pytest.mark.parametrize(("configuration", "channel"), [(2, (0, 0)), (0, (1, 0)), (0, (0, 2)), (-1, (0, 0))])
def test_a_response_that_is_not_there(make_run, tmp_path: Path, configuration: int, channel: tuple[int, int]) -> None:
    with pytest.raises(WriteError, match="verified 2 configurations of 1 outputs and 2 inputs"):
        response_picture(make_run(), tmp_path / "x.png", configuration, channel)


def test_a_silent_channel_is_an_empty_picture(make_run, tmp_path: Path) -> None:
    response_picture(make_run(limits={}), tmp_path / "x.png", channel=(0, 1))
    assert (tmp_path / "x.png").stat().st_size > 0
