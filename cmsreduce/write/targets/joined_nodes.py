"""Interface nodes of a body as it was read or of a component file, and what formats ask of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.model import SCALAR, FEModel
from cmsreduce.write.component import ComponentFile

__all__ = ["JoinedNodes", "an_interface", "frames", "one_frame", "refuse_joined", "single_nodes", "three_frames"]

_SIX, _THREE = 6, 3
# Share of the extent of nodes in one line that they may lie off it: coordinates of decks have seven digits or more.
_IN_LINE = 1e-6


@dataclass(frozen=True)
class JoinedNodes:
    """Nodes of the interfaces of a body.

    Parameters
    ----------
    interfaces : mapping of str to (tuple of int)
        Nodes of each interface.
    components : mapping of int to (frozenset of int)
        Components of each node, in all its interfaces.
    places : mapping of int to (3,) float64
        Coordinates, of the nodes that have some.
    """

    interfaces: Mapping[str, tuple[int, ...]]
    components: Mapping[int, frozenset[int]]
    places: Mapping[int, NDArray[np.float64]]

    @classmethod
    def of_body(cls, body: FEModel) -> Self:
        """Those of a body as it was read."""
        components: dict[int, frozenset[int]] = {}
        places: dict[int, NDArray[np.float64]] = {}
        for each in body.interfaces.values():
            for node, own, place in zip(each.node.tolist(), each.components, each.position, strict=True):
                components[node] = components.get(node, frozenset()) | frozenset(own)
                if body.nodes is not None:
                    places[node] = place
        return cls({name: tuple(each.node.tolist()) for name, each in body.interfaces.items()}, components, places)

    @classmethod
    def of_file(cls, component: ComponentFile) -> Self:
        """Those of a component file."""
        components: dict[int, frozenset[int]] = {}
        arrays = component.arrays
        for name in component.interfaces:
            pairs = zip(arrays[f"interfaces/{name}/node"], arrays[f"interfaces/{name}/component"], strict=True)
            for node, part in pairs:
                components[int(node)] = components.get(int(node), frozenset()) | {int(part)}
        known = zip(arrays.get("nodes/id", ()), arrays.get("nodes/xyz", ()), strict=True)
        places = {int(node): place for node, place in known if int(node) in components}
        return cls({name: tuple(ids) for name, ids in component.interfaces.items()}, components, places)


def refuse_joined(component: ComponentFile, reason: str) -> None:
    """Refuse a component for a reason of its interfaces; nothing for an empty one.

    Raises
    ------
    WriteError
    """
    if reason:
        raise WriteError(f"component '{component.name}': {reason}")


def an_interface(joined: JoinedNodes) -> str:
    """Reason why a body is no superelement; empty if it has an interface."""
    return "" if joined.interfaces else "a superelement needs interfaces, and this body has none"


def frames(joined: JoinedNodes) -> str:
    """Reason why interfaces are no frames of six dofs for a superelement; empty if they are."""
    for node, parts in joined.components.items():
        if len(parts) != _SIX or SCALAR in parts:
            return (
                f"interface node {node} has {len(parts)} of the six dofs that a frame needs; tie the nodes of the "
                "interface to one node with `tie:`, which has all six"
            )
    return an_interface(joined)


def one_frame(joined: JoinedNodes) -> str:
    """Reason why interfaces are not the one node by which ExtPtfm joins a structure to a tower; empty if they are."""
    if len(joined.components) == 1:
        return frames(joined)
    return (
        "ExtPtfm joins the structure to the tower at one node, and its interfaces "
        f"({', '.join(joined.interfaces) or 'none'}) have {len(joined.components)} nodes; give the body this one "
        "interface, hold its feet in the deck, and put other loads on actuators"
    )


def three_frames(joined: JoinedNodes) -> str:
    """Reason why interfaces do not show how a body is turned, by the places of their nodes; empty if they do."""
    places = np.array(list(joined.places.values())).reshape(-1, 3)
    count = len(places)
    across = np.linalg.svd(places - places.mean(axis=0), compute_uv=False) if count >= _THREE else np.zeros(2)
    if not frames(joined) and across[1] <= _IN_LINE * across[0]:
        return (
            f"Radioss needs three interface nodes that are not in one line, and this body has {count}"
            f"{' in a line' if count >= _THREE else ''}; give it interfaces at further nodes, which also show how it "
            "bends"
        )
    return frames(joined)


def single_nodes(joined: JoinedNodes) -> str:
    """Reason why a joint of 42 has no place for an interface; empty if it has."""
    wide = {name: ids for name, ids in joined.interfaces.items() if len(ids) != 1}
    if not wide:
        return ""
    name, ids = next(iter(wide.items()))
    return f"interface '{name}' has {len(ids)} nodes, and a joint of 42 has one; tie them to one node"
