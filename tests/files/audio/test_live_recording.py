"""Sound through pipes is to the bit what libsndfile reads from the same file."""

import hashlib
import io
import os
import struct
import threading
import time
import warnings

import numpy as np
import pytest
import soundfile

from uwtrack_cli.data.recording import UNENDED
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError, OptionError, UwtrackWarning
from uwtrack_cli.files.audio import byte_stream
from uwtrack_cli.files.audio.byte_stream import ByteSpool, PipeStream
from uwtrack_cli.files.audio.live_reader import LiveReader
from uwtrack_cli.files.audio.live_recording import RawSound, open_live_recording
from uwtrack_cli.files.audio.recording_file import open_recording
from uwtrack_cli.files.audio.stream_header import (
    RAW_FORMATS,
    SampleFormat,
    StreamHeader,
    read_stream_header,
)

RATE = 1000
OMNI = Sensor(id="h1")
RAW = RawSound("s16le", 1000.0, 3)
NOISE = np.random.default_rng(1).uniform(-0.9, 0.9, (4 * RATE, 1))


def read_all(recording, block=RATE):
    return np.concatenate(list(recording.reader(block)))


def through_pipe(tmp_path, content, **options):
    """Open bytes that a named pipe delivers in pieces of odd lengths."""
    fifo = tmp_path / f"fifo{len(list(tmp_path.iterdir()))}"
    os.mkfifo(fifo)

    def write():
        with fifo.open("wb") as file:
            for begin in range(0, len(content), 777):
                file.write(content[begin : begin + 777])
                file.flush()

    threading.Thread(target=write, daemon=True).start()
    return open_live_recording(fifo, sensor=options.pop("sensor", OMNI), **options)


@pytest.mark.parametrize(
    ("kind", "subtype"),
    [
        ("WAV", "PCM_U8"), ("WAV", "PCM_16"), ("WAV", "PCM_24"), ("WAV", "PCM_32"),
        ("WAV", "FLOAT"), ("WAV", "DOUBLE"), ("WAVEX", "PCM_24"), ("RF64", "PCM_16"),
    ],
)  # fmt: skip
def test_a_pipe_gives_the_samples_of_the_file(tmp_path, kind, subtype):
    path = tmp_path / "a.wav"
    soundfile.write(path, NOISE, RATE, subtype, format=kind)
    live = through_pipe(tmp_path, path.read_bytes())
    assert live.is_live
    np.testing.assert_array_equal(
        read_all(live), soundfile.read(path, dtype="float32", always_2d=True)[0]
    )
    from_file = open_recording(path, sensor=OMNI)
    ended = live.ended()
    assert ended.n_samples == from_file.n_samples
    assert ended.digest == from_file.digest
    assert ended.sample_rate_hz == from_file.sample_rate_hz
    assert ended.file_channels == from_file.file_channels


@pytest.mark.parametrize("order", ["LITTLE", "BIG"])
@pytest.mark.parametrize(
    ("name", "subtype"),
    [("s8", "PCM_S8"), ("s16", "PCM_16"), ("s24", "PCM_24"), ("s32", "PCM_32"),
     ("f32", "FLOAT"), ("f64", "DOUBLE"), ("u8", "PCM_U8")],
)  # fmt: skip
def test_raw_samples_are_those_of_libsndfile(name, subtype, order):
    memory = io.BytesIO()
    soundfile.write(memory, NOISE, RATE, subtype, order, "RAW")
    wanted = soundfile.read(
        io.BytesIO(memory.getvalue()), samplerate=RATE, channels=1, subtype=subtype,
        endian=order, format="RAW", dtype="float32", always_2d=True,
    )[0]  # fmt: skip
    full = name if name in RAW_FORMATS else f"{name}{order[0].lower()}e"
    found = RAW_FORMATS[full].decode(memory.getvalue(), 1)
    np.testing.assert_array_equal(found, wanted)


QUIET = np.round(3.0 * np.random.default_rng(4).standard_normal(20_000))
TABLE = "".join(f"{k / 10},{k % 7} µPa\n" for k in range(2000)).encode()


@pytest.mark.parametrize("name", sorted(RAW_FORMATS))
def test_lines_of_text_are_no_raw_sound(tmp_path, name):
    live = through_pipe(tmp_path, TABLE, raw=RawSound(name, 1000.0))
    with pytest.raises(DataError, match=r"gives text, which begins with '0\.0,0 µPa'"):
        read_all(live)


