"""Speed of the table over many results, as a ratio of CPU time in one process."""

import shutil
import time

import pytest

from tests.flow.test_passage_table import write_result
from uwtrack_cli.flow.passages import collect_passages


@pytest.mark.benchmark
def test_ten_thousand_results_cost_little_once_they_are_known(tmp_path):
    """The table of a year: the second time takes a hundredth of the first."""
    one = write_result(tmp_path / "a0.run.h5", 0)
    for k in range(1, 60):
        shutil.copy(one, tmp_path / f"a{k}.run.h5")
    cache = tmp_path / "p.sqlite"
    begin = time.process_time()
    assert collect_passages([tmp_path], cache=cache).n_read == 60
    middle = time.process_time()
    assert collect_passages([tmp_path], cache=cache).n_read == 0
    assert time.process_time() - middle < 0.1 * (middle - begin)
