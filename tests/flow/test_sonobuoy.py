"""A sonobuoy's audio gives what its omni channel and its dipoles have heard."""

import json
from dataclasses import replace

import numpy as np
import pytest
import soundfile
from scipy.signal import butter, sosfreqz

from tests.draws.buoys import BEARING_DEG, ROUGH, heard, held, line_errors_deg, line_scene, scene
from tests.support import recording_of
from uwtrack_cli.data.recording import HeldSamples, Lock, Recording
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.spectra import Levels, Spectrogram
from uwtrack_cli.files.hdf5.product import read_product
from uwtrack_cli.files.tables.sensors import load_sensor
from uwtrack_cli.flow.concatenate import join_recordings, lock_of
from uwtrack_cli.flow.sample_recordings import write_simulation
from uwtrack_cli.flow.sonobuoy import demultiplex
from uwtrack_cli.simulate import make_scenario
from uwtrack_cli.spectra.levels import measure_levels
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

BUOY = Sensor(id="b1", kind="difar-multiplexed", channels="multiplex")
TOML = 'id = "b1"\nkind = "difar-multiplexed"\ndeclination_deg = 0.0\n'
RATE = 48_000

pytestmark = pytest.mark.filterwarnings("ignore:.*lock on the pilots is lost")


@pytest.fixture(scope="module")
def rough():
    """Two minutes of a vessel, as the sensor hears it and as its radio brings it."""
    radio = {**ROUGH, "fade": [{"start_s": 60.25, "duration_s": 2.5}]}
    return held(scene(1, 120.0)), held(scene(1, 120.0, radio))


def composite(bearing_deg, n_seconds, rate=RATE, tone_hz=310.0, pilots=0.2):
    """Return the audio of a tone, by the equations of the published simulator.

    `simulateDifar.m` of bsmUtils, with the emitter on the reference axis, which is at
    an angle from magnetic north ("magneticDeviation").
    """
    time_s = np.arange(n_seconds * rate) / rate
    phase = 2.0 * np.pi * 7500.0 * time_s
    sound = 0.1 * np.sin(2.0 * np.pi * tone_hz * time_s)
    directed = -sound * np.cos(2.0 * phase + np.radians(bearing_deg))
    return pilots * (np.sin(phase) + np.sin(2.0 * phase + np.pi)) + sound + directed


def azigram_bearing_deg(audio, rate, band_hz):
    """Return the bearing of a band after Thode et al. (2019), as PAMGuard has it.

    `AzigramProcess.java`: sidebands about the second pilot, turned by its phase, and
    the active intensity of their sum and difference.
    """
    spectrum, per_hz = np.fft.rfft(audio), audio.size // rate
    pilot, low, high = (per_hz * f for f in (15_000, *band_hz))
    turned = spectrum * np.exp(-1j * np.angle(spectrum[pilot]))
    upper = turned[pilot + low : pilot + high]
    lower = turned[pilot - high + 1 : pilot - low + 1][::-1]
    first = (upper + lower).real + 1j * (upper - lower).imag
    second = (upper + lower).imag - 1j * (upper - lower).real
    omni = spectrum[low:high].conj()
    east, north = -np.sum((omni * first).real), np.sum((omni * second).real)
    return np.degrees(np.arctan2(east, north)) % 360.0


def in_memory(audio, rate=RATE):
    samples = np.asarray(audio, np.float32)[:, None]
    return replace(recording_of(audio, float(rate), BUOY), reader=HeldSamples(samples))


def bearings_deg(recording):
    blocks = measure_levels(compute_spectrogram(recording, window_s=1.0))
    return Levels.join(list(blocks)).bearing_deg


def test_bearings_come_through_radio_clock_wow_and_jitter(rough):
    direct, audio = rough
    before = bearings_deg(direct) - BEARING_DEG
    after = bearings_deg(heard(audio)[0]) - BEARING_DEG
    there = np.isfinite(before) & np.isfinite(after)
    assert there.mean() > 0.95
    assert abs(after[there].mean() - before[there].mean()) < 0.1
    assert after[there].std() < 1.05 * before[there].std()


