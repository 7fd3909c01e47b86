"""Pictures of sound meet what only a forged file holds with a sentence."""

import numpy as np
import pytest

from uwtrack_cli.data.spectra import Overview
from uwtrack_cli.errors import DataError
from uwtrack_cli.plotting.spectra import draw_overview


@pytest.mark.parametrize("name", ["time_s", "frequency_hz"])
def test_an_axis_that_holds_no_numbers_is_refused(name):
    axes = {"time_s": np.arange(4.0), "frequency_hz": np.arange(3.0)}
    axes[name][1] = np.nan
    overview = Overview(
        **axes, shade=np.zeros((4, 3), np.uint8), floor_db=0.0, ceiling_db=30.0,
        reference="1 uPa", sensor="h1",
    )  # fmt: skip
    from matplotlib.figure import Figure

    with pytest.raises(DataError, match=f"{name} of the overview holds values"):
        draw_overview(overview, Figure().subplots())
