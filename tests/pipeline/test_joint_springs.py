"""Springs, dampers and inertias of joints through a whole run: in the full model, the reduced one, and the file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from cmsreduce.pipeline import Run, execute

SPRING = (
    "scene.joints.hinge.stiffness={ry: 90 N*m/rad}",
    "scene.joints.hinge.damping={ry: 0.05 N*m*s/rad}",
    "scene.joints.hinge.inertia={ry: 20 kg*mm^2}",
)


# Mode sets without static modes leave 0.43 and 1.27 here without the spring.
@pytest.mark.parametrize(
    ("method", "error"),
    [("craig-bampton", 0.02), ("macneal-rubin", 0.02), ("benfield-hruda", 0.43), ("augmented", 1.27)],
)
def test_a_run_with_a_sprung_hinge(opened: Callable[..., Run], study: Path, method: str, error: float) -> None:
    run = opened(*SPRING, f"reduce.method={method}", "reduce.cutoff=25", "verify.limits={}")
    result = execute(run, study, report=False)
    assert result is not None
    # The same spring in both: what separates them is truncation alone.
    assert result.worst()["frf_error"] < error
    with h5py.File(run.folder / "system.h5") as file:
        group = file["configuration_1"]
        assert group["bodies"].asstr()[-1] == "joint hinge"
        assert group["sizes"][-1] == 2
        # The hinge is no free motion any more.
        assert group["rigid"].shape[1] == 6
        hinge = group["joints/hinge"]
        assert (hinge.attrs["first"], hinge.attrs["second"], hinge.attrs["free"]) == ("arm.tip", "panel.root", "ry")
        figures = [hinge[name][0] for name in ("stiffness", "damping", "inertia")]
        np.testing.assert_allclose(figures, [90.0, 0.05, 20e-6], rtol=1e-14)
        assert "stiffness" not in group["joints/weld"]


def test_a_stiff_spring_is_a_weld(opened: Callable[..., Run], study: Path) -> None:
    quiet = ("scene.articulation=null", "scene.actuators.motor=null", "verify=null")
    frequencies = []
    for joint in (("scene.joints.hinge.stiffness={ry: 1e9 N*m/rad}",), ("scene.joints.hinge.free=none",)):
        run = opened(*quiet[:1], "scene.actuators={push: {at: hub.cg, force: [0, 1, 1]}}", *quiet[2:], *joint)
        (configuration,) = run.scene.configurations
        frequencies.append(run.model.assembled.resonances(configuration).omega)
    # Softer by the spring in series with the panel, whose root turns with some 1e3 N m a radian.
    np.testing.assert_allclose(*frequencies, rtol=1e-6)