@pytest.mark.slow
@pytest.mark.parametrize("bearing_deg", [20.0, 250.0])
def test_bearings_of_lines_come_through_the_radio(bearing_deg):
    direct = held(line_scene(1, 120.0, bearing_deg))
    audio = held(line_scene(1, 120.0, bearing_deg, {"radio_snr_db": 20.0}))
    before = line_errors_deg(direct, bearing_deg)
    after = line_errors_deg(heard(audio)[0], bearing_deg)
    assert abs(after.mean() - before.mean()) < 0.1
    assert after.std() < 1.05 * before.std()


def test_gains_are_those_of_the_sensor(rough):
    direct, audio = rough
    found, true = (r.reader.samples for r in (heard(audio)[0], direct))
    spectra = [
        np.fft.rfft(part.reshape(-1, 6000, 3)[5:50] * np.hanning(6000)[:, None], axis=1)
        for part in (found, true)
    ]
    low, high = np.abs(spectra[0]) ** 2, np.abs(spectra[1]) ** 2
    for band in (slice(20, 200), slice(200, 1000), slice(1000, 2000)):
        ratio = np.sqrt(low[:, band].sum(axis=(0, 1)) / high[:, band].sum(axis=(0, 1)))
        # the band filters of the buoy are common to all three
        np.testing.assert_allclose(ratio[1:] / ratio[0], 1.0, atol=0.02)
    assert ratio[0] == pytest.approx(1.0, abs=0.02)


def test_roll_offs_that_are_told_are_taken_off():
    edge_hz = np.geomspace(4.0, 2500.0, 80)
    gain = np.ones(edge_hz.size)
    for order, edge, kind in ((1, 1000, "high"), (4, 5, "high"), (4, 2400, "low")):
        sections = butter(order, edge, kind, fs=6000, output="sos")
        gain *= np.abs(sosfreqz(sections, edge_hz, fs=6000)[1])
    table = scene(2, 40.0, {})
    told = ",".join(f"{f}:{20 * np.log10(g)}" for f, g in zip(edge_hz, gain, strict=True))
    found, _ = heard(held(table), response=told)
    bare = scene(2, 40.0)
    del bare["sensor"][0]["recorder"]
    spectra = [
        np.abs(np.fft.rfft(r.reader.samples.reshape(-1, 6000, 3)[1:-1], axis=1)) ** 2
        for r in (found, held(bare))
    ]
    for low, high in ((10, 20), (20, 60), (60, 400), (400, 1500), (1500, 2300)):
        power = [s[:, low:high].sum(axis=(0, 1)) for s in spectra]
        assert 10 * np.log10(power[0] / power[1]) == pytest.approx(0.0, abs=0.2)


@pytest.mark.parametrize(
    ("told", "bearing_deg"),
    [
        (None, 60.0),
        ("east,north", 300.0),
        ("-east,-north", 120.0),
        ("north,east", 150.0),
        ("-north,east", 30.0),
    ],
)
def test_signs_are_those_of_the_compass_in_the_published_simulator_unless_told(told, bearing_deg):
    found, _ = heard(in_memory(composite(60.0, 4)), multiplex=told)
    omni, east, north = found.reader.samples[6000:18000].T.astype(float)
    assert np.abs(omni).max() == pytest.approx(0.1, rel=1e-3)
    east, north = (omni @ part / (omni @ omni) for part in (east, north))
    assert np.degrees(np.arctan2(east, north)) % 360 == pytest.approx(bearing_deg, abs=0.01)
    assert np.hypot(east, north) == pytest.approx(1.0, abs=1e-3)


def test_signs_are_those_of_the_published_demultiplexer():
    for bearing_deg in (20.0, 110.0, 245.0):
        found = azigram_bearing_deg(composite(bearing_deg, 4), RATE, (200, 400))
        assert found == pytest.approx(bearing_deg, abs=1e-6)
    recording = held(scene(3, 12.0, {}))
    samples = recording.reader.samples[:, 0].astype(float)
    own = azigram_bearing_deg(samples, RATE, (100, 2000))
    assert own == pytest.approx(bearings_deg(heard(recording)[0]).mean(), abs=0.5)


