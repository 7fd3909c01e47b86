"""Real measurements of a satellite that passes; skipped without UWTRACK_REAL_DATA."""

import csv
import os
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from uwtrack_cli.data.series import Series
from uwtrack_cli.motion.cpa import find_encounters

FOLDER = os.environ.get("UWTRACK_REAL_DATA")
pytestmark = pytest.mark.skipif(FOLDER is None, reason="UWTRACK_REAL_DATA is not set")


def test_the_satellites_closest_approach_is_that_of_its_orbit():
    """147 s and 1409.6 km from the orbit; deviations cover the curved path."""
    path = Path(FOLDER) / "fox1d" / "fox1d_20180113_161201_doppler.csv"
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    moments = [datetime.fromisoformat(row["timestamp"]) for row in rows]
    unknown = np.full(len(rows), np.nan)
    series = Series(
        contact=np.ones(len(rows)),
        time_s=[(moment - moments[0]).total_seconds() for moment in moments],
        frequency_hz=np.array([[float(row["measured_freq"])] for row in rows]),
        frequency_std_hz=unknown[:, None],
        bearing_deg=unknown, bearing_std_deg=unknown, level_db=unknown,
        level_std_db=unknown,
    )  # fmt: skip
    found = find_encounters(series=series, sound_speed_mps=299792458.0)
    assert found.status.tolist() == ["ok"]
    assert abs(found.time_s[0] - 147.0) < 1.5
    assert abs(found.slant_range_m[0] - 1409.6e3) < 0.02 * 1409.6e3
    assert abs(found.time_s[0] - 147.0) < 3 * found.time_std_s[0]
    assert abs(found.slant_range_m[0] - 1409.6e3) < 3 * found.slant_range_std_m[0]