@pytest.mark.parametrize(
    "content",
    [
        (QUIET + 110).astype(np.uint8).tobytes(),  # 8 bits with an offset
        (QUIET + 28).astype(np.uint8).tobytes(),  # about the space
        (QUIET * 9 + 70).clip(10, 126).astype(np.uint8).tobytes(),  # clipped at a feed
        (QUIET + 0x2020).astype("<i2").tobytes(),  # 16 bits with an offset
        (QUIET * 100 + 0x4141).astype("<i2").tobytes(),
        (0.1 * QUIET + 0.7).astype("<f4").tobytes(),
        np.full(9000, 0x0A20, "<i2").tobytes(),  # a converter that is stuck
        b"\n a" * 9000,
        TABLE[:200],
        b"started\n" + QUIET.astype("<i2").tobytes(),
    ],
)
@pytest.mark.parametrize("name", ["u8", "s16le"])
@pytest.mark.filterwarnings("ignore::uwtrack_cli.errors.UwtrackWarning")
def test_sound_is_never_taken_for_text(tmp_path, name, content):
    content = content[: len(content) // 2 * 2]
    live = through_pipe(tmp_path, content, raw=RawSound(name, 30_000.0))
    wanted = RAW_FORMATS[name].decode(content, 1)
    np.testing.assert_array_equal(read_all(live, 30_000), wanted)


def test_what_is_no_number_is_nan():
    values = np.array([0.5, np.inf, -np.inf, np.nan, 1e300])
    found = SampleFormat("f", 8).decode(values.astype("<f8").tobytes(), 1)
    np.testing.assert_array_equal(found[:, 0], np.float32([0.5, *[np.nan] * 4]))


def wav_bytes(n_samples=2 * RATE, n_channels=1):
    memory = io.BytesIO()
    sound = np.random.default_rng(2).uniform(-1, 1, (n_samples, n_channels))
    soundfile.write(memory, sound, RATE, "PCM_16", format="WAV")
    return memory.getvalue()


@pytest.mark.parametrize("size", [0, 0xFFFFFFFF, 0x7FFFF000, 0x7FFFFFFF])
def test_an_unknown_length_is_all_that_follows(tmp_path, size):
    content = bytearray(wav_bytes())
    content[4:8] = content[40:44] = struct.pack("<I", size)
    recording = through_pipe(tmp_path, bytes(content))
    assert recording.n_samples == UNENDED
    assert read_all(recording).shape == (2 * RATE, 1)


def test_the_length_that_sox_writes_for_frames_of_three_channels_is_unknown():
    content = bytearray(wav_bytes(10, 3))
    content[40:44] = struct.pack("<I", 0x7FFFF000 // 6 * 6)
    header = read_stream_header(io.BytesIO(bytes(content)).read, "it")
    assert header.n_bytes is None
    assert header.n_channels == 3


def test_chunks_after_the_promised_end_are_no_sound(tmp_path):
    content = wav_bytes() + b"LIST" + struct.pack("<I", 100) + bytes(100)
    assert read_all(through_pipe(tmp_path, content)).shape == (2 * RATE, 1)


def test_a_second_file_in_the_pipe_is_told(tmp_path):
    recording = through_pipe(tmp_path, wav_bytes() + wav_bytes(40 * RATE))
    with pytest.warns(UwtrackWarning, match="after the 2.000 s that its header"):
        assert read_all(recording).shape == (2 * RATE, 1)


def test_an_end_in_the_middle_of_a_sample_is_told_and_left_out(tmp_path):
    content = wav_bytes()[:-1]
    with pytest.warns(UwtrackWarning) as said:
        found = read_all(through_pipe(tmp_path, content))
    assert found.shape == (2 * RATE - 1, 1)
    texts = " ".join(str(w.message) for w in said)
    assert "in the middle of a sample: its last 1 bytes" in texts
    assert "its header promises 2.000 s" in texts


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty: no sound came"),
        (b"time_s,level_db\n1,2\n", "is no WAV sound"),
        (wav_bytes()[:30], "before its first sample"),
        (wav_bytes()[:20] + b"\x55\0" + wav_bytes()[22:], "WAV format 85"),
        (wav_bytes()[:24] + bytes(4) + wav_bytes()[28:], "claims 0 Hz"),
    ],
)
def test_no_sound_is_one_sentence(tmp_path, content, words):
    with pytest.raises(DataError, match=words):
        through_pipe(tmp_path, content)


