"""Recordings: what soundfile wrote reads back; what is wrong is said."""

import hashlib
import pickle
import struct
import warnings

import numpy as np
import pytest
import soundfile

from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError, OptionError, OutputError, UwtrackWarning
from uwtrack_cli.files.audio.header import sample_bytes
from uwtrack_cli.files.audio.recording_file import open_recording, write_wav

RATE = 8000
KINDS = [
    ("a.wav", "WAV", "PCM_16", 2.0**-15),
    ("b.wav", "WAV", "FLOAT", 0.0),
    ("c.wav", "WAVEX", "PCM_24", 2.0**-22),
    ("d.rf64", "RF64", "PCM_16", 2.0**-15),
    ("e.w64", "W64", "PCM_16", 2.0**-15),
    ("f.aiff", "AIFF", "PCM_16", 2.0**-15),
    ("g.flac", "FLAC", "PCM_24", 2.0**-22),
]
EVERY_KIND = pytest.mark.parametrize(
    ("name", "kind", "subtype", "step"), KINDS, ids=[k[1] + k[2] for k in KINDS]
)
OMNI = Sensor(id="h1")
DIFAR = Sensor(id="d1", kind="difar", channels="omni,east,north")


def sound(n_channels=1, n_samples=24_000, seed=1):
    rng = np.random.default_rng(seed)
    values = 0.1 * rng.standard_normal((n_samples, n_channels))
    return values.astype(np.float32)


def samples(recording, block=777):
    return np.concatenate(list(recording.reader(block)))


@EVERY_KIND
def test_sound_written_by_soundfile_reads_back(name, kind, subtype, step, tmp_path):
    path, values = tmp_path / name, sound()
    soundfile.write(path, values, RATE, subtype=subtype, format=kind)
    recording = open_recording(path, sensor=OMNI, start_utc_ns=5)
    assert (recording.n_samples, recording.n_channels) == values.shape
    assert recording.sample_rate_hz == RATE
    assert recording.name == name
    assert recording.start_utc_ns == 5
    assert recording.digest == hashlib.sha256(path.read_bytes()).hexdigest()
    read = samples(recording)
    assert read.dtype == np.float32
    np.testing.assert_allclose(read, values, atol=1.01 * step)


@EVERY_KIND
def test_truncated_file_is_found_and_what_is_there_can_be_taken(
    name, kind, subtype, step, tmp_path
):
    path, values = tmp_path / name, sound()
    soundfile.write(path, values, RATE, subtype=subtype, format=kind)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(DataError, match=r"truncated.*3\.000 s.*--allow-truncated"):
        open_recording(path, sensor=OMNI)
    with pytest.warns(UwtrackWarning, match="truncated"):
        recording = open_recording(path, sensor=OMNI, allow_truncated=True)
    assert 7_600 < recording.n_samples < 12_100
    read = samples(recording)
    assert read.shape == (recording.n_samples, 1)
    np.testing.assert_allclose(read, values[: len(read)], atol=1.01 * step)


@pytest.mark.parametrize("missing", [1, 2, 3])
def test_a_single_missing_byte_is_found(missing, tmp_path):
    path = tmp_path / "a.wav"
    soundfile.write(path, sound(), RATE)
    path.write_bytes(path.read_bytes()[:-missing])
    with pytest.raises(DataError, match="truncated"):
        open_recording(path, sensor=OMNI)


def test_wav_of_unknown_length_from_a_pipe_is_accepted(tmp_path):
    path = tmp_path / "a.wav"
    soundfile.write(path, sound(), RATE)
    content = bytearray(path.read_bytes())
    at = content.index(b"data") + 4
    content[at : at + 4] = struct.pack("<I", 0xFFFFFFFF)
    path.write_bytes(content)
    assert sample_bytes(path) is None
    assert samples(open_recording(path, sensor=OMNI)).shape == (24_000, 1)


@pytest.mark.parametrize("block", [1, 100, 23_999, 24_000, 10**6])
def test_blocks_do_not_change_a_bit(block, tmp_path):
    path = tmp_path / "a.flac"
    soundfile.write(path, sound(n_samples=2_400), RATE)
    recording = open_recording(path, sensor=OMNI)
    whole = samples(recording, 2_400)
    blocks = list(recording.reader(block))
    assert [len(b) for b in blocks[:-1]] == [min(block, 2_400)] * (len(blocks) - 1)
    assert np.concatenate(blocks).tobytes() == whole.tobytes()


