"""Reduced bodies as arrays for the stage store, and back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from cmsreduce.model import FEModel, ModalComponent, ModeCertificate, ModeSet, ReducedComponent

__all__ = ["modal_from", "modal_to", "reduced_from", "reduced_to"]

Arrays = dict[str, NDArray[Any]]


def reduced_to(component: ReducedComponent, missed: Mapping[str, float]) -> tuple[Arrays, dict[str, Any]]:
    """Arrays and facts of a reduced body, and the shares of static flexibility that its basis misses."""
    arrays = {
        "Phi": component.modes.Phi,
        "source_hz": component.modes.source_hz,
        "M": component.M,
        "K": component.K,
        "rigid": component.rigid,
    }
    if component.D is not None:
        arrays["D"] = component.D
    facts = {
        "method": component.modes.method,
        "kind": component.modes.kind,
        "label": component.modes.label,
        "missed": missed,
    }
    return _with_certificate(arrays, facts, component.modes.certificate)


def reduced_from(body: FEModel, arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]) -> ReducedComponent:
    """Reduced body from its arrays."""
    modes = ModeSet(
        facts["method"],
        arrays["Phi"],
        tuple(facts["kind"]),
        arrays["source_hz"],
        tuple(facts["label"]),
        _certificate(arrays, facts),
    )
    return ReducedComponent(body, modes, arrays["M"], arrays["K"], arrays.get("D"), arrays["rigid"])


_MODAL = ("Phi", "omega", "zeta", "source_hz", "sigma", "spacing")


def modal_to(component: ModalComponent) -> tuple[Arrays, dict[str, Any]]:
    """Arrays and facts of a body in orthonormal modes."""
    arrays = {name: getattr(component, name) for name in _MODAL}
    if component.D is not None:
        arrays["D"] = component.D
    facts = {
        "method": component.method,
        "rigid_count": component.rigid_count,
        "static_count": component.static_count,
        "neglected_count": component.neglected_count,
        "kind": component.kind,
        "why": component.why,
        "basis_size": component.basis_size,
        "basis_rank": component.basis_rank,
        "basis_condition": component.basis_condition,
    }
    return _with_certificate(arrays, facts, component.certificate)


def modal_from(body: FEModel, arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]) -> ModalComponent:
    """Body in orthonormal modes from its arrays."""
    return ModalComponent(
        body=body,
        method=facts["method"],
        rigid_count=facts["rigid_count"],
        # Stages that were finished before static modes were known have none.
        static_count=facts.get("static_count", 0),
        neglected_count=facts.get("neglected_count", 0),
        kind=tuple(facts["kind"]),
        why=tuple(facts["why"]),
        basis_size=facts["basis_size"],
        basis_rank=facts["basis_rank"],
        basis_condition=facts["basis_condition"],
        D=arrays.get("D"),
        certificate=_certificate(arrays, facts),
        # Modes are stored before they are ranked.
        rankings={},
        **{name: arrays[name] for name in _MODAL},
    )


def _with_certificate(
    arrays: Arrays, facts: dict[str, Any], certificate: ModeCertificate | None
) -> tuple[Arrays, dict[str, Any]]:
    """The same with a certificate beside them."""
    if certificate is None:
        return arrays, facts
    own = {"certified_hz": certificate.frequency_hz, "bound": certificate.bound}
    return {**arrays, **own}, {**facts, "cutoff_hz": certificate.cutoff_hz, "counted": certificate.counted}


def _certificate(arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]) -> ModeCertificate | None:
    """The certificate beside the arrays; None in stages that were finished before there was one."""
    if "bound" not in arrays:
        return None
    return ModeCertificate(facts["cutoff_hz"], facts["counted"], arrays["certified_hz"], arrays["bound"])