@pytest.mark.parametrize(
    ("raw", "words"),
    [
        (RawSound("s16", 1000.0), "sample format 's16'"),
        (RawSound("s16le", 0.0), "--rate-hz"),
        (RawSound("s16le", 1000.0, 0), "--channels"),
    ],
)
def test_raw_sound_that_cannot_be_is_refused(raw, words):
    with pytest.raises(OptionError, match=words):
        raw.header()


def test_channels_and_span_are_those_of_the_file(tmp_path):
    path = tmp_path / "three.wav"
    path.write_bytes(wav_bytes(3000, 3))
    sensor = Sensor(id="h1", kind="difar", channels="north,omni,east")
    options = {"sensor": sensor, "start_s": 0.5, "stop_s": 2.25, "start_utc_ns": 10**18}
    from_file = open_recording(path, **options)
    live = through_pipe(tmp_path, path.read_bytes(), **options)
    np.testing.assert_array_equal(read_all(live), read_all(from_file))
    assert live.start_utc_ns == from_file.start_utc_ns
    assert live.sensor.channels == "omni,east,north"
    with pytest.raises(OptionError, match="stop_s after it"):
        through_pipe(tmp_path, b"x", **{**options, "start_s": 3.0}, raw=RAW)


def test_a_pipe_is_read_ahead_only_so_far(monkeypatch):
    """A writer faster than the work waits: back-pressure is that of the pipe."""
    monkeypatch.setattr(byte_stream, "HELD_BYTES", 1 << 18)
    given = []

    class Endless(io.RawIOBase):
        def read(self, size=-1):
            given.append(size)
            return bytes(size)

    stream = PipeStream("noise", Endless)
    for _ in range(50):
        assert len(stream.take(10_000)) == 10_000
        assert stream.n_waiting <= (1 << 18) + byte_stream.PIECE_BYTES
    stream.end()
    stream._thread.join(timeout=30)
    assert not stream._thread.is_alive()
    assert sum(given) <= 500_000 + (1 << 18) + 4 * byte_stream.PIECE_BYTES


def test_a_pipe_that_gives_nothing_ends_when_asked_to():
    reading, writing = os.pipe()
    stream = PipeStream("pipe", lambda: os.fdopen(reading, "rb", buffering=0))
    os.write(writing, b"some")
    threading.Timer(0.3, stream.end).start()
    assert stream.take(4) == b"some"
    assert stream.take(100) == b""
    os.close(writing)


def test_a_stall_and_a_jump_of_the_clock_are_noted(monkeypatch):
    now = {"steady": 100.0, "clock": 1e9}
    monkeypatch.setattr(byte_stream.time, "monotonic", lambda: now["steady"])
    monkeypatch.setattr(byte_stream.time, "time", lambda: now["clock"])

    class Slow(io.RawIOBase):
        """Sound whose third piece comes late, and after a step of the clock."""

        pieces = 0

        def read(self, _=-1):
            self.pieces += 1
            if self.pieces == 3:
                now["steady"] += 10.0
                now["clock"] += 3610.0
            return bytes(2000) if self.pieces < 6 else b""

    stream = PipeStream("pipe", Slow)
    stream._thread.join()  # the work begins later: that is no stall
    now["steady"] += 100.0
    now["clock"] += 100.0
    header = StreamHeader(1000.0, 1, SampleFormat("s", 2))
    reader = LiveReader(stream, header, (0,))
    with pytest.warns(UwtrackWarning, match="silent"):
        list(reader(1000))
    noted = [d.reason for d in reader.take_disturbances()]
    assert sorted(noted) == [
        "no sound came for 10.0 s",
        "the computer's clock jumped by +3600.0 s; times count samples",
    ]


def test_samples_that_are_no_number_and_sound_that_does_not_change_are_noted():
    sound = np.random.default_rng(3).uniform(-1, 1, 300 * 100).astype("<f4")
    sound[1050:1270] = np.nan
    sound[10_000:18_000] = 0.25
    header = StreamHeader(100.0, 1, SampleFormat("f", 4))
    stream = PipeStream("pipe", lambda: io.BytesIO(sound.tobytes()))
    reader = LiveReader(stream, header, (0,))
    with (
        pytest.warns(UwtrackWarning, match="no number"),
        pytest.warns(UwtrackWarning, match="does not change from 100.0 to 180.0 s"),
    ):
        found = [d for _ in reader(100) for d in reader.take_disturbances()]
    found += reader.take_disturbances()
    facts = [(d.reason, d.start_sample, d.n_samples, d.is_over) for d in found]
    assert facts == [
        ("the samples are no number", 1050, 220, True),
        ("the sound does not change", 10_000, 6000, False),
        ("the sound does not change", 10_000, 8000, True),
    ]


