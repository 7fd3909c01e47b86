"""Tables of delays between the hydrophones of an array, measured elsewhere."""

from pathlib import Path

import numpy as np

from uwtrack_cli.data.directions import Delays
from uwtrack_cli.files.tables.csv_table import read_table, table_times

NAMES = ("channel_a", "channel_b", "delay_s", "delay_std_s")


def read_delays(path: Path) -> Delays:
    """Read a table of delays.

    ``path``: CSV with time_s or time_utc, channel_a, channel_b, delay_s (arrival at the
    second less arrival at the first) and delay_std_s; one row per pair and time.

    Raises
    ------
    DataError
        The table is not readable, or a value is not accepted; the line is named.
    """
    table = read_table(path)
    table.check_known(("time_s", "time_utc", "coherence", *NAMES))
    table.need(*NAMES)
    time_s, start_utc_ns = table_times(table)
    one, other = (np.array(table.cells[name], np.str_) for name in NAMES[:2])
    for row in np.flatnonzero((one == other) | (one == "") | (other == ""))[:1]:
        table.fail(
            int(row),
            f"channel_a and channel_b must be two channels, got {one[row]!r} and "
            f"{other[row]!r}.",
        )
    return Delays(
        time_s=time_s,
        channel_a=one,
        channel_b=other,
        delay_s=table.numbers("delay_s", -1e6, 1e6),
        delay_std_s=table.numbers("delay_std_s", 1e-12, 1e6),
        coherence=table.numbers("coherence", 0.0, 1.0)
        if "coherence" in table
        else None,
        start_utc_ns=start_utc_ns,
    )
