from pathlib import Path

import pytest

from cmsreduce.report.pictures import write_pictures
from tests.report.large_run import large_run


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_every_picture_of_a_run(tmp_path: Path, suffix: str) -> None:
    run = large_run(modes=130, inputs=1, outputs=2, configurations=2, points=1500, nodes=40)
    files = write_pictures(run, tmp_path / "pictures", suffix)
    names = [
        "scene",
        "shapes",
        "errors",
        "response_push_0_probe_0",
        "response_push_0_probe_1",
        "likeness",
        "sigma_string",
    ]
    assert [file.name for file in files] == [f"{name}{suffix}" for name in [*names, "effective_mass_string", "gains"]]
    for file in files:
        start = file.read_bytes()[:8]
        assert start == b"\x89PNG\r\n\x1a\n" if suffix == ".png" else start.startswith(b"<?xml")


def test_lines_have_their_colours(tmp_path: Path) -> None:
    from matplotlib.image import imread

    run = large_run(modes=130, inputs=1, outputs=1, configurations=1, points=1500, nodes=40)
    write_pictures(run, tmp_path)
    for name, colours in {
        "scene": [(0, 0x72, 0xB2)],
        "shapes": [(0xD5, 0x5E, 0)],
        "sigma_string": [(0, 0x72, 0xB2)],
    }.items():
        pixels = (255 * imread(tmp_path / f"{name}.png")[..., :3]).round().astype(int)
        for colour in colours:
            assert (abs(pixels - colour).max(axis=2) <= 8).sum() > 100, name


def test_a_run_without_responses_has_pictures_of_its_modes(make_run, tmp_path: Path) -> None:
    assert [file.name for file in write_pictures(make_run(configurations=(), speed=None), tmp_path)] == [
        "sigma_rotor.png"
    ]
