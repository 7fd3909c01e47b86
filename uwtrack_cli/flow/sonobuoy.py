"""A sonobuoy's one channel of audio, opened as the recording of a vector sensor.

**Method.** Seconds are counted from the first sample of the file, or of the stream, and
each is made of the audio of itself and its neighbours alone (`spectra.demultiplex`). So
blocks of any size, parts, segments that are read again and live sound are the same to the
bit. Where lock is lost all three channels are nan, which frames count as a gap.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np

from uwtrack_cli.data.recording import (
    UNENDED,
    LiveSource,
    Lock,
    Reader,
    Recording,
    Samples,
    check_block,
    in_blocks,
    read_segment,
)
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError, warn
from uwtrack_cli.files.audio.dropouts import spans_in_words
from uwtrack_cli.files.audio.live_reader import (
    Disturbance,
    DisturbanceKind,
    DisturbanceRun,
    DisturbedSource,
)
from uwtrack_cli.files.audio.reader import AudioReader
from uwtrack_cli.spectra.demultiplex import (
    LEAST_RATE_HZ,
    LOCKED_RAD,
    RATE_HZ,
    Demultiplexer,
    Second,
)

CRYSTALS_PPM = 200.0
"""More than what the crystals of a buoy and of a recorder are apart, 1e-6."""

LEAST_PILOT_DB = 10.0 * math.log10(2.0 / LOCKED_RAD**2)
"""Least level of the first pilot over the noise in its band for lock, dB."""


SILENT_DB = -100.0
"""Level of a pilot that is not there, dB."""


class NoPilotsError(DataError):
    """Audio of which nothing can be demultiplexed."""


@dataclass
class DifarReader:
    """Omni, east and north of a buoy's audio: `reader(block_samples)`."""

    audio: Reader
    """Reader of the whole of the audio, one channel."""
    demultiplexer: Demultiplexer
    """What it is made with."""
    name: str
    """File name of the audio."""
    told_ppm: float
    """Clock error that the sensor file tells, 1e-6."""
    first: int = 0
    """First sample to yield."""
    last: int = UNENDED
    """Sample after the last one, unless the audio ends before."""

    def __post_init__(self) -> None:
        """Begin to look for lost lock."""
        self.n_samples = 0
        self._rows: list[tuple[float, ...]] = []
        self._lost = DisturbanceRun(DisturbanceKind.LOST, "lock on the pilots is lost", 0.0)
        self._gaps: list[Disturbance] = []

    def __call__(self, block_samples: int) -> Iterator[Samples]:
        """Yield blocks of so many samples, float32, shape (sample, 3)."""
        check_block(block_samples)
        return self._blocks(block_samples)

    @property
    def digest(self) -> str:
        """SHA-256 of all audio that came."""
        return self.audio.digest if isinstance(self.audio, LiveSource) else ""

    def end(self) -> None:
        """End live sound here."""
        if isinstance(self.audio, LiveSource):
            self.audio.end()

    def take_disturbances(self) -> list[Disturbance]:
        """Return what was noted since this was last asked."""
        found, self._gaps = self._gaps, []
        if isinstance(self.audio, DisturbedSource):
            for one in self.audio.take_disturbances():
                if one.kind is not DisturbanceKind.LOST:  # lock is lost there, too
                    start, count = (
                        n * RATE_HZ // self.demultiplexer.rate_hz
                        for n in (one.start_sample, one.n_samples)
                    )
                    moved = replace(one, start_sample=start, n_samples=count)
                    found.append(moved)
        return found

    def lock(self, sensor: str) -> Lock:
        """Return how well the pilots were received in what was read last."""
        time_s, share, snr, phase, clock = np.reshape(self._rows, (-1, 5)).T
        return Lock(
            time_s=time_s - self.first / RATE_HZ,
            locked_share=share,
            pilot_snr_db=10.0 * np.log10(np.maximum(snr, 10.0 ** (SILENT_DB / 10.0))),
            phase_pilot_db=20.0 * np.log10(np.maximum(phase, 1e-10)),
            clock_error_ppm=1e6 * clock,
            sensor=sensor,
        )

    def segment(self, first_sample: int, n_samples: int) -> Samples:
        """Read so many samples again, counted from the first that is yielded.

        Raises
        ------
        DataError
            The audio cannot be read again, or does not reach so far.
        """
        begin, rate = self.first + first_sample, self.demultiplexer.rate_hz
        seconds = range(begin // RATE_HZ, -(-(begin + n_samples) // RATE_HZ))
        start = max(0, seconds.start - 1) * rate
        stop = (seconds.stop + 1) * rate
        if isinstance(self.audio, AudioReader):
            stop = min(stop, self.audio.last)
        elif isinstance(self.audio, LiveSource):
            stop = min(stop, self.audio.n_samples)
        audio = read_segment(self.audio, start, stop - start)[:, 0]
        parts = [audio[n : n + rate] for n in range(0, audio.size, rate)]
        made = self._seconds(iter(parts), start // rate)
        samples = [s.samples for k, s in made if k in seconds]
        offset = begin - seconds.start * RATE_HZ
        return np.concatenate(samples)[offset : offset + n_samples]

    def _blocks(self, block_samples: int) -> Iterator[Samples]:
        self.n_samples, self._rows = 0, []
        for block in in_blocks(self._pieces(), block_samples):
            self.n_samples += len(block)
            yield block
        self._gaps += self._lost.finish(RATE_HZ)
        self._say()

    def _pieces(self) -> Iterator[Samples]:
        """Yield what is wanted of each second, and note its lock and where it is lost."""
        rate = self.demultiplexer.rate_hz
        begin = max(0, self.first // RATE_HZ - 1)
        audio = self.audio
        if isinstance(audio, AudioReader):
            last = min(audio.last, (-(-self.last // RATE_HZ) + 1) * rate)
            audio = replace(audio, first=begin * rate, last=last)
        else:  # live audio comes from its begin
            begin = 0
        count = 0
        parts = in_blocks((block[:, 0] for block in audio(rate)), rate)
        for number, second in self._seconds(parts, begin):
            start = number * RATE_HZ
            low, high = max(self.first - start, 0), self.last - start
            if high <= 0:
                return
            wanted = second.samples[low:high]
            if wanted.shape[0]:
                self._gaps += self._lost.add(count, np.isnan(wanted[:, 0]), RATE_HZ)
                count += len(wanted)
                facts = (second.locked_share, second.pilot_snr, second.phase_pilot)
                self._rows.append((float(number), *facts, second.clock_error))
                yield wanted

    def _seconds(self, parts: Iterator[Samples], first: int) -> Iterator[tuple[int, Second]]:
        """Yield seconds of audio demultiplexed, each with its number.

        ``parts``: consecutive seconds of audio, from the given number on.
        """
        rate = self.demultiplexer.rate_hz
        before = np.zeros(0, np.float32)
        here = next(parts, before)
        for number, after in enumerate(chain(parts, [np.zeros(0, np.float32)]), first):
            audio = np.zeros(3 * rate)
            audio[rate - before.size : rate] = before
            audio[rate : rate + here.size] = here
            audio[2 * rate : 2 * rate + after.size] = after
            stop = rate + here.size + after.size
            made = self.demultiplexer.second(audio, rate - before.size, stop)
            n_samples = here.size * RATE_HZ // rate
            yield number, replace(made, samples=made.samples[:n_samples])
            before, here = here, after

    def _say(self) -> None:
        """Say where lock was lost, once the sound has ended.

        Raises
        ------
        NoPilotsError
            There was no lock anywhere.
        """
        lock = self.lock("")
        if not lock.locked_share.any():
            raise NoPilotsError(_why_no_lock(self.name, lock))
        high_ppm = float(np.nanmedian(lock.clock_error_ppm)) - self.told_ppm
        if abs(high_ppm) > CRYSTALS_PPM:
            warn(
                f"{self.name}: its pilots are {high_ppm:.0f}e-6 off 7.5 and 15 kHz, more "
                f"than crystals are: the recorder was, and so are all frequencies; "
                f"clock_error_ppm = {high_ppm + self.told_ppm:.0f} in its sensor file "
                f"takes it off."
            )
        if isinstance(self.audio, LiveSource):  # its gaps are told as events
            return
        gaps = [(g.start_sample, g.start_sample + g.n_samples) for g in self._gaps]
        self._gaps = []
        if gaps:
            lost_s = sum(stop - start for start, stop in gaps) / RATE_HZ
            warn(
                f"{self.name}: lock on the pilots is lost from "
                f"{spans_in_words(gaps, RATE_HZ)}; these {lost_s:.1f} s are treated as "
                f"gaps."
            )


def _why_no_lock(name: str, lock: Lock) -> str:
    """Return the sentence about audio of which nothing can be demultiplexed."""
    best_db = lock.pilot_snr_db.max(initial=SILENT_DB)
    if best_db > LEAST_PILOT_DB:
        return (
            f"{name} has a tone at 7.5 kHz, but no pilot of a DIFAR buoy at 15 kHz: what "
            f"received or compressed the audio has cut it off; record it without loss "
            f"up to 18 kHz."
        )
    tone = f"a tone is {best_db:.0f} dB over the noise about it at most"
    if best_db <= SILENT_DB:
        tone = "there is no tone"
    return (
        f"{name} has no pilots of a DIFAR buoy at 7.5 and 15 kHz (at 7.5 kHz {tone}, "
        f"{LEAST_PILOT_DB:.0f} dB are needed): the receiver was off its channel, or the audio is that of another "
        f'buoy, whose sensor file says kind = "omni".'
    )


def demultiplex(recording: Recording) -> Recording:
    """Return the recording of omni, east and north that a buoy's audio holds.

    Parameters
    ----------
    recording
        One channel of audio, opened for reading, whose sensor is of the kind
        "difar-multiplexed".

    Returns
    -------
    Recording
        Three channels at 6 kHz, made while they are read; nan where lock on the pilots
        is lost. Reading one without any lock raises a DataError at its end.

    Raises
    ------
    DataError
        The sample rate is too low, or no whole number of Hz.
    """
    sensor, rate = recording.sensor, recording.sample_rate_hz
    if recording.reader is None or not sensor.is_multiplexed:
        raise DataError(f"{recording.name} is no audio of a buoy that was opened for reading.")
    if rate < LEAST_RATE_HZ or not rate.is_integer():
        raise DataError(
            f"{recording.name} has {rate:g} samples per second; the multiplex of a DIFAR "
            f"buoy reaches up to 18 kHz and needs a whole number of {LEAST_RATE_HZ} or "
            f"more, as a rule 48000."
        )
    demultiplexer = Demultiplexer(int(rate), **_facts(sensor))
    reader = DifarReader(
        recording.reader, demultiplexer, recording.name, sensor.clock_error_ppm or 0.0
    )
    n_samples = recording.n_samples * RATE_HZ // int(rate)
    if n_samples < 1:
        raise DataError(f"{recording.name} is too short: it holds no sample at {RATE_HZ} Hz.")
    return replace(
        recording,
        sensor=replace(sensor, channels="omni,east,north"),
        sample_rate_hz=float(RATE_HZ),
        n_samples=UNENDED if recording.is_live else n_samples,
        n_channels=3,
        reader=reader,
    )


def _facts(sensor: Sensor) -> Mapping[str, Any]:
    """Return what a sensor says of its multiplex."""
    first, second = (sensor.multiplex or "-east,north").split(",")
    pairs = [pair.split(":") for pair in (sensor.response or "").split(",") if pair]
    return {"dipoles": (first, second), "response": tuple((float(f), float(db)) for f, db in pairs)}
