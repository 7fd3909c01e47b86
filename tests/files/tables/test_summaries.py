"""A summary never shows a deviation as zero, and a dash for what is not known."""

import pytest

from uwtrack_cli.files.tables.summaries import SUMMARIES, Head

HEAD = Head("time s", "time_s", 1, "time_std_s")


@pytest.mark.parametrize(
    ("value", "deviation", "text"),
    [
        (148.0496, 0.0407, "148.05 ± 0.04"),
        (148.0496, 0.4, "148.0 ± 0.4"),
        (148.0496, 0.05, "148.0 ± 0.1"),
        (148.0496, 12.0, "148.0 ± 12.0"),
        (148.0496, 0.0, "148.0 ± 0.0"),
        (148.0496, None, "148.0"),
        (None, None, "-"),
    ],
)
def test_as_many_digits_as_the_deviation_needs(value, deviation, text):
    assert HEAD.text({"time_s": value, "time_std_s": deviation}) == text


def test_every_deviation_stands_beside_its_value():
    for heads in SUMMARIES.values():
        for head in heads:
            stem, _, unit = head.key.rpartition("_")
            assert head.std in (None, f"{stem}_std_{unit}")
