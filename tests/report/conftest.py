"""A run whose every figure has a closed form: two damped oscillators, of which the reduced model keeps one or both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.model import (
    SCALAR,
    ComponentResult,
    Configuration,
    ConfigurationResult,
    DampedPairs,
    DofTable,
    FEModel,
    Finding,
    ModalComponent,
    ModelErrors,
    Response,
    RunResult,
    Source,
    Speed,
)

HZ = np.array([1.0, 4.0])
ZETA = 0.005
GAIN = np.array([1.0, 0.25])
SHIFT = 1e-3
"""The run's own model has its first frequency too high by this share."""

MakeRun = Callable[..., RunResult]


def oscillators(hz: np.ndarray, natural: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """Sum of gain / (w_k^2 - w^2 + 2 i zeta w_k w)."""
    w, w_k = 2 * np.pi * hz[:, None], 2 * np.pi * natural
    return (gain / (w_k**2 - w**2 + 2j * ZETA * w_k * w)).sum(axis=1)


def errors(frf: float, db: float, shift: float, silent: np.ndarray) -> ModelErrors:
    frac = np.where(silent, np.nan, 1 - frf**2)
    return ModelErrors(frf, db, shift, frac, HZ, HZ * (1 + shift), np.array([1.0, 1 - 1e-9]))


def damped(shift: float, ratio: float) -> DampedPairs:
    """Both modes paired; the first of the reduced model has its frequency and its damping ratio off by these shares."""
    zeta = np.full(2, ZETA)
    full, reduced = (
        2 * np.pi * hz * (-z + 1j * np.sqrt(1 - z**2))
        for hz, z in ((HZ, zeta), (HZ * np.array([1 + shift, 1.0]), zeta * np.array([1 + ratio, 1.0])))
    )
    return DampedPairs(full, reduced, np.array([0.9999, 1.0]), np.array([ratio, 0.0]))


def component(name: str) -> ComponentResult:
    one = sp.csc_array(np.eye(3))
    body = FEModel(name, one, one, DofTable(np.arange(1, 4), np.full(3, SCALAR)))
    nan = float("nan")
    modes = ModalComponent(
        body=body,
        method="craig-bampton",
        Phi=np.eye(3),
        omega=np.array([0.0, *(2 * np.pi * HZ)]),
        zeta=np.array([0.0, ZETA, ZETA]),
        rigid_count=1,
        D=None,
        kind=("rigid", "fixed", "constraint"),
        source_hz=np.array([nan, 1.5, nan]),
        sigma=np.array([nan, 1.2666, 0.019789]),
        spacing=np.array([nan, 0.0067, 0.25]),
        why=("rigid", "among the first by gregory", ""),
        basis_size=3,
    )
    return ComponentResult(
        name=name,
        full_dofs=3,
        modes=modes,
        kept=np.array([0, 1]),
        seconds={"read": 0.0123, "reduce": 1.5, "orthogonalise": 0.25},
        peak_mib=87.4,
        checks=(Finding("orthogonality in M", 3e-16, 1e-8),),
        sources=(Source(f"bodies/{name}.op4", "5e" * 32, "stiffness KAA"),),
    )


@pytest.fixture
def make_run() -> MakeRun:
    """Build the run, some of its names chosen by the test."""

    def make(
        name: str = "oscillators",
        bodies: tuple[str, ...] = ("rotor",),
        inputs: tuple[str, ...] = ("motor", "thruster"),
        outputs: tuple[str, ...] = ("gyro",),
        configurations: tuple[str, ...] = ("spin=0", "spin=45 cone=30"),
        compared: tuple[str, ...] = ("first by frequency",),
        points: int = 400,
        **others: object,
    ) -> RunResult:
        hz = np.geomspace(0.1, 10.0, points)
        full = np.zeros((points, len(outputs), len(inputs)), dtype=np.complex128)
        full[:, 0, 0] = oscillators(hz, HZ, GAIN)
        silent = ~full.any(axis=0)
        own, first = np.zeros_like(full), np.zeros_like(full)
        own[:, 0, 0] = oscillators(hz, HZ * np.array([1 + SHIFT, 1.0]), GAIN)
        first[:, 0, 0] = oscillators(hz, HZ[:1], GAIN[:1])
        results = tuple(
            ConfigurationResult(
                configuration=Configuration(label),
                n_full=9,
                n_reduced=4,
                modes_full=2,
                modes_reduced=1,
                errors={
                    "reduced": errors(0.01 * (k + 1), 0.125, SHIFT, silent),
                    **{c: errors(0.75, 24.0, 0.0, silent) for c in compared},
                },
                response=Response(hz, full, {"reduced": own, **dict.fromkeys(compared, first)}),
            )
            for k, label in enumerate(configurations)
        )
        run = RunResult(
            name=name,
            version="0.1.0",
            components={body: component(body) for body in bodies},
            configurations=results,
            limits={"frf_error": 0.05, "db_error": 1.0},
            model="reduced",
            inputs=inputs,
            outputs=outputs,
            band=(0.1, 10.0),
            speed=Speed(1.75, 2.0, 0.1),
            reference=dict.fromkeys(bodies, "all modes"),
            settings={"name": name, "scene": {"band": "10 Hz"}},
            notes=("units were taken as SI",),
        )
        return replace(run, **others)  # type: ignore[arg-type]

    return make