def test_span_is_exact_in_samples_and_nanoseconds(tmp_path):
    path, values = tmp_path / "a.wav", sound()
    soundfile.write(path, values, 7_919, subtype="FLOAT")
    recording = open_recording(path, sensor=OMNI, start_utc_ns=10**18, start_s=1.0, stop_s=2.0)
    first = 7_919
    assert recording.n_samples == 7_919
    assert recording.start_utc_ns == 10**18 + 10**9
    np.testing.assert_array_equal(samples(recording), values[first : 2 * first])
    with pytest.warns(UwtrackWarning, match="ends at"):
        longer = open_recording(path, sensor=OMNI, start_s=2.5, stop_s=99.0)
    assert samples(longer).shape[0] == 24_000 - round(2.5 * 7_919)


@pytest.mark.parametrize(
    ("start_s", "stop_s"),
    [(-1.0, None), (3.0, None), (2.0, 1.0), (1.0, 1.0), (float("nan"), None),
     (None, float("nan")), (1.0, 1.00001), (None, -1.0)],
)  # fmt: skip
def test_span_outside_the_recording_is_refused(start_s, stop_s, tmp_path):
    soundfile.write(tmp_path / "a.wav", sound(), RATE)
    with pytest.raises(OptionError, match=r"3\.000 s|no sample"):
        open_recording(tmp_path / "a.wav", sensor=OMNI, start_s=start_s, stop_s=stop_s)


def test_channels_come_in_the_order_omni_east_north(tmp_path):
    path, values = tmp_path / "a.wav", sound(4)
    soundfile.write(path, values, RATE, subtype="FLOAT")
    shuffled = Sensor(id="d", kind="difar", channels="north,-,omni,east")
    recording = open_recording(path, sensor=shuffled)
    assert recording.sensor.channels == "omni,east,north"
    assert recording.n_channels == 3
    np.testing.assert_array_equal(samples(recording), values[:, [2, 3, 0]])


def test_one_channel_of_several_is_taken_by_its_number(tmp_path):
    path, values = tmp_path / "a.wav", sound(3)
    soundfile.write(path, values, RATE, subtype="FLOAT")
    for sensor in (OMNI, Sensor(id="h1", channels="-,omni,-")):
        recording = open_recording(path, sensor=sensor, channel=2)
        np.testing.assert_array_equal(samples(recording), values[:, [1]])
        assert recording.sensor.id == "h1"
    with pytest.warns(UwtrackWarning, match="no sensor file"):
        assert open_recording(path, channel=3).sensor.channel_names == ("omni",)
    for channel in (0, 4, -1):
        with pytest.raises(OptionError, match="channels 1 to 3"):
            open_recording(path, sensor=OMNI, channel=channel)


def test_channels_that_do_not_fit_say_what_to_do(tmp_path):
    path = tmp_path / "a.wav"
    soundfile.write(path, sound(2), RATE)
    with pytest.warns(UwtrackWarning, match="channel 1 of 2 is read"):
        assert open_recording(path).file_channels == "1"
    with pytest.raises(DataError, match="2 channels, but sensor 'd1' names 3"):
        open_recording(path, sensor=DIFAR)
    with pytest.raises(OptionError, match="needs all its channels"):
        open_recording(path, sensor=DIFAR, channel=1)


def test_mono_without_a_sensor_says_what_is_unknown(tmp_path):
    soundfile.write(tmp_path / "a.wav", sound(), RATE)
    with pytest.warns(UwtrackWarning, match="depth and calibration"):
        recording = open_recording(tmp_path / "a.wav")
    assert recording.sensor.full_scale_upa is None
    assert recording.sensor.latitude is None


def test_gaps_silence_and_clipping_are_said_once(tmp_path):
    path, values = tmp_path / "a.wav", sound(3)
    values[100:150, 0] = np.nan
    values[200, 0] = np.inf
    values[:, 1] = 0.0
    values[::100, 2] = 1.0
    soundfile.write(path, values, RATE, subtype="FLOAT")
    recording = open_recording(path, sensor=DIFAR)
    with pytest.warns(UwtrackWarning) as caught:
        read = samples(recording)
    assert np.isnan(read[:, 0]).sum() == 51
    said = [str(w.message) for w in caught]
    assert len(said) == 3
    assert "channel 1 of a.wav has 51 samples" in said[0]
    assert "channel 2 of a.wav is silent" in said[1]
    assert "channel 3 of a.wav is clipped: 1 %" in said[2]
    samples(recording)


