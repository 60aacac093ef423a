"""modelDescription.xml of a Functional Mock-up Unit, by the schemas of FMI 3.0 and 2.0."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import SI, Units
from cmsreduce.write.targets.fmi.linear_model import LinearModel, Port

__all__ = ["build_description", "model_description"]

# Of the highest frequency: explicit integrators of fixed step are stable and its phase is right to a few degrees.
_STEPS_A_PERIOD = 20
# Of the lowest elastic frequency.
_PERIODS = 10

_INDEPENDENT, _STATE, _DERIVATIVE, _INPUT, _OUTPUT = "independent", "state", "derivative", "input", "output"


def model_description(model: LinearModel, version: str, identifier: str, token: str, source: str) -> bytes:
    """Content of modelDescription.xml.

    Parameters
    ----------
    model : LinearModel
        States, inputs, outputs.
    version : {"fmi3", "fmi2"}
        Version of the standard.
    identifier, token : str
        Name of the binary, and the mark by which the binary knows this description.
    source : str
        C source to compile.
    """
    three = version == "fmi3"
    root = ET.Element("fmiModelDescription", fmiVersion="3.0" if three else "2.0", modelName=model.name)
    root.attrib |= {
        "instantiationToken" if three else "guid": token,
        "description": model.about,
        "generationTool": "cmsreduce",
        "variableNamingConvention": "flat",
    }
    if not three:
        root.set("numberOfEventIndicators", "0")
    states = "FMUState" if three else "FMUstate"
    able = {"modelIdentifier": identifier, f"canGetAndSet{states}": "true", f"canSerialize{states}": "true"}
    able |= {"providesDirectionalDerivatives" if three else "providesDirectionalDerivative": "true"}
    able |= {"providesAdjointDerivatives": "true"} if three else {}
    # Co-simulation steps of any length are exact, and model exchange needs no call after a step.
    no_call = "needsCompletedIntegratorStep" if three else "completedIntegratorStepNotNeeded"
    interfaces = [
        ET.SubElement(root, "ModelExchange", able | {no_call: "false" if three else "true"}),
        ET.SubElement(root, "CoSimulation", able | {"canHandleVariableCommunicationStepSize": "true"}),
    ]
    for interface in () if three else interfaces:
        ET.SubElement(ET.SubElement(interface, "SourceFiles"), "File", name=source)
    variables = _variables(model)
    _units(root, model, {unit for *_, unit in variables if unit})
    ET.SubElement(root, "DefaultExperiment", _experiment(model.frequency_hz))
    _put_variables(ET.SubElement(root, "ModelVariables"), variables, model.nominal, three)
    _put_structure(ET.SubElement(root, "ModelStructure"), model, three)
    return _bytes(root)


def build_description(identifier: str, source: str) -> bytes:
    """Content of buildDescription.xml, which tells an importer of FMI 3.0 what to compile."""
    root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
    files = ET.SubElement(ET.SubElement(root, "BuildConfiguration", modelIdentifier=identifier), "SourceFileSet")
    files.set("language", "C99")
    ET.SubElement(files, "SourceFile", name=source)
    ET.SubElement(root[0], "Library", name="m")
    return _bytes(root)


def _bytes(root: ET.Element) -> bytes:
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="UTF-8", xml_declaration=True)) + b"\n"


def _variables(model: LinearModel) -> list[tuple[str, str, str, str]]:
    """Kind, name, description and unit of every variable, in the order of their value references."""
    found = [(_INDEPENDENT, "time", "", "s")]
    modes = list(enumerate(model.frequency_hz, 1))
    facts = [f"mode {k}, {f'{f:.6g} Hz undamped' if f else 'without strain'}" for k, f in modes]
    names = [f"q[{k}]" for k, _ in modes] + [f"v[{k}]" for k, _ in modes]
    abouts = [f"amplitude of {fact}, unit modal mass" for fact in facts] + [f"rate of {fact}" for fact in facts]
    found += [(_STATE, name, about, "") for name, about in zip(names, abouts, strict=True)]
    found += [(_DERIVATIVE, f"der({name})", "", "") for name in names]
    taken = {name for _, name, *_ in found}
    for kind, ports in ((_INPUT, model.inputs), (_OUTPUT, model.outputs)):
        for port in ports:
            name = port.name if port.name not in taken else f"{port.name} {kind}"
            taken.add(name)
            found.append((kind, name, port.quantity, _unit(port, model.units)))
    return found


def _unit(port: Port, units: Units | None) -> str:
    """Name of the unit of a channel; empty if it has none."""
    if units is None:
        return ""
    length, mass, time = units.name.split("-")
    kind, _, rate = port.quantity.partition(" ")
    plain = {
        "force": "N" if units == SI else f"{mass}.{length}/{time}2",
        "torque": "N.m" if units == SI else f"{mass}.{length}2/{time}2",
        "translation": length,
        "rotation": "rad",
    }
    return plain.get(kind, "") + (f"/{time}" if rate and kind in plain else "")


def _units(root: ET.Element, model: LinearModel, used: set[str]) -> None:
    """Units of the channels by their SI units."""
    units = model.units or SI
    kinds = {
        "force": (1, 1, -2, units.force),
        "torque": (1, 2, -2, units.energy),
        "translation": (0, 1, 0, units.length),
    }
    group = ET.SubElement(root, "UnitDefinitions")
    ET.SubElement(ET.SubElement(group, "Unit", name="s"), "BaseUnit", s="1")
    done = {"s"}
    for port in (*model.inputs, *model.outputs):
        name = _unit(port, model.units)
        if name not in used - done:
            continue
        done.add(name)
        kind, _, rate = port.quantity.partition(" ")
        kg, m, s, factor = kinds.get(kind, (0, 0, 0, 1.0))
        powers = {"kg": kg, "m": m, "s": s - bool(rate), "rad": int(kind == "rotation")}
        base = {what: str(power) for what, power in powers.items() if power}
        factor /= units.time if rate else 1.0
        unit = ET.SubElement(group, "Unit", name=name)
        ET.SubElement(unit, "BaseUnit", base | ({"factor": repr(factor)} if factor != 1 else {}))


def _experiment(frequency_hz: NDArray[np.float64]) -> dict[str, str]:
    elastic = frequency_hz[frequency_hz > 0]
    stop = _PERIODS / elastic.min() if elastic.size else 1.0
    step = 1 / (_STEPS_A_PERIOD * elastic.max()) if elastic.size else 0.01
    return {"startTime": "0", "stopTime": f"{stop:.6g}", "tolerance": "1e-8", "stepSize": f"{step:.3g}"}


def _put_variables(
    group: ET.Element, variables: list[tuple[str, str, str, str]], nominal: NDArray[np.float64], three: bool
) -> None:
    states = sum(kind == _STATE for kind, *_ in variables)
    facts = {
        _INDEPENDENT: {"causality": "independent"},
        _STATE: {"causality": "local", "initial": "exact"},
        _DERIVATIVE: {"causality": "local", "initial": "calculated"},
        _INPUT: {"causality": "input"},
        _OUTPUT: {"causality": "output", "initial": "calculated"},
    }
    for reference, (kind, name, about, unit) in enumerate(variables):
        named = {"name": name, "valueReference": str(reference)} | ({"description": about} if about else {})
        of_type = {"unit": unit} if unit else {}
        if kind in (_STATE, _INPUT):
            of_type["start"] = "0"
        if kind == _STATE:
            of_type["nominal"] = f"{nominal[reference - 1]:.6g}"
        if kind == _DERIVATIVE:
            # Version 2.0 counts variables from 1, version 3.0 has value references; time is the first variable, 0.
            of_type["derivative"] = str(reference - states + (not three))
        common = named | facts[kind] | {"variability": "continuous"}
        if three:
            ET.SubElement(group, "Float64", common | of_type)
        else:
            ET.SubElement(ET.SubElement(group, "ScalarVariable", common), "Real", of_type)


def _put_structure(group: ET.Element, model: LinearModel, three: bool) -> None:
    """Outputs, state derivatives and initial unknowns, each with the states and inputs that act on it."""
    n, shift = model.n, 0 if three else 1
    known = np.concatenate([np.arange(1, n + 1), np.arange(2 * n + 1, 2 * n + 1 + len(model.inputs))]) + shift

    def rows(matrix: NDArray[np.float64], first: int) -> list[dict[str, str]]:
        key = "valueReference" if three else "index"
        return [
            {key: str(first + row + shift), "dependencies": " ".join(map(str, known[np.flatnonzero(entries)]))}
            for row, entries in enumerate(matrix)
        ]

    outputs = rows(np.hstack([model.C, model.D]), 2 * n + 1 + len(model.inputs))
    derivatives = rows(np.hstack([model.A, model.B]), n + 1)
    # Initial unknowns of version 2.0 are ordered as the variables are.
    lists: Iterable[tuple[str, str, list[dict[str, str]]]] = (
        ("Outputs", "Output", outputs),
        ("Derivatives", "ContinuousStateDerivative", derivatives),
        ("InitialUnknowns", "InitialUnknown", derivatives + outputs),
    )
    for plural, single, unknowns in lists:
        into = group if three or not unknowns else ET.SubElement(group, plural)
        for unknown in unknowns:
            ET.SubElement(into, single if three else "Unknown", unknown)
