"""The table of rankings counts places as a reader does."""

from dataclasses import replace

import numpy as np
from rich.console import Console

from cmsreduce.model import Damping
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton
from cmsreduce.report import print_rankings
from cmsreduce.report.terminal.tables import ranking_rows
from tests.frames import line


def ranked():
    body = line("bar", [0, 0, 0], [1.5, 0, 0], 6, damping=Damping(modal=0.01))
    found = orthogonalise(CraigBampton(800.0).reduce(body, body.interface_rows("a"))).truncated([6, 7, 8])
    nothing = [np.nan] * 6
    return replace(
        found,
        spacing=np.array([*nothing, 0.01, 0.5, 0.5]),
        cluster=np.array([*[0] * 7, 1, 1]),
        rankings={"gregory": np.array([*nothing, 0.25, 3.0, 1e-7]), "frequency": np.array([*nothing, 3.0, 2.0, 1.0])},
    )


def test_rows():
    component = ranked()
    hz = [f"{w / 2 / np.pi:.5g}" for w in component.omega[6:]]
    assert ranking_rows(component, np.array([6, 7])) == [
        ("7", hz[0], "", "", "kept", "0.25  2"),
        ("8", hz[1], "1", "close", "kept", "3  1"),
        ("9", hz[2], "1", "close", "", "1e-07  3"),
    ]


def test_bodies_without_rankings_are_passed_over():
    console = Console(record=True, width=120)
    print_rankings({"bar": ranked(), "other": replace(ranked(), rankings={})}, {"bar": np.array([7])}, console)
    text = console.export_text()
    assert "bar: coefficient and place" in text and "gregory" in text
    assert "other" not in text