@pytest.mark.parametrize("value", [0.0, -0.25])
def test_what_a_recorder_has_lost_is_a_gap_however_it_is_read(value, tmp_path):
    """A second without a change is told with its times; a tenth, or one channel, is not."""
    values = sound(3)
    values[8_000:16_000] = value
    values[2_000:2_800] = value
    values[17_000:23_000, 0] = value
    path = tmp_path / "lost.wav"
    soundfile.write(path, values, RATE, subtype="FLOAT")
    is_lost = np.zeros(24_000, bool)
    is_lost[8_001:16_000] = True  # the first of them is the last that was heard
    for block in (777, 5_000, 24_000):
        recording = open_recording(path, sensor=DIFAR)
        with pytest.warns(UwtrackWarning, match=r"from 1\.0 to 2\.0 s: .* lost 1\.0 s"):
            blocks = list(recording.reader(block))
        assert max(map(len, blocks)) <= block
        found = np.isnan(np.concatenate(blocks)).all(axis=1)
        np.testing.assert_array_equal(found, is_lost)
    for start_s, stop_s in ((0.0, 3.0), (0.9, 1.1), (1.4, 1.6), (1.9, 2.5)):
        found = np.isnan(recording.segment(start_s, stop_s)).all(axis=1)
        span = slice(round(start_s * RATE), round(stop_s * RATE))
        np.testing.assert_array_equal(found, is_lost[span])
    before = open_recording(path, sensor=DIFAR, stop_s=0.9)
    assert not np.isnan(samples(before)).any()


def test_reader_can_be_sent_to_another_process(tmp_path):
    soundfile.write(tmp_path / "a.wav", sound(), RATE)
    recording = open_recording(tmp_path / "a.wav", sensor=OMNI)
    copy = pickle.loads(pickle.dumps(recording))
    np.testing.assert_array_equal(samples(copy), samples(recording))


def no_samples(path):
    soundfile.write(path, np.zeros((0, 1)), RATE)


def riff_alone(path):
    path.write_bytes(b"RIFF\x24\0\0\0WAVEfmt ")


def zero_channels(path):
    soundfile.write(path, sound(), RATE)
    content = bytearray(path.read_bytes())
    content[22:24] = b"\0\0"
    path.write_bytes(content)


def zero_rate(path):
    soundfile.write(path, sound(), RATE)
    content = bytearray(path.read_bytes())
    content[24:28] = b"\0\0\0\0"
    path.write_bytes(content)


def ogg(path):
    soundfile.write(path, sound(), RATE, format="OGG", subtype="VORBIS")


