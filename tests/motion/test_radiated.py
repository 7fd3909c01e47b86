"""Radiated noise levels against the source levels of a simulation, on both sides."""

import numpy as np
import pytest

from tests.flow.made_encounters import encounters_of
from uwtrack_cli.data.decidecades import Decidecades, RadiatedLevels
from uwtrack_cli.errors import DataError
from uwtrack_cli.motion.radiated import estimate_radiated_levels
from uwtrack_cli.simulate.recordings import simulate_recordings
from uwtrack_cli.simulate.scenario import make_scenario
from uwtrack_cli.spectra.decidecades import measure_decidecades
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

BAND_HZ, LEVEL_DB = (30.0, 950.0), 168.0
RANGE_M, SPEED_MPS, TIME_S = 120.0, 6.0, 90.0


CALIBRATED = {"sensitivity_db_re_v_per_upa": -170.0, "gain_db": 0.0, "adc_peak_v": 1.0}


def recorded(seed, calibration=CALIBRATED):
    """Levels of a vessel of known source level that passes a hydrophone."""
    scenario = make_scenario(
        {
            "seed": seed,
            "duration_s": 180.0,
            "sample_rate_hz": 2000.0,
            "sensor": [
                {"id": "h1", "kind": "omni", "depth_m": 20.0} | calibration
            ],
            "vessel": [
                {
                    "name": "ferry",
                    "source_depth_m": 20.0,
                    "closest_approach": {
                        "time_s": TIME_S, "horizontal_range_m": RANGE_M,
                        "speed_mps": SPEED_MPS, "course_deg": 30.0, "side": "port",
                    },
                    "broadband": {"band_hz": list(BAND_HZ), "source_level_db": LEVEL_DB},
                }
            ],
            "noise": {"density_db": 75.0, "slope_db_per_decade": -10.0},
        }
    )  # fmt: skip
    (recording,) = simulate_recordings(scenario)
    blocks = compute_spectrogram(recording)
    return Decidecades.join(list(measure_decidecades(blocks)))


def passage(**values):
    return encounters_of(
        {
            "time_s": TIME_S, "arrival_time_s": TIME_S + RANGE_M / 1500.0,
            "speed_mps": SPEED_MPS, "slant_range_m": RANGE_M, "slant_range_std_m": 2.0,
            "range_over_speed_s": RANGE_M / SPEED_MPS,
        }
        | values
    )  # fmt: skip


def reasons(made):
    return {text for row in range(made.contact.size) for text in made.reasons(row).values()}


@pytest.mark.slow
def test_levels_are_those_of_the_source_within_their_deviations():
    deviations, size = [], []
    for seed in range(12):
        made = estimate_radiated_levels([recorded(seed)], [passage()])
        width = made.centre_hz * (10**0.05 - 10**-0.05)
        expected = LEVEL_DB + 10.0 * np.log10(width / (BAND_HZ[1] - BAND_HZ[0]))
        inside = (made.centre_hz > 40.0) & (made.centre_hz < 700.0)
        error = (made.radiated_noise_level_db - expected)[inside]
        assert np.isfinite(error).all()
        deviations.append(error / made.radiated_noise_level_std_db[inside])
        size.append(np.abs(error))
    share = np.mean(np.abs(np.concatenate(deviations)) < 1.96)
    assert 0.90 < share < 0.995
    assert np.median(np.concatenate(size)) < 0.5
    assert np.abs(np.mean(np.concatenate(deviations))) < 0.35


def test_bands_without_the_vessel_have_no_level():
    made = estimate_radiated_levels([recorded(1)], [passage()])
    below = made.centre_hz < 24.0
    assert below.any()
    assert np.isnan(made.radiated_noise_level_db[below]).all()
    assert reasons(made) == {"less than 3 dB over the background"}


def test_the_deviation_holds_that_of_the_range():
    levels = recorded(2)
    near, wide = (
        estimate_radiated_levels([levels], [passage(slant_range_std_m=std)]) for std in (0.0, 12.0)
    )
    added = np.sqrt(wide.radiated_noise_level_std_db**2 - near.radiated_noise_level_std_db**2)
    known = np.isfinite(added)
    assert known.sum() > 10
    np.testing.assert_allclose(added[known], 20.0 / np.log(10.0) * 0.1, rtol=1e-6)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"arrival_time_s": 3.0}, "not whole in the recording"),
        ({"range_over_speed_s": 1.0}, "less than 3 rows"),
        ({"range_over_speed_s": 60.0}, "no sound without a vessel"),
        ({"slant_range_m": np.nan}, "the range is not known"),
    ],
)
def test_what_cannot_be_told_has_its_reason(values, words):
    (text,) = reasons(estimate_radiated_levels([recorded(3)], [passage(**values)]))
    assert words in text


def test_another_vessel_at_the_same_time_spoils_the_level():
    both = encounters_of(
        *(
            {
                "time_s": t, "arrival_time_s": t, "slant_range_m": RANGE_M,
                "slant_range_std_m": 2.0, "range_over_speed_s": 20.0,
            }
            for t in (TIME_S, TIME_S + 30.0)
        )
    )  # fmt: skip
    made = estimate_radiated_levels([recorded(4)], [both])
    assert reasons(made) == {f"contact {k} passes at the same time" for k in (1, 2)}


def test_the_background_is_heard_far_from_every_vessel():
    """A vessel of a hundred times the power passes four minutes later, heard near alone."""
    time_s = np.arange(0.0, 700.0)
    received = np.full(time_s.size, 1e6)
    for at_s, source, reach_s in ((200.0, 1e13, 700.0), (440.0, 1e15, 60.0)):
        square_m2 = RANGE_M**2 + (SPEED_MPS * (time_s - at_s)) ** 2
        received += np.where(np.abs(time_s - at_s) < reach_s, source / square_m2, 0.0)
    levels = Decidecades(
        time_s=time_s, centre_hz=np.array([100.0]), average_s=1.0, sensor="h1",
        level_db=10 * np.log10(received)[:, None], reference="1 uPa", start_utc_ns=None,
    )  # fmt: skip
    both = encounters_of(
        *(
            {
                "time_s": t, "arrival_time_s": t, "slant_range_m": RANGE_M,
                "slant_range_std_m": 2.0, "range_over_speed_s": RANGE_M / SPEED_MPS,
            }
            for t in (200.0, 440.0)
        )
    )  # fmt: skip
    made = estimate_radiated_levels([levels], [both])
    assert made.background_level_db[0] == pytest.approx(60.0, abs=0.1)
    assert made.radiated_noise_level_db == pytest.approx([130.0, 150.0], abs=0.1)


def test_an_uncalibrated_recording_has_none():
    levels = recorded(5, {"full_scale_db": 170.0, "is_calibrated": False})
    made = estimate_radiated_levels([levels], [passage()])
    assert made.contact.size == 0
    assert isinstance(made, RadiatedLevels)


def test_levels_of_another_sensor_are_refused():
    with pytest.raises(DataError, match="of sensor 'h2'"):
        estimate_radiated_levels([recorded(6)], [passage(sensor="h2")])


def test_refused_passages_have_none():
    refused = passage(status="not-a-passage")
    assert estimate_radiated_levels([recorded(7)], [refused]).contact.size == 0
