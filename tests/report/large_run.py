"""A run as large as reports get, made without a reduction: 200 modes, 50 channels, 20 configurations."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from cmsreduce.model import (
    AxisCompleteness,
    BodyDrawing,
    ComponentResult,
    Configuration,
    ConfigurationResult,
    DofTable,
    EffectiveMassCurve,
    ExtraneousMode,
    FEModel,
    Finding,
    GainSum,
    JointDrawing,
    MacMatrix,
    ModalComponent,
    ModelErrors,
    Placement,
    PortDrawing,
    ProjectionRecord,
    ReductionChecks,
    Response,
    RunResult,
    SampledModes,
    SceneDrawing,
    SensitivityCase,
    SensitivityRecord,
    Source,
    Speed,
    SystemShapes,
)
from tests.report.made_checks import HEALTH, channel_zeros, controller_margin, step_of, system_checks

__all__ = ["large_run"]

ZETA = 0.005
_KEPT = 120


def large_run(
    modes: int = 200,
    inputs: int = 2,
    outputs: int = 48,
    configurations: int = 20,
    points: int = 4000,
    nodes: int = 1500,
) -> RunResult:
    """A string of masses between two walls, whose modes and shapes are sines, with channels all along it."""
    rng = np.random.default_rng(3)
    hz = 0.5 * np.arange(1, modes + 1) ** 1.1
    grid = np.unique(
        np.concatenate([np.geomspace(0.1, hz[_KEPT], points - 5 * modes), *(hz * (1 + k * ZETA) for k in range(-2, 3))])
    )
    place = np.linspace(0, 1, outputs + 2)[1:-1]
    push = np.linspace(0.13, 0.77, inputs)
    k = np.arange(1, modes + 1)
    C, B = np.sin(np.pi * np.outer(place, k)), np.sin(np.pi * np.outer(push, k))
    names = tuple(f"angle={5 * c}" for c in range(configurations))
    results, systems, gains, checks, margins = [], {}, {}, [], []
    for c, name in enumerate(names):
        natural = hz * (1 + 0.01 * np.sin(0.3 * c + 0.1 * k))
        full, own = (_response(grid, natural[:n], C[:, :n], B[:, :n]) for n in (modes, _KEPT))
        found = natural[:_KEPT]
        mac = np.eye(modes)[:, :_KEPT] * (1 - 1e-3 * rng.random((modes, _KEPT)))
        errors = ModelErrors(
            frf_error=float(np.linalg.norm(own - full) / np.linalg.norm(full)),
            db_error=0.3,
            frequency_error=1e-4,
            frac=np.full((outputs, inputs), 0.999),
            full_hz=found,
            reduced_hz=found,
            mac=np.ones(found.size),
            channel_errors=np.full((outputs, inputs), 0.01),
            channel_peak=np.full((outputs, inputs), 0.002),
            channel_shift=np.full((outputs, inputs), 1e-4),
            mac_matrix=MacMatrix(natural, found, mac),
            coordinates=_KEPT,
            seconds=0.1,
        )
        angle = np.deg2rad(5.0 * c)
        setting = Configuration(name, {("hinge", 4): angle})
        results.append(
            ConfigurationResult(
                setting, modes, _KEPT, modes, _KEPT, {"reduced": errors}, Response(grid, full, {"reduced": own})
            )
        )
        Q = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
        systems[name] = SystemShapes(
            natural[:60], np.full(60, ZETA), {"string": np.eye(_KEPT, 60)}, {"string": Placement(rotation=Q)}
        )
        gain = np.einsum("ok,ik,k->koi", C, B, 1 / (2 * np.pi * natural) ** 2)
        # One mode above the band that the first channel cannot do without: 0.3 / 1.3 of its gains.
        gain[-1, 0, 0] = 0.3 * abs(gain[:-1, 0, 0]).sum()
        none = np.zeros((outputs, inputs))
        steps = step_of(natural, C, B, _KEPT, ZETA)
        checks.append(system_checks(name, channel_zeros(natural, _KEPT, outputs, inputs), steps))
        margins.append(controller_margin(name, grid, hz[3]))
        gains[name] = GainSum(found, gain[:_KEPT], none), GainSum(natural, gain, none)
    along = np.linspace(0, 1, nodes)
    xyz = np.column_stack([along, 0.1 * np.sin(9 * along), np.zeros(nodes)])
    shapes = np.zeros((nodes, 3, modes))
    shapes[:, 2] = np.sin(np.pi * np.outer(along, k))
    lines = np.column_stack([np.arange(nodes - 1), np.arange(1, nodes)])
    drawing = SceneDrawing(
        {"string": BodyDrawing("string", xyz, lines, shapes, np.arange(_KEPT))},
        (JointDrawing("hinge", ("string", "string"), np.zeros(3), np.array([[0.0, 1, 0]]), ("ry",)),),
        (
            PortDrawing("push 0", "actuator", "string", xyz[nodes // 7]),
            PortDrawing("probe", "sensor", "string", xyz[nodes // 2]),
        ),
        systems,
        "m",
    )
    share = np.cumsum(np.tile(0.8 / modes, (modes, 6)), axis=0)
    return RunResult(
        name="large",
        version="0.1.0",
        components={"string": _component(hz)},
        configurations=tuple(results),
        limits={"frf_error": 0.05, "db_error": 1.0},
        model="reduced",
        inputs=tuple(f"push {i}" for i in range(inputs)),
        outputs=tuple(f"probe {o}" for o in range(outputs)),
        input_units=("N m",) * inputs,
        output_units=("rad",) * outputs,
        notes=("a note",),
        band=(0.1, float(hz[_KEPT - 1])),
        speed=Speed(1.0, 9.0, 1.5),
        completeness=tuple(
            AxisCompleteness("hinge.ry", name, 0.5, 0.01 * (c + 1), 0.005) for c, name in enumerate(names)
        ),
        projection=ProjectionRecord(
            tuple(SampledModes(name, hz[:40], np.full(40, 1e-12), 5) for name in names[:3]),
            {"string": np.geomspace(1, 1e-14, 160)},
            {"string": _KEPT},
            tuple(
                ExtraneousMode(
                    names[n % len(names)],
                    1.3 * n + 2,
                    "string",
                    {"string": 1.0},
                    "",
                    np.full(outputs, 10.0**-n),
                    n / 7,
                )
                for n in range(7)
            ),
        ),
        sensitivity=SensitivityRecord({"string": (1, 2)}, (SensitivityCase("damping x 5", {"string": (1, 3)}),)),
        drawing=drawing,
        effective_mass={"string": EffectiveMassCurve("left", hz, share, hz[:_KEPT], share[:_KEPT])},
        gains=gains,
        checks=ReductionChecks(
            {"string": {"interface 'left'": 0.0, "actuator 'push 0'": 3e-5}},
            tuple(checks),
            ("step of the slow body: it was not asked for",),
        ),
        margins=tuple(margins),
    )


def _response(grid: np.ndarray, hz: np.ndarray, C: np.ndarray, B: np.ndarray) -> np.ndarray:
    w, w_k = 2 * np.pi * grid[:, None], 2 * np.pi * hz
    q = 1 / (w_k**2 - w**2 + 2j * ZETA * w_k * w)
    return np.einsum("ok,fk,ik->foi", C, q, B, optimize=True)


def _component(hz: np.ndarray) -> ComponentResult:
    m = hz.size
    one = sp.csc_array(sp.eye_array(3))
    body = FEModel("string", one, one, DofTable(np.arange(1, 4), np.full(3, 1)))
    sigma = 1 / np.arange(1, m + 1) ** 2.0
    found = ModalComponent(
        body=body,
        method="craig-bampton",
        Phi=np.zeros((3, m)),
        omega=2 * np.pi * hz,
        zeta=np.full(m, ZETA),
        rigid_count=0,
        D=None,
        kind=("fixed",) * m,
        source_hz=hz,
        sigma=sigma,
        spacing=np.full(m, 0.01),
        why=("among the first by gregory",) * m,
        basis_size=m,
        cluster=np.repeat(np.arange(m // 4 + 1), 4)[:m],
    )
    checks = (Finding("orthogonality in M", 1e-15, 1e-8),)
    return ComponentResult(
        "string",
        30_000,
        found,
        np.arange(_KEPT),
        {"read": 1.0, "reduce": 20.0, "balance": 3.0},
        400.0,
        checks,
        (Source("string.op4", "0f" * 32, "stiffness"),),
        health=HEALTH,
    )
