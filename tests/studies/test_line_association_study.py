"""The study of line association in short: its rows, and that it computes."""

import numpy as np
import pytest

from studies.line_association import study_line_association


@pytest.mark.long
def test_association_by_probability_never_covers_less_than_assignment():
    study = study_line_association(runs=3, seed=5)
    cover = {r.case: r.ours for r in study.rows if r.quantity == "cover (share)"}
    plain = {case: value for case, value in cover.items() if case.endswith(", track")}
    assert len(plain) == 8
    for case, value in plain.items():
        assert cover[f"{case}-pda"] > value - 0.02
    wanted = [r.ours for r in study.rows if r.case.startswith("wanted, 3 dB")]
    assert np.all(np.array(wanted) > 0.01)
