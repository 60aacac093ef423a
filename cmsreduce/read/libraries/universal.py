"""Arrays of universal files, which pyuff reads. A part of ``program.py``: it imports nothing of cmsreduce."""

from typing import Any

Arrays = dict[str, Any]

# Linear elements of I-DEAS; those with nodes between corners list them in another order.
_UNIVERSAL_KINDS = {
    **dict.fromkeys((11, 21), "line"),
    **dict.fromkeys((41, 91), "triangle"),
    **dict.fromkeys((44, 94), "quad"),
    111: "tetra",
    112: "wedge",
    115: "hexahedron",
}


def universal(path: str) -> Arrays:
    """Nodes, frames, cells and modes of a universal file (datasets 15, 55, 2411, 2412, 2414, 2420)."""
    import numpy as np
    import pyuff

    file = pyuff.UFF(path)
    types = [int(kind) for kind in file.get_set_types()]
    sets = {kind: [file.read_sets(at) for at, each in enumerate(types) if each == kind] for kind in {*types}}
    nodes = [*sets.get(15, []), *sets.get(2411, [])]
    systems = sets.get(2420, [])
    arrays: Arrays = {
        name: np.concatenate([np.ravel(each[name]) for each in nodes] or [np.empty(0)])
        for name in ("node_nums", "disp_cs", "x", "y", "z")
    }
    arrays["systems"] = np.concatenate([np.ravel(each["CS_sys_labels"]) for each in systems] or [np.empty(0)])
    matrices = [np.asarray(matrix)[:3] for each in systems for matrix in each["CS_matrices"]]
    arrays["axes"] = np.array(matrices).reshape(-1, 3, 3)
    for at, each in enumerate(sets.get(2412, [])):
        for number, kind in _UNIVERSAL_KINDS.items():
            if number in each:
                arrays[f"{at}-{number} {kind}"] = np.array(
                    [np.ravel(one["nodes_nums"]) for one in each[number]], dtype=int
                )
    return arrays | _universal_modes([*sets.get(55, []), *sets.get(2414, [])])


# Normal modes, complex modes of first order (displacement), and complex modes of second order (velocity).
_UNIVERSAL_MODES = (2, 3, 7)
_COMPLEX = 5


def _universal_modes(sets: Any) -> Arrays:
    """Figures of every mode in one row, and its nodes and shape by its number; other results are left out."""
    import numpy as np

    figures: list[list[float]] = []
    arrays: Arrays = {}
    for each in sets:
        new = each["type"] == 2414
        if each["analysis_type"] not in _UNIVERSAL_MODES or (new and each["dataset_location"] != 1):
            continue
        number = len(figures)
        kind = each["result_type"] if new else each["spec_data_type"]
        count = each["number_of_data_values_for_the_data_component"] if new else each["n_data_per_node"]
        if new:
            eight, nine = ([each[f"record{record}_field{k}"] for k in range(1, 7)] for record in (12, 13))
            hz, mass, zeta, loss = eight[1], *eight[3:6]
            pole, A = complex(*nine[:2]), complex(*nine[2:4])
            shape = np.array(each["data_at_node"])
            if shape.dtype.kind != "c" and each["data_type"] == _COMPLEX and shape.shape[-1] == 2 * count:
                shape = shape[:, ::2] + 1j * shape[:, 1::2]
            mode = each["record10_field6"]
        else:
            hz, mass, zeta, loss = (
                each.get(key, 0.0) for key in ("freq", "modal_m", "modal_damp_vis", "modal_damp_his")
            )
            pole, A = each.get("eig", 0.0), each.get("modal_a", 0.0)
            shape = np.column_stack([each[f"r{k + 1}"] for k in range(count)])
            mode = each["mode_n"]
        facts = [mode, each["analysis_type"], kind, hz, mass, zeta, loss, pole.real, pole.imag, A.real, A.imag]
        figures.append([float(fact) for fact in facts])
        arrays |= {f"nodes {number}": np.asarray(each["node_nums"], dtype=int), f"shape {number}": shape}
    return {"modes": np.array(figures).reshape(len(figures), 11), **arrays}
