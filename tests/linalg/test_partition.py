"""Parts of a body: no entry between them, all rows once, few rows between."""

import numpy as np
import pytest

from cmsreduce.errors import MatrixError
from cmsreduce.linalg import partition as module
from cmsreduce.linalg.partition import partition
from tests.frames import line
from tests.solids import block

BODIES = {
    "bar": block("bar", (4.0, 0.2, 0.2), (40, 2, 2)),
    "cube": block("cube", (1.0, 1.0, 1.0), (9, 9, 9)),
    "beam": line("beam", [0, 0, 0], [1, 0, 0], 64),
}


@pytest.mark.parametrize("parts", [1, 2, 5, 16])
@pytest.mark.parametrize("name", BODIES)
def test_parts_share_no_entry_and_have_all_rows(name, parts):
    K = BODIES[name].K
    cut = partition(K, parts)
    assert 1 <= len(cut.interiors) <= parts
    np.testing.assert_array_equal(np.sort(np.concatenate([*cut.interiors, cut.separator])), np.arange(K.shape[0]))
    owner = np.full(K.shape[0], -1)
    for p, rows in enumerate(cut.interiors):
        assert np.all(np.diff(rows) > 0)
        owner[rows] = p
    row, column = K.tocoo().coords
    assert not np.any((owner[row] >= 0) & (owner[column] >= 0) & (owner[row] != owner[column]))
    # METIS balances to a few percent before the rows between the parts are taken from them.
    assert max(rows.size for rows in cut.interiors) < 1.3 * K.shape[0] / parts
    again = partition(K, parts)
    assert all(np.array_equal(a, b) for a, b in zip(again.interiors, cut.interiors, strict=True))


def test_a_bar_is_cut_across():
    # Sections of 9 nodes: as many cuts as parts but one, each of them one section or little more.
    cut = partition(BODIES["bar"].K, 4)
    assert 3 * 27 <= cut.separator.size <= 4 * 27


def test_dofs_of_a_node_stay_together():
    body = BODIES["cube"]
    cut = partition(body.K, 4)
    for rows in (*cut.interiors, cut.separator):
        assert np.all(np.unique(body.dofs.node[rows], return_counts=True)[1] == 3)


def test_without_metis_it_is_refused(monkeypatch):
    monkeypatch.setattr(module, "dissection_installed", lambda: False)
    with pytest.raises(MatrixError, match="pip install pymetis"):
        partition(BODIES["beam"].K, 2)
