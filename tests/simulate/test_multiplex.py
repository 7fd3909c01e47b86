"""A sonobuoy's simulated audio has the pilots, the noise and the clock that are stated."""

import numpy as np
import pytest
from scipy.signal import welch

from tests.simulate.scenes import DIFAR, scene
from uwtrack_cli.errors import OptionError
from uwtrack_cli.simulate import make_scenario, simulate_recordings

RATE = 48_000
QUIET = {"density_db": 90.0}


def audio(block=1 << 16, **radio):
    """Ten seconds of a buoy in steady noise, in full-scale units."""
    sensor = DIFAR | {"full_scale_db": 150.0, "multiplex": radio}
    table = {"sensor": [sensor], "noise": QUIET, "duration_s": 10.0}
    (recording,) = simulate_recordings(scene(**table, sample_rate_hz=6000.0))
    samples = np.concatenate(list(recording.reader(block)))
    assert samples.shape == (recording.n_samples, recording.n_channels) == (480_000, 1)
    assert recording.sensor.kind == "difar-multiplexed"
    return samples[:, 0]


def test_blocks_do_not_matter():
    radio = {"radio_snr_db": 20.0, "clock_error_ppm": 50.0, "phase_jitter_rad": 0.1}
    np.testing.assert_array_equal(audio(4801, **radio), audio(**radio))


def test_pilots_are_where_clock_and_wow_put_them():
    frequency_hz = np.fft.rfftfreq(480_000, 1 / RATE)
    for radio, error in (({}, 0.0), ({"clock_error_ppm": 100.0}, 1e-4)):
        power = np.abs(np.fft.rfft(audio(**radio) * np.hanning(480_000))) ** 2
        for pilot_hz in (7500.0, 15_000.0):
            near = np.abs(frequency_hz - pilot_hz) < 20.0
            peak_hz = frequency_hz[near][np.argmax(power[near])]
            assert peak_hz == pytest.approx(pilot_hz * (1.0 + error), abs=0.1)
    # a wow of 1 % at 0.1 Hz moves the pilot by 75 Hz to either side
    swept = audio(wow=0.01, wow_hz=0.1)
    for middle_s, expected_hz in ((2.5, 7575.0), (7.5, 7425.0)):
        part = swept[int((middle_s - 0.1) * RATE) : int((middle_s + 0.1) * RATE)]
        spectrum = np.abs(np.fft.rfft(part * np.hanning(part.size)))[1300:1700]
        assert 5.0 * (1300 + np.argmax(spectrum)) == pytest.approx(expected_hz, abs=5.0)


def test_the_radio_makes_the_noise_that_is_stated():
    silent, fade = audio(), {"start_s": 4.0, "duration_s": 2.0, "radio_snr_db": -20.0}
    heard = audio(radio_snr_db=15.0, fade=[fade])
    noise = heard - silent
    out = np.r_[0 : 4 * RATE, 6 * RATE : 10 * RATE]
    pilots = 2 * 0.1**2 / 2
    assert 10 * np.log10(pilots / noise[out].var()) == pytest.approx(15.0, abs=0.2)
    inside = heard[4 * RATE : 6 * RATE]
    assert 10 * np.log10(inside.var() / pilots) == pytest.approx(0.0, abs=0.3)
    frequency_hz, density = welch(noise[: 4 * RATE], RATE, nperseg=4800)
    bands = [density[(frequency_hz > f - 500) & (frequency_hz < f + 500)].mean()
             for f in (5000, 10_000, 20_500)]  # fmt: skip
    assert bands[1] / bands[0] == pytest.approx(4.0, rel=0.1)
    assert bands[2] < 0.05 * bands[1]


@pytest.mark.parametrize(
    ("sensor", "words"),
    [
        ({"kind": "omni"}, 'multiplex goes with kind = "difar"'),
        ({"axes": "housing"}, 'multiplex goes with kind = "difar"'),
        ({"multiplex": {"dipoles": ["east", "-east"]}}, "names east and north once each"),
        ({"multiplex": {"sample_rate_hz": 44_100.5}}, "must be whole"),
        ({"multiplex": {"sample_rate_hz": 32_000.0}}, "at least 36000"),
    ],
)
def test_what_no_buoy_sends_is_refused(sensor, words):
    table = {"seed": 1, "duration_s": 1.0, "sample_rate_hz": 6000.0, "noise": QUIET}
    buoy = DIFAR | {"multiplex": {}} | sensor
    with pytest.raises(OptionError, match=words):
        make_scenario(table | {"sensor": [buoy]})
