from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes

from cmsreduce.errors import ConfigError
from cmsreduce.model import ControllerMargin
from cmsreduce.pipeline.results import export_figures
from cmsreduce.report import figure_pictures, write_pictures
from tests.report.large_run import large_run

Drawn = Callable[[str], list[Path]]


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Drawn:
    """All pictures of a run as files of a kind, drawn once: it is what takes the time."""
    run = large_run(modes=130, inputs=1, outputs=2, configurations=2, points=1500, nodes=40)
    return cache(lambda suffix: write_pictures(run, tmp_path_factory.mktemp("drawn") / "pictures", suffix))


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_every_picture_of_a_run(drawn: Drawn, suffix: str) -> None:
    files = drawn(suffix)
    names = [
        "scene",
        "shapes",
        "errors",
        "response_push_0_probe_0",
        "response_push_0_probe_1",
        "mac",
        "sigma_string",
    ]
    assert [file.name for file in files] == [f"{name}{suffix}" for name in [*names, "effective_mass_string", "gains"]]
    for file in files:
        start = file.read_bytes()[:8]
        assert start == b"\x89PNG\r\n\x1a\n" if suffix == ".png" else start.startswith(b"<?xml")


def test_lines_have_their_colours(drawn: Drawn) -> None:
    from matplotlib.image import imread

    folder = drawn(".png")[0].parent
    for name, colours in {
        "scene": [(0, 0x72, 0xB2)],
        "shapes": [(0xD5, 0x5E, 0)],
        "sigma_string": [(0, 0x72, 0xB2)],
    }.items():
        pixels = (255 * imread(folder / f"{name}.png")[..., :3]).round().astype(int)
        for colour in colours:
            assert (abs(pixels - colour).max(axis=2) <= 8).sum() > 100, name


def test_a_run_without_responses_has_pictures_of_its_modes(make_run, tmp_path: Path) -> None:
    assert [file.name for file in write_pictures(make_run(configurations=(), speed=None), tmp_path)] == [
        "sigma_rotor.png"
    ]


def test_every_channel_and_body_has_a_file_of_its_own(make_run, tmp_path: Path) -> None:
    """`a_b` to `c` beside `a` to `b_c`, and names that differ in their capitals alone, as file systems may ignore."""
    run = make_run(bodies=("rotor", "Rotor"), inputs=("a_b", "a"), outputs=("c", "b_c", "B_c"))
    files = write_pictures(run, tmp_path, ".svg")
    assert len({file.name.lower() for file in files}) == len(files) == 1 + 6 + 2
    texts = [file.read_text() for file in files]
    for given in run.inputs:
        for output in run.outputs:
            assert sum(f"<!-- {given} → {output}, " in text for text in texts) == 1, (given, output)
    assert [file.stem for file in files if "sigma" in file.stem] == ["sigma_rotor", "sigma_Rotor.2"]


def test_single_pictures(make_run, tmp_path: Path) -> None:
    run = make_run()
    found = figure_pictures(run)
    # This run has no drawing, no gains and no MAC.
    assert list(found) == ["bode", "nyquist", "nichols", "error-cost", "errors"]
    for name, draw in found.items():
        draw(tmp_path / f"{name}.svg")
    text = (tmp_path / "error-cost.svg").read_text()
    # Without a controller there is no critical point.
    for name in ("nyquist", "nichols"):
        assert "<!-- -1 -->" not in (tmp_path / f"{name}.svg").read_text(), name
    # A model is named beside its point.
    assert "<!-- this model -->" in text and "<!-- first by frequency -->" in text and "<!-- limit 5 % -->" in text
    assert "<!-- phase, deg -->" in (tmp_path / "bode.svg").read_text()
    assert figure_pictures(make_run(configurations=(), speed=None)) == {}


def test_the_open_loop_of_a_controller(make_run, tmp_path: Path) -> None:
    """A loop of phase lead 30 degrees at gain 1: the curves of both models and the critical point are drawn."""
    hz = np.linspace(0.1, 10.0, 60)
    loop = 5 / (1j * hz) ** 2 * (1 + 0.6j * hz)
    margin = ControllerMargin("spin=0", hz, 0.1 * np.ones(60), np.ones(60), 0, (loop, 1.1 * loop))
    run = replace(make_run(), margins=(margin,))
    for name, axis in {"nyquist": "real part", "nichols": "phase, deg"}.items():
        figure_pictures(run)[name](tmp_path / f"{name}.svg")
        text = (tmp_path / f"{name}.svg").read_text()
        for word in ("-1", axis, "open loop of the controller, spin=0", "full", "reduced"):
            assert f"<!-- {word} -->" in text, (name, word)


def test_both_models_lie_in_one_turn_of_the_nichols_picture(make_run, tmp_path: Path, monkeypatch) -> None:
    """Static gains that round to either side of the positive axis: the curves were 360 degrees apart."""
    hz = np.linspace(0.1, 10.0, 60)
    loop = 2 / (1 - (hz / 3) ** 2 + 0.02j * hz)
    loop[0], near = 2 - 1e-9j, loop.copy()
    near[0] = 2 + 1e-9j
    margin = ControllerMargin("spin=0", hz, 0.1 * np.ones(60), np.ones(60), 0, (near, loop))
    drawn, plot = list[np.ndarray](), Axes.plot
    monkeypatch.setattr(Axes, "plot", lambda axes, x, *rest, **how: (drawn.append(x), plot(axes, x, *rest, **how))[1])
    figure_pictures(replace(make_run(), margins=(margin,)))["nichols"](tmp_path / "nichols.svg")
    full, reduced = (x for x in drawn if len(x) == hz.size)
    np.testing.assert_allclose(full, reduced, atol=1e-6)


def test_bode_is_the_worst_channel_at_its_worst_configuration(make_run, tmp_path: Path) -> None:
    figure_pictures(make_run())["bode"](tmp_path / "bode.svg")
    text = (tmp_path / "bode.svg").read_text()
    assert "<!-- motor → gyro, spin=45 cone=30 -->" in text


def test_a_picture_that_the_run_does_not_have_is_refused(make_run, tmp_path: Path) -> None:
    for name, reason in {"gains": "the run has no data for it", "bodee": "there is no such picture"}.items():
        with pytest.raises(ConfigError, match=f"--figure {name}: {reason}.*bode, nyquist, nichols, error-cost, errors"):
            export_figures(make_run(), tmp_path, [name], [".svg"])
    (made,) = export_figures(make_run(), tmp_path, ["errors"], [".pdf"])
    assert made == tmp_path / "pictures" / "errors.pdf" and made.read_bytes().startswith(b"%PDF")
