"""benchmarks/performance.md and its picture, from the runs that `linear_algebra.py` and `error_speed.py` kept."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.contest import OURS, PEERS, RECORDS
from benchmarks.machine_limits import Limits
from benchmarks.meshes import BODIES, INTERFACE_NODES, MODES, SLENDER

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "benchmarks" / "performance.md"
PICTURE = ROOT / "benchmarks" / "images" / "performance.svg"
ERROR_SPEED = RECORDS / "error_speed.json"

# Limit on |K x - lam M x| / |lam M x| of every mode.
RESIDUAL = 1e-8
# Relative difference of frequencies of one mode: CalculiX prints seven digits.
SAME = 1e-6
# Smaller bodies are left out of the growth, because the start dominates their time.
_GROWTH_FROM = 10_000
_FEWEST_POINTS = 3

COLUMNS = (
    "factorise, s",
    "solves, s",
    "modes, s",
    "total, s",
    "of ours",
    "peak, GiB",
    "residual",
    "modes",
    "frequencies differ by",
)
LIMIT_COLUMNS = (
    "factor",
    "entries",
    "GFLOP",
    "GFLOP/s",
    "of dgemm",
    "solves, of bandwidth",
    "modes / their solves",
    "blocks of columns",
)

SEARCH_COLUMNS = ("columns", "solves, s", "rest, s", "modes, s", "of ours over this factor")

Found = dict[tuple[str, str], dict]

INTRODUCTION = f"""\
# Performance

One Craig-Bampton problem by several programs: {3 * INTERFACE_NODES} constraint modes ({INTERFACE_NODES} nodes of the
face opposite the held one) and the {MODES} lowest fixed-interface modes of a steel body. Every peer runs in a process
of its own, with the same threads, and reads the same two matrices. Not timed: reading, the start of a program, and
the compilation of cmsreduce's loops, which a machine does once. `make bench-full` writes this page ([how to run
it](README.md)).

- **factorise**: with ordering; cmsreduce orders in its Sturm count where it makes one. **solves**: one block of
  {3 * INTERFACE_NODES} right-hand sides. **modes**: the eigenproblem. A peer that does all in one call has a total
  only. **Peak**: of the process, with matrices and interpreter.
- **Residual**: the worst |K x - lam M x| / |lam M x| (2-norms) of a mode. The limit is {RESIDUAL:g}. The constraint
  modes have the same limit on |K Psi + K_ji| / |K_ji|. A peer above it is marked `!`.
- **Frequencies differ by**: the largest relative difference from cmsreduce's. A mode without a partner within
  {SAME:g} is missed.
- cmsreduce computes all modes below a cutoff between the {MODES}th and the next, and a Sturm count proves that none is
  missing. No peer has that proof; its time is not in the total.
- **single-precision factor** is `solver: {{precision: single}}`. cmsreduce takes it where a factor in double
  precision does not fit.
- **scipy** is splu and eigsh as its users write them, with SuperLU's default order (COLAMD), its best own order (MMD
  on A + A^T, symmetric mode) and METIS's order. **SLEPc** is Krylov-Schur of the Debian packages; with MUMPS in one
  process, where OpenBLAS takes the threads, and in two. **Exudyn** factorises once for the modes and once for the
  constraint modes, by SuperLU in its default order. **sdynpy** is dense. **CalculiX** solves no static problem and
  assembles K and M itself, within its total; its shapes have no residual here. Its hexahedra are the same as here,
  its linear tetrahedra integrate the mass at one point.
- **ARPACK** is scipy's eigsh over a factor of cmsreduce, PARDISO's or its own, beside cmsreduce over the same factor. A
  second table has the time of the solves within each search, which is the factor's, and the rest, which is the
  eigensolver's.