@pytest.mark.parametrize("rate", [44_100, 48_000, 50_001, 96_000])
def test_blocks_parts_and_segments_are_the_same_to_the_bit(rate):
    noise = 0.02 * np.random.default_rng(3).standard_normal(int(5.3 * rate))
    audio = composite(200.0, 6, rate)[: noise.size] + noise
    opened = demultiplex(in_memory(audio, rate))
    whole = np.concatenate(list(opened.reader(1 << 20)))
    assert whole.shape == (noise.size * 6000 // rate, 3) == (opened.n_samples, opened.n_channels)
    assert np.isfinite(whole).all()
    for block in (1, 777, 6000, 6001) if rate == 44_100 else (5000,):
        parts = list(opened.reader(block))
        assert {len(part) for part in parts[:-1]} == {block}
        np.testing.assert_array_equal(np.concatenate(parts), whole)
    part = opened.part(8000, 21_000)
    np.testing.assert_array_equal(np.concatenate(list(part.reader(4096))), whole[8000:21_000])
    np.testing.assert_array_equal(part.reader.segment(1000, 9000), whole[9000:18_000])


def test_lock_holds_at_12_db_and_is_back_within_a_second():
    fades = [{"start_s": 10.0, "duration_s": 0.05}, {"start_s": 20.33, "duration_s": 4.0}]
    radio = {"radio_snr_db": 12.0, "phase_jitter_rad": 0.1, "fade": fades}
    with pytest.warns(match=r"from 10.0 to 10.1 s, 20.3 to 24.3 s; these 4.1 s"):
        found, reader = heard(held(scene(4, 40.0, radio)))
    lost = np.isnan(found.reader.samples[:, 0])
    assert not lost[: int(9.8 * 6000)].any()
    assert lost[int(20.33 * 6000) : int(24.33 * 6000)].all()
    assert not lost[int(25.0 * 6000) :].any()
    lock = reader.lock("b1")
    assert lock.locked_share.sum() == pytest.approx(40.0 - 0.1 - 4.0, abs=0.1)
    told = lock.locked_share == 1.0
    # 12 dB over 20 kHz is so much in 200 Hz at 7.5 kHz, where density goes as f^2
    expected_db = 12.0 - 3.0 + 10 * np.log10(20_000**3 / 3 / 7500**2 / 200.0)
    assert lock.pilot_snr_db[told] == pytest.approx(expected_db, abs=1.0)
    assert lock.phase_pilot_db[told] == pytest.approx(0.0, abs=0.2)


def test_the_clock_is_told():
    radio = {"radio_snr_db": 20.0, "clock_error_ppm": -80.0}
    clock = heard(held(scene(5, 20.0, radio)))[1].lock("b1").clock_error_ppm
    assert clock.mean() == pytest.approx(-80.0, abs=2.0)


@pytest.mark.slow
def test_a_clock_error_that_is_told_is_taken_off(uwtrack, tmp_path):
    time_s = np.arange(22 * RATE) / RATE * (1.0 + 1e-3)
    phase = 2.0 * np.pi * 7500.0 * time_s
    tone = 0.1 * np.sin(2.0 * np.pi * 2000.0 * time_s)
    pilots = 0.2 * (np.sin(phase) + np.sin(2.0 * phase + np.pi))
    noise = 1e-3 * np.random.default_rng(1).standard_normal(time_s.size)
    soundfile.write("tape.wav", pilots + tone + noise, RATE, "FLOAT")
    (tmp_path / "tape.sensor.toml").write_text(TOML)
    words = ("--start-s", "1.5", "--start-utc", "2024-05-02T06:30:00Z")
    done = uwtrack("spectrogram", "tape.wav", *words, "-o", "a.h5")
    assert "its pilots are 1000e-6 off" in done.stderr
    (tmp_path / "tape.sensor.toml").write_text(TOML + "clock_error_ppm = 1000.0\n")
    done = uwtrack("spectrogram", "tape.wav", *words, "-o", "b.h5")
    assert "pilots" not in done.stderr
    assert uwtrack("difar", "tape.wav", "-o", "three.wav").exit_code == 0
    assert uwtrack("spectrogram", "three.wav", *words, "-o", "c.h5").exit_code == 0
    for name, factor in (("a", 1.001), ("b", 1.0), ("c", 1.0)):
        with read_product(tmp_path / f"{name}.h5") as product:
            found, recording = product.read(Spectrogram), product.read(Recording)
        loudest = np.argmax(found.power_density.mean(axis=0)) * found.frames.bin_hz
        assert loudest == pytest.approx(2000.0 * factor, abs=0.6)
        assert recording.sample_rate_hz == pytest.approx(6000.0 * factor / 1.001)
        assert recording.duration_s == pytest.approx(22.022 / factor - 1.5, abs=1e-3)
        start_ns = recording.start_utc_ns % (60 * 10**9)
        assert start_ns == pytest.approx(1.5e9, abs=1e5)
    assert uwtrack("rerun", "b.h5", "-o", "again.h5").exit_code == 0
    assert uwtrack("diff", "b.h5", "again.h5").exit_code == 0
    for name in ("tape", "three"):  # and live
        sound = (tmp_path / f"{name}.wav").read_bytes()
        told = (*words, "--sensor", f"{name}.sensor.toml")
        assert uwtrack("run", f"{name}.wav", *told, "-o", f"{name}.h5").exit_code == 0
        assert uwtrack("run", "-", *told, "-o", f"{name}-2.h5", input=sound).exit_code == 0
        assert uwtrack("diff", f"{name}.h5", f"{name}-2.h5").exit_code == 0


def test_lost_samples_are_a_gap():
    audio = composite(60.0, 6)
    audio[3 * RATE : 3 * RATE + 100] = np.nan
    with pytest.warns(match="from 3.0 to 3.0 s; these 0.1 s"):
        found, _ = heard(in_memory(audio))
    omni = found.reader.samples[:, 0]
    assert np.isnan(omni[18_000:18_120]).all()
    assert np.isfinite(omni[:17_800]).all()


@pytest.fixture
def folder(tmp_path):
    """Twenty seconds of a buoy in a file, with a fade and its sensor file."""
    radio = {"radio_snr_db": 20.0, "fade": [{"start_s": 8.0, "duration_s": 2.0}]}
    write_simulation(
        make_scenario(scene(7, 20.0, radio, full_scale_db=130.0)), tmp_path / "buoy.wav"
    )
    return tmp_path


def test_the_command_writes_what_a_run_reads(uwtrack, folder):
    done = uwtrack("difar", "buoy.wav", "-o", "three.wav")
    assert done.exit_code == 0
    assert "lock on the pilots is lost from 8.0 to 10.0 s" in done.stderr
    assert uwtrack("spectrogram", "buoy.wav", "-o", "a.h5").exit_code == 0
    assert uwtrack("spectrogram", "three.wav", "-o", "b.h5").exit_code == 0
    with read_product(folder / "a.h5") as audio, read_product(folder / "b.h5") as three:
        one, other = (product.read(Spectrogram) for product in (audio, three))
        lock = audio.read(Lock)
        assert audio.read(Sensor).kind == "difar-multiplexed"
    for name in ("power_density", "intensity_east", "intensity_north"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    valid = one.frames.valid_fraction
    assert ((valid == 1.0).sum(), (valid == 0.0).sum()) == (32, 3)
    table = (folder / "three.lock.csv").read_text().splitlines()
    assert table[0].split(",") == list(Lock.columns())
    assert len(table) == 1 + lock.time_s.size == 21
    facts = (folder / "three.sensor.toml").read_text()
    assert 'kind = "difar"\nchannels = ["omni", "east", "north"]\n' in facts


def test_a_pipe_gives_the_same_as_the_file(uwtrack, folder):
    sound = (folder / "buoy.wav").read_bytes()
    assert uwtrack("difar", "buoy.wav").exit_code == 0
    words = ("--sensor", "buoy.sensor.toml")
    live = uwtrack("difar", "-", "-o", "live.wav", *words, input=sound)
    assert live.exit_code == 0
    assert "lock on the pilots is lost for 2.04 s at 7.98 s" in live.stderr
    assert (folder / "live.wav").read_bytes() == (folder / "buoy.difar.wav").read_bytes()
    assert (
        uwtrack("difar", "buoy.wav", "--follow", "--idle-s", "0.2", "-o", "grown.wav").exit_code
        == 0
    )
    assert (folder / "grown.wav").read_bytes() == (folder / "live.wav").read_bytes()


def test_a_live_run_tells_lost_lock_and_gives_the_products_of_the_file(uwtrack, folder):
    sound = (folder / "buoy.wav").read_bytes()
    words = ("--sensor", "buoy.sensor.toml", "-o", "live.h5")
    live = uwtrack("run", "-", *words, "--json", input=sound)
    gaps = [e for e in map(json.loads, live.stdout.splitlines()) if e["event"] == "gap"]
    assert [(e["time_s"], e["duration_s"], e["reason"]) for e in gaps] == [
        (7.98, 2.04, "lock on the pilots is lost")
    ]
    assert uwtrack("run", "buoy.wav", "-o", "file.h5").exit_code == 0
    assert uwtrack("diff", "live.h5", "file.h5").exit_code == 0


@pytest.mark.usefixtures("folder")
def test_a_part_is_made_again_to_the_bit(uwtrack):
    words = ("--start-s", "3.21", "--stop-s", "15.8", "-o", "a.h5")
    assert uwtrack("spectrogram", "buoy.wav", *words).exit_code == 0
    assert uwtrack("rerun", "a.h5", "-o", "b.h5").exit_code == 0
    done = uwtrack("diff", "a.h5", "b.h5")
    assert done.exit_code == 0, done.stdout


def test_a_file_without_pilots_is_a_gap_among_others():
    with_pilots = in_memory(composite(60.0, 4))
    without = in_memory(0.1 * np.random.default_rng(1).standard_normal(3 * RATE))
    opened = [
        replace(demultiplex(one), start_utc_ns=second * 10**9)
        for one, second in ((with_pilots, 0), (without, 4))
    ]
    joined, _ = join_recordings(opened)
    with pytest.warns(match="no pilots .* The file is a gap"):
        samples = np.concatenate(list(joined.reader(6000)))
    assert np.isfinite(samples[:24_000]).all()
    assert lock_of(joined)[0].locked_share == pytest.approx([1, 1, 1, 1, 0, 0, 0])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("dipoles", "offset_deg"),
    [(["north", "-east"], 7.0), (["north", "east"], 0.0), (["east", "north"], -5.0)],
)
def test_a_calibration_tells_the_signs(uwtrack, tmp_path, dipoles, offset_deg):
    radio = {"radio_snr_db": 20.0, "dipoles": dipoles}
    table = scene(6, 120.0, radio, full_scale_db=145.0)
    passage = {"time_s": 60.0, "horizontal_range_m": 80.0, "speed_mps": 5.0,
               "course_deg": 20.0, "side": "port"}  # fmt: skip
    sound = {"band_hz": [100.0, 2000.0], "snr_db": 15.0}
    table["vessel"] = [{"name": "launch", "closest_approach": passage, "broadband": sound}]
    table["sensor"][0]["compass_error_deg"] = offset_deg
    write_simulation(make_scenario(table), tmp_path / "buoy.wav")
    facts = (tmp_path / "buoy.sensor.toml").read_text()
    assert f"multiplex = {json.dumps(dipoles)}" in facts
    (tmp_path / "buoy.sensor.toml").write_text(
        facts.replace(json.dumps(dipoles), '["-east", "north"]')
    )
    done = uwtrack("calibrate", "buoy.wav", "--truth", "buoy.truth.json", "--json")
    assert done.exit_code == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["multiplex"].split(",") == dipoles
    assert found["compass_offset_deg"] == pytest.approx(-offset_deg, abs=1.0)
    made = load_sensor(tmp_path / "buoy.calibrated.sensor.toml")
    assert (made.kind, made.multiplex) == ("difar-multiplexed", ",".join(dipoles))


def test_what_cannot_be_demultiplexed_is_told_in_one_sentence(uwtrack, tmp_path):
    noise = 0.1 * np.random.default_rng(2).standard_normal(2 * RATE)
    soundfile.write("noise.wav", noise, RATE)
    soundfile.write("slow.wav", noise, 32_000)
    one = composite(60.0, 2) + 0.2 * np.sin(4.0 * np.pi * 7500.0 * np.arange(2 * RATE) / RATE)
    soundfile.write("narrow.wav", one + 1e-3 * noise, RATE)
    soundfile.write("stereo.wav", np.stack([noise, noise], axis=1), RATE)
    for name, words in (
        ("noise", "noise.wav has no pilots of a DIFAR buoy at 7.5 and 15 kHz"),
        ("narrow", "narrow.wav has a tone at 7.5 kHz, but no pilot of a DIFAR buoy at"),
        ("slow", "slow.wav has 32000 samples per second; the multiplex"),
        ("stereo", "stereo.wav has 2 channels, but sensor 'b1' names 1 (multiplex)"),
    ):
        (tmp_path / f"{name}.sensor.toml").write_text(TOML)
        for command in ("difar", "spectrogram"):
            done = uwtrack(command, f"{name}.wav", "-o", "never.wav")
            assert done.exit_code == 1
            assert done.stderr.count("\n") == 1
            assert done.stderr.startswith(f"error: {words}"), done.stderr
    assert not list(tmp_path.glob("never*"))
    done = uwtrack("difar", "noise.wav", "-o", ".")
    assert done.stderr.startswith("error: cannot write .: it is a folder")


def test_information_tells_what_is_in_the_file_and_what_is_read(uwtrack, tmp_path):
    soundfile.write("buoy.wav", composite(60.0, 2), RATE)
    (tmp_path / "buoy.sensor.toml").write_text(TOML)
    found = uwtrack("info", "buoy.wav").stdout
    assert "2 s at 48000 Hz, 1 channel; read: omni, east, north at 6000 Hz\n" in found


def test_another_channel_may_hold_the_buoy(uwtrack, tmp_path):
    audio = composite(60.0, 3)
    soundfile.write("two.wav", np.stack([0.0 * audio, audio], axis=1), RATE, "FLOAT")
    (tmp_path / "two.sensor.toml").write_text(TOML + 'channels = ["-", "multiplex"]\n')
    assert uwtrack("difar", "two.wav", "-o", "a.wav").exit_code == 0
    (tmp_path / "two.sensor.toml").write_text(TOML)
    assert uwtrack("difar", "two.wav", "-o", "b.wav", "--channel", "2").exit_code == 0
    assert (tmp_path / "a.wav").read_bytes() == (tmp_path / "b.wav").read_bytes()


@pytest.mark.parametrize("n_samples", [1, 7, 8, 300, 4800])
def test_very_short_audio(uwtrack, n_samples):
    soundfile.write("short.wav", composite(60.0, 1)[:n_samples], RATE, "FLOAT")
    done = uwtrack("difar", "short.wav")
    assert done.exit_code == int(n_samples < 300)
    assert done.stderr.count("error") == done.exit_code


def test_without_a_declination_north_is_said_to_be_magnetic(uwtrack):
    soundfile.write("bare.wav", composite(60.0, 2), RATE, "FLOAT")
    done = uwtrack("difar", "bare.wav")
    assert "from the north of its compass: give declination_deg" in done.stderr
    done = uwtrack("difar", "bare.wav", "--declination-deg", "3.5", "--overwrite")
    assert "compass" not in done.stderr
    assert load_sensor("bare.difar.sensor.toml").compass_offset_deg == 3.5


def test_the_declination_is_that_of_the_place(uwtrack, tmp_path):
    soundfile.write("polar.wav", composite(60.0, 2), RATE, "FLOAT")
    place = 'declination_deg = "place"\nlatitude = 80.0\nlongitude = 0.0\n'
    (tmp_path / "polar.sensor.toml").write_text(
        TOML.replace("declination_deg = 0.0\n", place) + "compass_offset_deg = 10.0\n"
    )
    done = uwtrack("difar", "polar.wav")
    assert done.exit_code == 1
    assert "there is no start of its recording" in done.stderr
    start = ("--start-utc", "2020-01-01T00:00:00Z")
    done = uwtrack("-v", "difar", "polar.wav", *start)
    assert "declination of -1.28 degrees, of the World Magnetic Model" in done.stderr
    found = load_sensor("polar.difar.sensor.toml")
    # test values of WMM2020 (NOAA NCEI): 2020.0, sea level, 80 N 0 E: -1.28 degrees
    assert found.compass_offset_deg == pytest.approx(10.0 - 1.28, abs=0.005)
