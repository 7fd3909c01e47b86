"""Tables of scans, contacts and operating curves: round trips and refusals."""

import numpy as np
import pytest

from uwtrack_cli.errors import DataError
from uwtrack_cli.files.tables.scan_tables import read_contacts, read_roc, read_scans

SCANS = """scan,time_s,z_1 [m],z_2_m,amplitude,std_1,std_2
1,0.5,10.0,-3.5,2.25,2.0,3.0
1,0.5,11.0,-4.5,,2.0,3.0

2,1.5,,,,,
3,2.5,12.0,-5.5,1.75,2.0,3.0
"""
CONTACTS = """contact,time_s,range_m,bearing_deg,range_rate_mps,range_std_m
2,1,1010,10.5,-3,5
1,0,1000,10.0,-3,5
"""


def _table(folder, text, name="table.csv"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_scans_keep_every_number_unit_and_the_empty_scan(tmp_path):
    scans = read_scans(_table(tmp_path, SCANS))
    assert scans.scan.tolist() == [1, 1, 2, 3]
    assert scans.time_s.tolist() == [0.5, 0.5, 1.5, 2.5]
    assert scans.component.tolist() == ["z_1", "z_2"]
    assert scans.component_unit.tolist() == ["m", "m"]
    np.testing.assert_array_equal(
        scans.measured, [[10.0, -3.5], [11.0, -4.5], [np.nan] * 2, [12.0, -5.5]]
    )
    np.testing.assert_array_equal(scans.amplitude, [2.25, np.nan, np.nan, 1.75])
    assert scans.measured_std[0].tolist() == [2.0, 3.0]
    assert scans.start_utc_ns is None


def test_contacts_are_ordered_by_time_and_missing_deviations_are_nan(tmp_path):
    contacts = read_contacts(_table(tmp_path, CONTACTS))
    assert contacts.contact.tolist() == [1, 2]
    assert contacts.range_m.tolist() == [1000.0, 1010.0]
    assert contacts.range_std_m.tolist() == [5.0, 5.0]
    assert np.isnan(contacts.bearing_std_deg).all()


def test_utc_times_count_from_the_first_row(tmp_path):
    text = "scan,time_utc,z_1\n1,2024-05-01T12:00:00Z,1\n2,2024-05-01T14:00:01.5+02:00,2\n"
    scans = read_scans(_table(tmp_path, text))
    assert scans.time_s.tolist() == [0.0, 1.5]
    assert scans.start_utc_ns == 1_714_564_800_000_000_000


def test_a_curve_is_ordered_by_false_alarm_probability(tmp_path):
    text = "false_alarm_probability,detection_probability\n0.1,0.8\n0.01,0.5\n"
    roc = read_roc(_table(tmp_path, text))
    assert roc.false_alarm_probability.tolist() == [0.01, 0.1]
    assert roc.detection_probability.tolist() == [0.5, 0.8]
    assert np.isnan(roc.threshold).all()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("scan,time_s,z_1\n", "no rows"),
        ("scan,time_s\n1,0\n", "the components must be z_1"),
        ("scan,time_s,z_2\n1,0,1\n", "the components must be z_1"),
        ("scan,z_1\n1,0\n", "lacks the column time_s or time_utc"),
        ("time_s,z_1\n1,0\n", "lacks the column scan"),
        ("scan,scan,time_s,z_1\n1,1,0,0\n", "named twice"),
        ("scan,time_s,z_1\n1,0,1\n\n2,1\n", "line 4: 2 cells, 3 columns"),
        ("scan,time_s,z_1\n1,0,1\n2,1,far\n", "line 3: z_1 must be a number, got 'far'"),
        ("scan,time_s,z_1\n1,0,inf\n", "line 2: z_1 must be a finite number"),
        ("scan,time_s,z_1\n1.5,0,1\n", "line 2: scan must be a whole number, got 1.5"),
        ("scan,time_s,z_1\n1,,1\n", "line 2: time_s must be a number"),
        ("scan,time_utc,z_1\n1,noon,1\n", "line 2: time_utc"),
        ("scan,time_s,z_1,std_1\n1,0,1,-2\n", "line 2: std_1 must be .* from 0"),
        ("scan,time_s,z_1,amplitud\n1,0,1,2\n", "did you mean 'amplitude'"),
    ],
)
def test_a_bad_table_of_scans_is_refused_with_the_line(tmp_path, text, message):
    with pytest.raises(DataError, match=message):
        read_scans(_table(tmp_path, text))


def test_a_bad_table_of_contacts_is_refused_with_the_line(tmp_path):
    with pytest.raises(DataError, match="lacks the column range_rate_mps"):
        read_contacts(_table(tmp_path, "contact,time_s,range_m,bearing_deg\n1,0,1,2\n"))
    with pytest.raises(DataError, match="line 3: range_std_m must be"):
        read_contacts(_table(tmp_path, CONTACTS[:-2] + "-5\n"))


def test_a_missing_or_binary_file_is_refused_by_name(tmp_path):
    with pytest.raises(DataError, match=r"none\.csv"):
        read_scans(tmp_path / "none.csv")
    (tmp_path / "binary.csv").write_bytes(b"\x89HDF\xff\xfe")
    with pytest.raises(DataError, match="no CSV table"):
        read_scans(tmp_path / "binary.csv")
