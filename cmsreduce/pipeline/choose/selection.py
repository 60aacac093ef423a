"""The balance stage: the modes of each body that a model keeps."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from cmsreduce.assemble import Ports
from cmsreduce.balance import (
    Found,
    Selection,
    elastic_norm,
    keep_all,
    keep_bound,
    keep_cheapest,
    keep_error,
    keep_fraction,
    keep_modes,
    keep_numbers,
    keep_total,
    mode_bounds,
)
from cmsreduce.config import RankingKeys
from cmsreduce.errors import ConfigError, DampingError
from cmsreduce.linalg.blocks import observed
from cmsreduce.model import BoundRecord, Finding, Measured, ModalChannels, ModalComponent, SearchRecord
from cmsreduce.pipeline.system import Candidates

__all__ = ["Choice", "modal_channels", "select", "truncate"]

# The search runs on the grid of the model with all modes, which serves the peaks of that model. A model that misses the
# limit on a grid of its own is refused, its peaks refine the grid, and the search goes on. Once more than three have
# missed the limit by no more than this factor, it is lowered: divided by the excess, and multiplied by the margin.
# Where no model meets the lowered limit, the stated one holds again, and is lowered no more.
_ATTEMPTS = 64
_NEARLY, _NEAR_MISSES = 1.02, 3
_MARGIN = 0.999
_TOGETHER = "modes that share one frequency stay together"
# Damping that couples two modes by less than this share of their own is the rounding of a matrix in single precision.
_UNCOUPLED = 1e-6


def modal_channels(component: ModalComponent, ports: Ports) -> ModalChannels:
    """A body's elastic modes between its inputs and outputs.

    Interface dofs count as inputs and as displacement and rate outputs (theory section 4).

    Parameters
    ----------
    component : ModalComponent
        Orthonormal modes.
    ports : Ports
        i-set, struts, sensors.
    """
    e = component.elastic
    Phi = component.Phi[:, e]
    at_interface = Phi[ports.interface]
    return ModalChannels(
        component.name,
        component.omega[e],
        component.zeta[e],
        np.hstack([at_interface.T, Phi.T @ ports.loads]),
        np.vstack([at_interface, observed(ports.displacements, Phi)]),
        np.vstack([at_interface, observed(ports.rates, Phi)]),
        structural=component.damping.structural is not None,
    )


@dataclass(frozen=True, eq=False)
class Choice:
    """Modes chosen by a keep rule, and how they were chosen.

    Parameters
    ----------
    selection : Selection
    search : SearchRecord, optional
        Record of a search by the error of the system.
    bounds : mapping of body to BoundRecord
        Records of bodies that were truncated by a bound of their own.
    remarks : tuple of str
        Where more modes are kept than the number that was asked for.
    """

    selection: Selection
    search: SearchRecord | None = None
    bounds: Mapping[str, BoundRecord] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """Facts that a reader must know."""
        notes = list(self.remarks)
        if self.search is not None:
            s = self.search
            # Without the seconds, which are in summary.json: notes are part of files that equal runs write equal.
            notes.append(f"{s.words}; {s.candidates} candidates")
        for name, b in self.bounds.items():
            notes.append(
                f"{name}: the error of this body by itself is proven to be below {b.bound:.3g} of its largest elastic "
                f"response (limit {b.asked:g}); it is {b.error:.3g}, {100 * b.tightness:.0f} % of the bound; "
                "the assembled system inherits no such bound, and `verify` measures its error"
            )
        return tuple(notes)

    def joined(self, other: Choice) -> Choice:
        """The choices for some bodies and for others."""
        return Choice(
            {**self.selection, **other.selection},
            self.search or other.search,
            {**self.bounds, **other.bounds},
            self.remarks + other.remarks,
        )


def select(
    components: Mapping[str, ModalComponent],
    keys: RankingKeys,
    channels: Mapping[str, ModalChannels],
    system: Callable[[], tuple[Candidates, Callable[[Selection], Measured]]] | None = None,
    price: Callable[[Selection], float] | None = None,
    below: int | None = None,
) -> Choice:
    """Apply a keep rule to ranked bodies.

    Parameters
    ----------
    components : mapping of name to ModalComponent
        Ranked.
    keys : RankingKeys
        Ranking and rule.
    channels : mapping of name to ModalChannels
        Elastic modes of the bodies, for bounds.
    system : callable, optional
        Gives the two measures of selections that `system_errors` makes, for limits on the system.
    price : callable, optional
        Cost of a simulation with a selection, for a search that minimises it.
    below : int, optional
        As in `keep_error`.

    Raises
    ------
    ConfigError
        If the rule cannot be met.
    DampingError
        If the rule is a bound, and a mode of a body has no damping.
    """
    keep = keys.keep
    if keep.rule == "modes":
        assert keep.modes is not None
        return _counted(keep_modes(components, keep.modes), {name: keep.modes_of(name) for name in components})
    if keep.rule == "numbers":
        assert keep.numbers is not None
        return Choice(keep_numbers(components, keep.numbers))
    if keep.rule == "total":
        assert keep.total is not None
        chosen = keep_total(components, keep.total)
        kept = sum(columns.size for columns in chosen.values())
        more = (
            f"{kept} modes are kept where `total: {keep.total}` asks for fewer: {_TOGETHER}, also those of twin bodies"
        )
        return Choice(chosen, remarks=(more,) if kept > keep.total else ())
    if keep.rule == "fraction":
        assert keep.fraction is not None
        return Choice(keep_fraction(components, keep.fraction))
    if keep.rule == "all":
        return Choice(keep_all(components))
    if keep.rule == "bound":
        assert keep.bound is not None
        return _bounded(components, keep.bound, channels)
    if system is None:
        raise ConfigError(
            f"balance.keep.{keep.rule} needs a response to measure: name at least one actuator and one sensor in the "
            "scene"
        )
    return _searched(components, keys.rank, system, price if keep.minimise == "cost" else None, below)


def _counted(selection: Selection, asked: Mapping[str, int | None]) -> Choice:
    """A selection by numbers of modes, with a remark for each body that keeps more."""
    remarks = []
    for name, columns in selection.items():
        number = asked[name]
        if number is not None and columns.size > number:
            remarks.append(f"{name}: {columns.size} modes are kept where {number} are asked for: {_TOGETHER}")
    return Choice(selection, remarks=tuple(remarks))


def _searched(
    components: Mapping[str, ModalComponent],
    rank: str,
    system: Callable[[], tuple[Candidates, Callable[[Selection], Measured]]],
    price: Callable[[Selection], float] | None,
    below: int | None,
) -> Choice:
    started = time.perf_counter()
    judge, exact = system()
    tried = 0
    rankings = {rank: {name: component.sigma for name, component in components.items()}}
    tables = [component.rankings for component in components.values()]
    for other in tables[0] if tables else ():
        if other != rank and all(other in table for table in tables):
            rankings[other] = {name: component.rankings[other] for name, component in components.items()}
    among, attempts, near = judge.below_highest(), 0, 0
    critical: Finding | None = None
    found: Found | None = None
    while True:
        try:
            if price is None:
                found = keep_error(components, rankings, judge, 1.0, among, below, found)
            else:
                found = keep_cheapest(components, rankings, judge, 1.0, price, among)
        except ConfigError:
            if judge.relax():
                near = -_ATTEMPTS
                continue
            if critical is None:
                raise
            raise ConfigError(_missed(critical)) from None
        tried, attempts = tried + found.tried, attempts + 1
        measured = exact(found.selection)
        critical = measured.critical
        assert critical is not None
        if critical.ratio <= 1:
            worst = measured.findings.get("frf_error")
            record = SearchRecord(
                limits=measured.limits,
                critical=critical,
                obstacle=None if found.nearest is None else judge.critical(found.nearest),
                frf_error=None if worst is None else worst.value,
                modes=found.modes,
                of=sum(component.elastic_count for component in components.values()),
                candidates=tried,
                seconds=time.perf_counter() - started,
                truncated=found.truncated,
                operations=None if price is None else price(found.selection),
            )
            return Choice(found.selection, record)
        if attempts == _ATTEMPTS:
            raise ConfigError(_missed(critical))
        judge.refuse(found.selection, critical)
        near += critical.ratio <= _NEARLY
        if critical.ratio <= _NEARLY and near > _NEAR_MISSES:
            judge.tighten(critical.limit_name, _MARGIN / critical.ratio)


def _missed(finding: Finding) -> str:
    """Message on a limit that every model found missed on a grid of its own."""
    return (
        f"balance.keep: no model was found that meets {finding.name} {finding.limit:g} on a grid of its own; the last "
        f"one reached {finding.value:.3g} ({finding.note}). Raise reduce.cutoff, or allow a larger error"
    )


def _bounded(components: Mapping[str, ModalComponent], asked: float, channels: Mapping[str, ModalChannels]) -> Choice:
    selection, bounds = {}, {}
    for name, component in components.items():
        _refuse_coupled(component)
        body = channels[name]
        kept, size = keep_bound(body, asked), elastic_norm(body)
        left_out = body.only(np.setdiff1d(np.arange(body.count), kept))
        bound = sum(mode_bounds(left_out)[1])
        selection[name] = component.elastic.start + kept
        bounds[name] = BoundRecord(asked, bound / size if size else 0.0, elastic_norm(left_out) / size if size else 0.0)
    return Choice(selection, bounds=bounds)


def _refuse_coupled(component: ModalComponent) -> None:
    """Refuse a bound where the response is no sum over modes, each by itself."""
    coupling = ""
    if component.D is not None:
        damping = component.D.diagonal()
        # Motions that nothing damps have its rounding.
        own = np.sqrt(np.maximum(damping, _UNCOUPLED * damping.max(initial=0.0)))
        coupled = abs(component.D - np.diag(damping)) > _UNCOUPLED * np.outer(own, own)
        coupling = "its damping matrix couples" if coupled.any() else ""
    if component.terms:
        coupling = "gyroscopic forces or parameters couple"
    if coupling:
        raise DampingError(
            f"body '{component.name}': balance.keep.bound adds up the responses of modes that move independently, but "
            f"{coupling} them. Keep by `limits` or `frf_error`, which measure the response, or by `modes` or `fraction`"
        )


def truncate(
    components: Mapping[str, ModalComponent], selection: Selection, reasons: Mapping[str, str]
) -> dict[str, ModalComponent]:
    """Keep the selected modes of every body, with the reason."""
    kept = {}
    for name, component in components.items():
        e = component.elastic
        why = component.why[: e.start] + (reasons[name],) * component.elastic_count + component.why[e.stop :]
        kept[name] = component.truncated(selection[name], why)
    return kept