"""
_SMALL = (
    "Three quarters of cmsreduce's time for the modes are not solves: block steps have a fixed cost in Python, and use "
    "more columns than a search vector by vector."
)
FASTER: dict[tuple[str, str], str] = {
    ("bar-3e3", "slepc-cholmod"): _SMALL,
    **{("bar-3e3", peer): "As above." for peer in ("slepc-mumps", "scipy", "scipy-mmd", "scipy-metis")},
}
"""Reasons for a faster peer, by (body, peer); printed under the table."""


def page(found: Found, limits: Limits | None) -> Iterator[str]:
    """Lines of the page."""
    yield INTRODUCTION
    if limits is not None:
        yield f"Machine: {limits.machine}. {_threads(found)}\n"
    for body in BODIES:
        if any(where == body for where, _ in found):
            yield from body_table(body, found)
            yield ""
            yield from search_table(body, found)
    yield from growth_table(found)
    yield from limit_table(found, limits)
    yield from error_speed_table()


def body_table(body: str, found: Found, only: tuple[str, ...] | list[str] | None = None) -> Iterator[str]:
    """Every peer on one body, the quickest first."""
    here = {peer: record for (where, peer), record in found.items() if where == body and (not only or peer in only)}
    yield f"## {BODIES[body].title[0].upper()}{BODIES[body].title[1:]}, {BODIES[body].n} dofs\n"
    yield f"| | {' | '.join(COLUMNS)} |"
    yield "|---" * (len(COLUMNS) + 1) + "|"
    ours = here.get(OURS)
    reference = _reference(here)
    done = sorted((peer for peer in here if here[peer]["status"] == "ok"), key=lambda peer: here[peer]["total_s"])
    for peer in done:
        yield _row(peer, here[peer], ours, reference)
    for peer in (peer for peer in PEERS if peer in here and peer not in done):
        yield f"| {PEERS[peer].title} | | | | {here[peer]['status']} | | | | | |"
    notes = []
    if ours and "certificate" in ours.get("seconds", {}):
        notes.append(f"cmsreduce's certificate, timed apart: {_s(ours['seconds']['certificate'])} s.")
    for peer in done:
        quicker = ours and ours["status"] == "ok" and OURS not in peer and here[peer]["total_s"] < ours["total_s"]
        if quicker and not _poor(here[peer]):
            notes.append(f"**{PEERS[peer].title} is faster here.** {FASTER.get((body, peer), '')}".strip())
    if notes:
        yield "\n" + textwrap.fill(" ".join(notes), 120).rstrip()


def search_table(body: str, found: Found) -> Iterator[str]:
    """Searches for the modes: time of their solves, which is the factor's, and the rest, which is the eigensolver's."""
    here = {peer: record for (where, peer), record in found.items() if where == body and record["status"] == "ok"}
    searched = [peer for peer in PEERS if "modes_solves" in here.get(peer, {}).get("seconds", {})]
    # Peers over a factor that only they have are compared with no one.
    if not any(_over_this_factor(peer) in here for peer in searched if OURS not in peer):
        return
    yield f"The search for the modes, {BODIES[body].n} dofs:\n"
    yield f"| | {' | '.join(SEARCH_COLUMNS)} |"
    yield "|---" * (len(SEARCH_COLUMNS) + 1) + "|"
    for peer in searched:
        record, ours = here[peer], here.get(_over_this_factor(peer))
        whole, inside = (record["seconds"][step] for step in ("modes", "modes_solves"))
        ratio = "" if ours is None or OURS in peer else f"{whole / ours['seconds']['modes']:.2g}"
        columns = f"{record['passes']} of {record['columns'] / record['passes']:.3g}"
        figures = [columns, _s(inside), _s(whole - inside), _s(whole), ratio]
        yield f"| {PEERS[peer].title} | {' | '.join(figures)} |"
    yield ""


def _over_this_factor(peer: str) -> str:
    """Name of cmsreduce over the factor of a peer."""
    return f"{OURS}-{peer.rpartition('-')[2]}"


def _row(peer: str, record: dict, ours: dict | None, reference: np.ndarray | None) -> str:
    seconds, hz, residual = record["seconds"], np.array(record["hz"]), record.get("residual")
    whole = ours is not None and ours["status"] == "ok"
    ratio = "" if not whole or peer == OURS else f"{record['total_s'] / ours['total_s']:.2g}"
    shown = ("" if residual is None else f"{residual:.0e}") + (" !" if _poor(record) else "")
    missed, differ = "", ""
    if reference is not None:
        missed, differ = _compared(hz, reference)
    figures = [_s(seconds.get(step)) for step in ("factorise", "solves", "modes")]
    figures += [_s(record["total_s"]), ratio, f"{record['peak_gib']:.2f}", shown, f"{hz.size}{missed}", differ]
    return f"| {PEERS[peer].title} | {' | '.join(figures)} |"


def _poor(record: dict) -> bool:
    """True if a residual is above the limit."""
    return max(record.get("residual", 0.0), record.get("static_residual", 0.0)) > RESIDUAL


def _reference(here: dict[str, dict]) -> np.ndarray | None:
    """Reference frequencies: cmsreduce's, or those of the first accurate peer."""
    for peer in PEERS:
        record = here.get(peer)
        if record and record["status"] == "ok" and "residual" in record and not _poor(record):
            return np.array(record["hz"][:MODES])
    return None


