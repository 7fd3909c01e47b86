"""A summary never shows a deviation as zero, and a dash for what is not known."""

import pytest

from uwtrack_cli.files.tables.summaries import SPARE, SUMMARIES, Head, summary_of, utc_text

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


ROW = {"contact": 1, "sensor": "h1", "status": "ok", "time_s": 148.05,
       "time_std_s": 0.04, "time_utc": "2024-05-01T12:02:28.0496Z",
       "speed_mps": 6.0, "speed_std_mps": 0.01, "course_deg": None}  # fmt: skip


def test_what_is_nowhere_known_has_no_column():
    titles = summary_of("encounters", [ROW]).titles
    assert "course deg" not in titles
    assert "course deg" in summary_of("encounters", [ROW, ROW | {"course_deg": 8.0}]).titles


def test_a_motion_model_is_shown_where_one_is_not_straight():
    straight, turned = (ROW | {"motion_model": m} for m in ("straight", "manoeuvre"))
    assert "motion model" not in summary_of("encounters", [straight, straight]).titles
    table = _table([straight, turned])
    place = table[0].index("motion model")
    assert [row[place] for row in table[1:]] == ["straight", "manoeuvre"]


def test_times_are_utc_where_all_of_them_are_known():
    column = {title: cells[0] for title, *cells in zip(*_table([ROW]), strict=True)}
    assert column["UTC 2024-05-01"] == "12:02:28.05 ± 0.04"
    later = ROW | {"time_utc": "2024-05-02T00:00:01Z", "time_std_s": 2.0}
    column = dict(zip(*_table([ROW, later])[::2], strict=True))
    assert column["time UTC"] == "2024-05-02 00:00:01.0 ± 2.0"
    unknown = _table([ROW, ROW | {"time_utc": None}])
    assert "time s" in unknown[0]


def _table(rows):
    summary = summary_of("encounters", rows)
    return [summary.titles, *summary.rows]


def test_a_segment_within_one_day_names_it_once():
    row = {"kind": "rates", "from_s": 4.0, "from_utc": "2024-05-01T12:00:04Z",
           "to_s": 114.0, "to_utc": "2024-05-01T12:01:54Z",
           "rates_hz": [2.4, 7.2, 9.6, 12.0], "n_lines": 0}  # fmt: skip
    one = summary_of("presence", [row])
    assert one.titles == ("kind", "UTC 2024-05-01", "to UTC", "rates Hz")
    assert one.rows[0] == ("rates", "12:00:04", "12:01:54", "2.4 7.2 9.6 ...")
    late = summary_of("presence", [row | {"to_utc": "2024-05-02T00:01:54Z"}])
    assert late.titles[1:3] == ("from UTC", "to UTC")
    assert late.rows[0][2] == "2024-05-02 00:01:54"


def test_the_day_of_a_rounded_time_is_that_of_what_is_shown():
    assert utc_text("2024-12-31T23:59:59.5Z") == "2025-01-01 00:00:00"
    assert utc_text("2024-05-01T12:00:00.123456Z", 3) == "2024-05-01 12:00:00.123"


def test_a_place_keeps_both_its_coordinates_on_the_grid_or_on_the_globe():
    grid = {"contact": 1, "time_s": 5.0, "east_m": -94.2, "north_m": 60.0,
            "east_std_m": 12.0, "north_std_m": 7.0, "mode": 1,
            "latitude": None, "longitude": None, "speed_mps": 9.9}  # fmt: skip
    table = summary_of("fixes", [grid])
    assert set(table.spare) == {"mode", "speed m/s"}
    assert "± east m" not in table.titles
    globe = summary_of("fixes", [grid | {"latitude": 35.0, "longitude": 128.0}])
    assert set(globe.spare) == {"east m", "north m", "mode", "speed m/s"}
    assert globe.rows[0][globe.titles.index("± north m")] == "7"
    other = grid | {"mode": 2}  # two rows of one contact differ by the mode alone
    assert "mode" not in summary_of("fixes", [grid, other]).spare


def test_the_sensor_is_spared_only_where_there_is_one():
    assert "sensor" in summary_of("encounters", [ROW]).spare
    assert "sensor" not in summary_of("encounters", [ROW, ROW | {"sensor": "h2"}]).spare


@pytest.mark.parametrize("name", SUMMARIES)
def test_what_can_be_spared_is_a_column(name):
    assert set(SPARE[name]) <= {head.title for head in SUMMARIES[name]}


@pytest.mark.parametrize(
    ("low", "high", "text"),
    [(895.2, 1904.0, "895 to 1904"), (895.2, None, "> 895"), (None, 1904.0, "< 1904")],
)
def test_a_motion_shows_the_interval_of_its_range_and_no_open_end(low, high, text):
    row = {"contact": 1, "range_m": None, "range_low_m": low, "range_high_m": high}
    table = summary_of("motions", [row])
    assert table.rows[0][table.titles.index("range 95 % m")] == text
    assert "range 95 % m" not in table.spare
    open_range = row | {"range_low_m": None, "range_high_m": None}
    assert "range 95 % m" not in summary_of("motions", [open_range]).titles