ODD_SOUNDS = {
    "plain": lambda _: None,
    "no number": lambda x: x.__setitem__((slice(1500, 1600), 0), np.nan),
    "infinite": lambda x: x.__setitem__((700, 1), np.inf),
    "silence": lambda x: x.__setitem__(slice(900, 2600), 0.0),
    "stuck": lambda x: x.__setitem__(slice(1999, 3001), -0.25),
    "short silence": lambda x: x.__setitem__(slice(900, 1300), 0.0),
    "silence at the begin": lambda x: x.__setitem__(slice(0, 800), 0.0),
    "silence at the end": lambda x: x.__setitem__(slice(3300, None), 0.0),
    "short silence at the end": lambda x: x.__setitem__(slice(3700, None), 0.0),
    "silence twice": lambda x: [
        x.__setitem__(slice(*span), value)
        for span, value in (((500, 1500), 0.0), ((1500, 2500), 0.5))
    ],
    "silence of one channel": lambda x: x.__setitem__((slice(900, 2600), 0), 0.0),
    "a channel of zeros": lambda x: x.__setitem__((slice(None), 1), 0.0),
    "nothing at all": lambda x: x.__setitem__(slice(None), 0.0),
    "clipped": lambda x: np.clip(3.0 * x, -1.0, 1.0, out=x),
    "a change of level": lambda x: x.__setitem__(slice(2000, None), 1e-3 * x[2000:]),
}


@pytest.mark.parametrize("odd", ODD_SOUNDS)
def test_odd_sound_is_treated_as_in_the_file(tmp_path, odd):
    """To the bit, with the same words, in blocks and when it is read again."""
    values = np.random.default_rng(2).uniform(-0.9, 0.9, (4 * RATE, 2)).astype("f4")
    ODD_SOUNDS[odd](values)
    path = tmp_path / "a.wav"
    soundfile.write(path, values, RATE, "FLOAT")
    sensor = Sensor(id="a", kind="array", channels="a,b", element_along_m="0,1")
    live = through_pipe(tmp_path, path.read_bytes(), sensor=sensor)
    recording = open_recording(path, sensor=sensor)
    found, said = [], []
    for one, block in ((recording, 4 * RATE), (recording, 777), (live, RATE)):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            found.append(read_all(one, block))
        said.append([str(w.message).partition(" does")[2] for w in caught])
    for one in found[1:]:
        np.testing.assert_array_equal(one, found[0])
    assert said[2] == said[0]
    again = [one.segment(1.2, 3.4) for one in (recording, live)]
    np.testing.assert_array_equal(again[0], found[0][1200:3400])
    np.testing.assert_array_equal(again[1], again[0])


def test_a_growing_file_is_followed_to_its_end(tmp_path):
    """The header is written last, as recorders do."""
    path = tmp_path / "growing.wav"
    whole = wav_bytes(20 * RATE)
    header = bytearray(whole[:44])
    header[4:8] = header[40:44] = bytes(4)
    path.write_bytes(bytes(header) + whole[44:5000])

    def grow():
        with path.open("r+b") as file:
            file.seek(0, os.SEEK_END)
            for begin in range(5000, len(whole), 5000):
                file.write(whole[begin : begin + 5000])
                file.flush()
                time.sleep(0.01)
            file.seek(0)
            file.write(whole[:44])

    writer = threading.Thread(target=grow)
    recording = open_live_recording(path, sensor=OMNI, stop_s=20.0)
    writer.start()
    found = read_all(recording)
    writer.join()
    from_file = open_recording(path, sensor=OMNI)
    np.testing.assert_array_equal(found, read_all(from_file))
    assert recording.ended().digest == from_file.digest


def test_a_file_that_no_longer_grows_is_complete(tmp_path):
    path = tmp_path / "whole.wav"
    path.write_bytes(wav_bytes() + b"LIST" + struct.pack("<I", 100) + bytes(100))
    recording = open_live_recording(path, sensor=OMNI, idle_s=0.3)
    assert read_all(recording).shape == (2 * RATE, 1)