def _compared(hz: np.ndarray, reference: np.ndarray) -> tuple[str, str]:
    """Modes of the reference that are missed, and the difference of those in the same place."""
    common = min(hz.size, reference.size)
    if not common:
        return "", ""
    differ = float(abs(hz[:common] / reference[:common] - 1).max())
    nearest = abs(hz[None, :] / reference[:, None] - 1).min(axis=1)
    missed = int(np.count_nonzero(nearest > SAME))
    # Elements of another kind move all frequencies: then the body differs, and no mode is missed.
    other = missed > reference.size // 2 or not missed
    return ("" if other else f", {missed} missed"), f"{differ:.0e}"


@dataclass(frozen=True)
class Growth:
    """Exponents of time and memory against size, and the dofs they were fitted to."""

    time: float
    memory: float
    sizes: tuple[int, ...]


def growth(found: Found, peer: str) -> Growth | None:
    """Least squares in logarithms over the slender solids of a peer."""
    did = [found[body, peer] for body in SLENDER if found.get((body, peer), {}).get("status") == "ok"]
    did = [record for record in did if record["n"] >= _GROWTH_FROM]
    if len(did) < _FEWEST_POINTS:
        return None
    n, seconds, gib = (np.log([record[key] for record in did]) for key in ("n", "total_s", "peak_gib"))
    return Growth(
        float(np.polyfit(n, seconds, 1)[0]), float(np.polyfit(n, gib, 1)[0]), tuple(record["n"] for record in did)
    )


def growth_table(found: Found) -> Iterator[str]:
    """Growth of time and memory, and the picture."""
    fitted = {peer: grown for peer in PEERS if (grown := growth(found, peer)) is not None}
    if not fitted:
        return
    yield "## Growth with size\n"
    yield "Slender solids; time ~ n^a, memory ~ n^b, least squares in logarithms.\n"
    yield f"![Time and memory against size]({PICTURE.relative_to(PAGE.parent)})\n"
    yield "| | a (time) | b (memory) | dofs |\n|---|---|---|---|"
    for peer, grown in fitted.items():
        span = f"{grown.sizes[0]} to {grown.sizes[-1]}"
        yield f"| {PEERS[peer].title} | {grown.time:.2f} | {grown.memory:.2f} | {span} |"
    yield ""


def limit_table(found: Found, limits: Limits | None) -> Iterator[str]:
    """Rates of cmsreduce against the limits of the machine."""
    if limits is None:
        return
    rows = [
        _limit_row(record, limits)
        for (_, peer), record in sorted(found.items(), key=lambda at: at[1]["n"])
        if peer == OURS
    ]
    yield "## How far from the limit\n"
    products = ", ".join(f"{rate / 1e9:.0f} ({name})" for name, rate in limits.dgemm.items())
    memory = ", ".join(f"{rate / 1e9:.1f} ({name})" for name, rate in limits.bandwidth.items())
    yield textwrap.fill(
        f"Measured on {limits.threads} threads: dgemm {products} GFLOP/s; memory {memory} GB/s. Compared with them: "
        "the factorisation (of the multifrontal solver the numeric phase) with the best dgemm rate; a block of solves "
        "with the time in which the best bandwidth reads the factor twice; a search for modes with the solves "
        "within it.",
        120,
    )
    yield f"\n| body | {' | '.join(LIMIT_COLUMNS)} |"
    yield "|---" * (len(LIMIT_COLUMNS) + 1) + "|"
    yield from (row for row in rows if row)
    yield ""