BAD = {
    "missing": (lambda _: None, "does not exist"),
    "folder": (lambda path: path.mkdir(), "is a folder"),
    "empty": (lambda path: path.touch(), "is empty"),
    "text": (lambda path: path.write_text("hello\n" * 99), "no recording"),
    "no samples": (no_samples, "holds no samples"),
    "header alone": (riff_alone, "no recording|no samples"),
    "zero channels": (zero_channels, "no recording|header"),
    "zero rate": (zero_rate, "no recording|header"),
    "lossy": (ogg, "accepted are WAV"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_recording_is_refused_in_one_sentence(case, tmp_path):
    make, reason = BAD[case]
    path = tmp_path / "a.wav"
    make(path)
    with pytest.raises(DataError, match=reason) as caught:
        open_recording(path, sensor=OMNI)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_recording_that_shrinks_while_it_is_read_is_an_error(tmp_path):
    path = tmp_path / "a.wav"
    soundfile.write(path, sound(), RATE)
    recording = open_recording(path, sensor=OMNI)
    path.write_bytes(path.read_bytes()[:20_000])
    with pytest.raises(DataError, match=r"ends at|cannot be read"):
        samples(recording)


@pytest.mark.parametrize("name", ["a.wav", "b.flac", "c.w64", "d.rf64", "e.aiff"])
def test_written_sound_reads_back_within_a_quantisation_step(name, tmp_path):
    values = sound(2, 5_000)
    count = write_wav(tmp_path / name, iter(np.array_split(values, 7)), 4_000.0)
    assert count == 5_000
    read, rate = soundfile.read(tmp_path / name, dtype="float32")
    assert rate == 4_000
    np.testing.assert_allclose(read, values, atol=2.0**-15)


def test_sound_that_cannot_be_written_leaves_no_file(tmp_path):
    def failing():
        yield sound()
        raise KeyboardInterrupt

    def not_a_number():
        yield np.full((3, 1), np.nan, np.float32)

    target = tmp_path / "a.wav"
    with pytest.raises(KeyboardInterrupt):
        write_wav(target, failing(), RATE)
    with pytest.raises(DataError, match="no numbers"):
        write_wav(target, not_a_number(), RATE)
    with pytest.raises(DataError, match="no samples"):
        write_wav(target, iter([]), RATE)
    with pytest.raises(OptionError, match="suffix"):
        write_wav(tmp_path / "a.mp3", iter([sound()]), RATE)
    with pytest.raises(OptionError, match="whole Hz"):
        write_wav(target, iter([sound()]), 1000.5)
    with pytest.raises(OptionError, match="sample format"):
        write_wav(target, iter([sound()]), RATE, "VORBIS")
    assert list(tmp_path.iterdir()) == []
    write_wav(target, iter([sound()]), RATE)
    with pytest.raises(OutputError, match="--overwrite"):
        write_wav(target, iter([sound()]), RATE)
    write_wav(target, iter([sound()]), RATE, overwrite=True)


def test_damaged_headers_never_crash_the_reader(tmp_path):
    rng = np.random.default_rng(4)
    for name, kind, subtype, _ in KINDS:
        path = tmp_path / name
        soundfile.write(path, sound(n_samples=3_000), RATE, subtype=subtype, format=kind)
        content = path.read_bytes()
        for _ in range(25):
            changed = bytearray(content)
            places = rng.integers(0, min(200, len(content)), rng.integers(1, 4))
            changed[rng.integers(0, len(content))] ^= 1
            for place in places:
                changed[place] = rng.integers(0, 256)
            path.write_bytes(changed)
            read_or_refuse(path)


def read_or_refuse(path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UwtrackWarning)
        try:
            recording = open_recording(path, channel=1, allow_truncated=True)
            n_read = sum(len(b) for b in recording.reader(65_536))
        except (DataError, OptionError) as error:
            assert "\n" not in str(error)  # noqa: PT017
            return
    assert n_read == recording.n_samples


def without_flac_length(content):
    """Return a FLAC file as it is streamed: 36 bits of zero in its first block."""
    found = bytearray(content)
    found[21] &= 0xF0
    found[22:26] = bytes(4)
    return bytes(found)


@pytest.mark.parametrize(
    ("n_samples", "n_channels", "subtype"),
    [(20, 1, "PCM_16"), (4096, 1, "PCM_16"), (4097, 2, "PCM_24"), (300_000, 1, "PCM_S8"),
     (700_001, 3, "PCM_24")],
)  # fmt: skip
def test_a_streamed_flac_file_is_read_to_its_end(n_samples, n_channels, subtype, tmp_path):
    values = np.random.default_rng(8).uniform(-0.5, 0.5, (n_samples, n_channels))
    soundfile.write(tmp_path / "a.flac", values, RATE, subtype)
    content = (tmp_path / "a.flac").read_bytes()
    (tmp_path / "b.flac").write_bytes(without_flac_length(content))
    whole, streamed = (
        open_recording(tmp_path / name, sensor=OMNI, channel=1) for name in ("a.flac", "b.flac")
    )
    assert streamed.n_samples == whole.n_samples == n_samples
    np.testing.assert_array_equal(samples(streamed), samples(whole))
    last_s = max(0.0, streamed.duration_s - 0.2)
    np.testing.assert_array_equal(streamed.segment(last_s, 1e6), whole.segment(last_s, 1e6))


@pytest.mark.parametrize("n_lost", [1, 500, 9000])
def test_a_streamed_flac_file_that_was_cut_ends_with_its_last_whole_frame(n_lost, tmp_path):
    values = np.random.default_rng(9).uniform(-0.5, 0.5, 60_000)
    soundfile.write(tmp_path / "a.flac", values, RATE, "PCM_16")
    content = without_flac_length((tmp_path / "a.flac").read_bytes())
    (tmp_path / "b.flac").write_bytes(content[:-n_lost])
    found = samples(open_recording(tmp_path / "b.flac", sensor=OMNI))[:, 0]
    assert 60_000 - 3 * 4096 <= found.size < 60_000
    assert found.size % 4096 == 0
    np.testing.assert_allclose(found, values[: found.size], atol=2.0**-15)


def test_a_flac_file_of_nothing_holds_no_samples(tmp_path):
    soundfile.write(tmp_path / "a.flac", np.zeros(5000), RATE)
    content = without_flac_length((tmp_path / "a.flac").read_bytes())
    for kept in (42, 60):
        (tmp_path / "b.flac").write_bytes(content[:kept])
        with pytest.raises(DataError, match=r"b\.flac"):
            open_recording(tmp_path / "b.flac", sensor=OMNI)


def test_an_rf64_file_with_an_empty_ds64_is_read_to_its_end(tmp_path):
    path = tmp_path / "a.wav"
    soundfile.write(path, sound(3), RATE, "PCM_16", format="RF64")
    whole = samples(open_recording(path, sensor=DIFAR))
    content = bytearray(path.read_bytes())
    begin = content.index(b"ds64") + 8
    content[begin : begin + 24] = bytes(24)
    path.write_bytes(content)
    recording = open_recording(path, sensor=DIFAR)
    assert recording.n_samples == len(whole)
    np.testing.assert_array_equal(samples(recording), whole)