def test_a_file_that_becomes_shorter_ends_where_it_was_read_to(tmp_path):
    path = tmp_path / "shrinking.wav"
    content = wav_bytes(2 * RATE)
    path.write_bytes(content)
    recording = open_live_recording(path, sensor=OMNI, idle_s=60.0)
    blocks = recording.reader(RATE // 2)
    found = [next(blocks)]
    os.truncate(path, 100)
    with pytest.warns(UwtrackWarning, match="has become shorter while it was followed"):
        found += list(blocks)
    sound = np.concatenate(found)
    whole = read_all(through_pipe(tmp_path, content, sensor=OMNI))
    np.testing.assert_array_equal(sound, whole[: sound.shape[0]])
    read = 44 + 2 * sound.shape[0]
    assert recording.ended().digest == hashlib.sha256(content[:read]).hexdigest()


@pytest.mark.parametrize("what", ["removed", "replaced", "moved"])
def test_a_file_that_loses_its_name_is_followed_to_its_own_end(tmp_path, what):
    path, content = tmp_path / "lost.wav", wav_bytes(4 * RATE)
    path.write_bytes(content[: len(content) // 2])
    recording = open_live_recording(path, sensor=OMNI, idle_s=60.0)
    blocks = recording.reader(RATE)
    found = [next(blocks)]
    with path.open("ab") as writer:  # it still writes into what it has opened
        if what == "removed":
            path.unlink()
        elif what == "moved":
            path.rename(tmp_path / "done.wav")
        else:
            (tmp_path / "next.wav").write_bytes(bytes(2 * len(content)))
            (tmp_path / "next.wav").replace(path)
        writer.write(content[len(content) // 2 :])
    # the whole sound has come, as its header says, and nothing of another file
    with pytest.warns(UwtrackWarning, match="moved, replaced or removed"):
        found += list(blocks)
    whole = read_all(through_pipe(tmp_path, content, sensor=OMNI))
    np.testing.assert_array_equal(np.concatenate(found), whole)
    assert recording.ended().digest == hashlib.sha256(content).hexdigest()


def test_an_idle_time_that_cannot_be_is_refused(tmp_path):
    with pytest.raises(OptionError, match="--idle-s must be more than 0"):
        through_pipe(tmp_path, b"", idle_s=0.0)


def test_what_came_can_be_read_again_as_from_the_file(tmp_path):
    path = tmp_path / "three.wav"
    path.write_bytes(wav_bytes(5 * RATE, 3))
    sensor = Sensor(id="h1", kind="difar", channels="north,omni,east")
    from_file = open_recording(path, sensor=sensor, start_s=0.5)
    piped = through_pipe(tmp_path, path.read_bytes(), sensor=sensor, start_s=0.5)
    followed = open_live_recording(path, sensor=sensor, start_s=0.5, stop_s=5.0)
    for live in (piped, followed):
        blocks = live.reader(RATE)
        next(blocks)
        with pytest.raises(DataError, match="not at hand"):
            live.segment(0.5, 1.5)  # it has not come
        for _ in blocks:
            pass
        for span in ((0.0, 0.3), (1.7, 4.5), (-1.0, 9.0)):
            again = live.ended().segment(*span)
            np.testing.assert_array_equal(again, from_file.segment(*span))


def test_the_last_bytes_are_kept_on_disk_and_no_more():
    spool = ByteSpool(1000)
    content = np.random.default_rng(4).bytes(10_000)
    for begin in range(0, 10_000, 70):
        spool.add(content[begin : begin + 70])
        end = min(begin + 70, 10_000)
        low = max(0, end - 500)
        assert spool.read(low, end - low) == content[low:end]
        assert spool.read(low, end - low + 1) is None
        assert len(spool._parts) <= 2
    assert spool.read(0, 10) is None


def test_a_full_disk_keeps_nothing_and_ends_nothing(monkeypatch):
    spool = ByteSpool(1000)
    spool.add(b"first")

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(byte_stream, "_write_at", full)
    spool.add(b"second")
    assert spool.read(0, 5) is None
    monkeypatch.undo()
    spool.add(b"third")
    assert spool.read(11, 5) == b"third"
    assert spool.read(5, 6) is None