def _limit_row(record: dict, limits: Limits) -> str:
    if record["status"] != "ok":
        return ""
    seconds, flops, nnz = record["seconds"], record.get("flops"), record.get("factor_nnz")
    # The numeric phase alone, where it is known, because ordering has few products.
    rate = None if flops is None else flops / seconds.get("numeric", seconds["factorise"])
    read_twice = None if nnz is None else 2 * 8 * nnz / limits.bytes
    inside = seconds.get("modes_solves")
    figures = [
        record.get("backend") or "",
        "" if nnz is None else f"{nnz:.2e}",
        "" if flops is None else f"{flops / 1e9:.0f}",
        "" if rate is None else f"{rate / 1e9:.1f}",
        "" if rate is None else f"{100 * rate / limits.flops:.0f} %",
        "" if read_twice is None else f"{100 * read_twice / seconds['solves']:.0f} %",
        "" if not inside else f"{seconds['modes'] / inside:.2f}",
        "" if record.get("passes") is None else f"{record['passes']} of {record['columns'] / record['passes']:.3g}",
    ]
    body = BODIES[record["body"]]
    return f"| {body.title}, {body.n} | {' | '.join(figures)} |"


def error_speed_table() -> Iterator[str]:
    """Error against modes kept and seconds of the whole reduction."""
    if not ERROR_SPEED.exists():
        return
    kept = json.loads(ERROR_SPEED.read_text(encoding="utf-8"))
    yield "## Error against speed\n"
    yield textwrap.fill(kept["what"], 120) + "\n"
    yield "| cutoff / band | columns | frf_error | db_error | reduction, s |\n|---|---|---|---|---|"
    for row in kept["rows"]:
        yield (
            f"| {row['cutoff']:g} | {row['columns']} | {100 * row['frf_error']:.3g} % | {row['db_error']:.3g} dB "
            f"| {_s(row['seconds'])} |"
        )


def picture(found: Found, path: Path) -> None:
    """Time and memory against size, logarithmic, slender solids."""
    import matplotlib as mpl

    mpl.use("svg")
    from matplotlib import pyplot as plt

    with mpl.rc_context(
        {"svg.hashsalt": "performance", "svg.fonttype": "none", "font.size": 9, "axes.grid": True, "grid.alpha": 0.3}
    ):
        figure, axes = plt.subplots(1, 2, figsize=(9, 3.8), constrained_layout=True)
        for peer in PEERS:
            did = [found[body, peer] for body in SLENDER if found.get((body, peer), {}).get("status") == "ok"]
            if not did:
                continue
            style = {"linewidth": 2.5, "color": "black", "zorder": 3} if peer == OURS else {"linewidth": 1.2}
            n = [record["n"] for record in did]
            for axis, key in zip(axes, ("total_s", "peak_gib"), strict=True):
                axis.loglog(n, [record[key] for record in did], "o-", markersize=3, label=PEERS[peer].title, **style)
        for axis, what in zip(axes, ("seconds", "peak memory, GiB"), strict=True):
            axis.set(xlabel="dofs", ylabel=what)
        axes[0].legend(fontsize=7)
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, metadata={"Date": None})
        plt.close(figure)


def write(found: Found, limits: Limits | None) -> None:
    """Write the page and its picture."""
    PAGE.write_text("\n".join(page(found, limits)).rstrip() + "\n", encoding="utf-8")
    picture(found, PICTURE)


def _threads(found: Found) -> str:
    counts = sorted({record["threads"] for record in found.values()})
    return f"Threads of each peer: {', '.join(map(str, counts))}." if counts else ""


def _s(seconds: float | None) -> str:
    """Seconds in three digits."""
    return "" if seconds is None else f"{seconds:.3g}" if seconds < 1000 else f"{seconds:.0f}"
