"""Pages against the import of what draws them: CPU time of processes, and memory."""

import resource

import pytest

from tests.benchmarks.test_start_speed import ratio_of

pytestmark = pytest.mark.benchmark

PEAK_KB = 400_000
"""Greatest memory of a page."""


@pytest.mark.parametrize(
    ("words", "most"),
    [(["plot", "{product}"], 7.0), (["plot", "{product}", "--passage", "1"], 7.0),
     (["report", "{product}"], 12.0), (["report", "."], 12.0)],
    ids=["recording", "passage", "report", "folder"],
)  # fmt: skip
def test_a_page_costs_some_times_what_draws_it(timed_run, tmp_path, capsys, words, most):
    """5 s of CPU where the import takes 0.4 s are a ratio of 12."""
    (tmp_path / "a.run.h5").symlink_to(timed_run)
    (tmp_path / "pass.wav").symlink_to(timed_run.parent / "pass.wav")
    ours = [word.format(product="a.run.h5") for word in words]
    made = ["-o", "page.png" if "plot" in words else "page.html", "--overwrite"]
    theirs = ["-c", "import matplotlib.figure, scipy.fft"]
    ratio = ratio_of(tmp_path, ["-m", "uwtrack_cli", *ours, *made], theirs, pairs=3)
    peak_kb = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    with capsys.disabled():
        print(f"\n{' '.join(words)}: {ratio:.1f} times the import, {peak_kb / 1e3:.0f} MB")
    assert ratio < most
    assert peak_kb < PEAK_KB
