"""Sound of vessels without a line, whose images in surface and bottom make fringes.

The sound of every image of the source is read at its own time of emission, out of one
process that is made at four times the rate; `draw_power` draws its power without sound. Images in the bottom are those of a channel
of flat bottom (Brekhovskikh and Lysanov, Fundamentals of Ocean Acoustics, section 5.1);
nothing is said of fringes, and nothing is shared with the program's simulator.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from tests.draws.recordings import Drawn, Passage
from tests.draws.vehicle_sounds import coloured, wander
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.fringes import Fringes
from uwtrack_cli.data.spectra import Spectrogram
from uwtrack_cli.spectra.fringes import measure_fringes

RATE_HZ, SOUND_MPS, LEAD_S, FINER = 16000.0, 1500.0, 5.0, 4
STRETCH = 1 << 20
"""Samples that are made at once."""


@dataclass(frozen=True)
class Scene:
    """Where the sound goes, and what the sea sounds like."""

    seconds: float
    sensor_m: float
    ways: list[tuple[float, float]]
    """Height above or below the sensor, m, and share of amplitude of each image."""
    sea_slope_db: float
    """Per octave, as of the vessel below."""
    vessel_slope_db: float


@dataclass(frozen=True)
class Source:
    """A vessel on a straight course past the sensor."""

    time_s: float
    """Closest approach, as it is, not as it is heard."""
    speed_mps: float
    flat_m: float
    """Horizontal range there."""
    depth_m: float
    image: float
    """Share of the amplitude that the surface reflects."""

    def slant_m(self, sensor_m: float) -> float:
        """Range of its closest approach, to the middle of source and image."""
        return float(np.sqrt(self.flat_m**2 + sensor_m**2 + self.depth_m**2))


def images(
    source: Source, sensor_m: float, water_m: float | None, bounce_db: float, orders: int
) -> list[tuple[float, float]]:
    """Return height above or below the sensor, m, and share of amplitude of each image."""
    found = [(sensor_m - source.depth_m, 1.0), (sensor_m + source.depth_m, -source.image)]
    if water_m is None:
        return found
    each = 10.0 ** (-bounce_db / 20.0)
    for order in range(1, orders + 1):
        bounced = each**order * (-source.image) ** (order - 1)
        for far in (2 * order * water_m - sensor_m, 2 * order * water_m + sensor_m):
            # a way that begins upward, or ends downward from the surface, meets it more
            more = -source.image if far > 2 * order * water_m else 1.0
            found += [
                (far - source.depth_m, bounced * more),
                (far + source.depth_m, bounced * more * -source.image),
            ]
    return found


def source_process(
    rng: np.random.Generator, seconds: float, slope_db: float, rate: float
) -> np.ndarray:
    """Draw noise with a slope in dB per octave at a multiple of the rate."""
    size = next_fast_len(int(seconds * rate) + 1, real=True)
    spectrum = rfft(rng.standard_normal(size, np.float32))
    frequency = np.maximum(np.arange(spectrum.size) * rate / size, 1e-3)
    gain = frequency ** (slope_db / 6.02) / (1.0 + (30.0 / frequency) ** 4)
    gain[frequency > 0.48 * rate] = 0.0
    spectrum *= gain.astype(np.float32)
    return irfft(spectrum, FINER * size)


def heard(
    rng: np.random.Generator, source: Source, place: Scene, rate: float = RATE_HZ
) -> np.ndarray:
    """Return what a hydrophone records of a vessel."""
    fine = FINER * rate
    seconds = place.seconds
    sound = source_process(rng, seconds + 2 * LEAD_S, place.vessel_slope_db, rate)
    emitted = np.arange(-LEAD_S, seconds + LEAD_S, 0.05)
    flat = np.hypot(source.flat_m, source.speed_mps * (emitted - source.time_s))
    n = int(seconds * rate)
    total = np.zeros(n)
    for first in range(0, n, STRETCH):
        time = np.arange(first, min(first + STRETCH, n)) / rate
        for height, share in place.ways:
            slant = np.hypot(flat, height)
            begun = np.interp(time, emitted + slant / SOUND_MPS, emitted)
            index = (begun + LEAD_S) * fine
            whole = index.astype(np.int64)
            part = index - whole
            here = sound[whole] * (1.0 - part) + sound[whole + 1] * part
            gain = share / np.interp(begun, emitted, slant)
            total[first : first + time.size] += gain * here
    return total


def scene(seed: int, *, is_deep: bool) -> tuple[np.random.Generator, Source, Scene]:
    """Draw who passes, and where the sound goes."""
    rng = np.random.default_rng([seed, 4903, int(is_deep)])
    seconds = float(rng.uniform(480.0, 600.0))
    sensor_m = float(rng.uniform(15.0, 60.0))
    source = Source(
        float(rng.uniform(0.25, 0.75) * seconds), float(rng.uniform(3.0, 11.0)),
        float(rng.uniform(80.0, 500.0)), float(rng.uniform(2.0, 7.0)),
        float(rng.uniform(0.7, 1.0)),
    )  # fmt: skip
    water_m = None if is_deep else float(sensor_m + rng.uniform(11.0, 40.0))
    slope = float(rng.uniform(-4.0, -1.0))
    ways = images(source, sensor_m, water_m, 6.0, 3)
    place = Scene(seconds, sensor_m, ways, slope, slope + float(rng.uniform(-1, 1)))
    return rng, source, place


def draw(
    seed: int, *, is_deep: bool, snr_db: float = -8.0, swing_db: float = 1.5,
    rate: float = RATE_HZ, line_db: float | None = None,
) -> tuple[Drawn, Source]:  # fmt: skip
    """Draw a passage of eight to ten minutes over a sea that swings.

    ``snr_db``: of the broadband at the closest approach, in the whole band. ``line_db``:
    level of a line at the closest approach over the noise in 1 Hz about it.
    """
    rng, source, place = scene(seed, is_deep=is_deep)
    n = int(place.seconds * rate)
    sea = coloured(rng, n, rate, place.sea_slope_db, 30.0, 0.48 * rate)
    sea *= 10.0 ** (swing_db * wander(rng, n, rate, 20.0) / 20.0)
    vessel = heard(rng, source, place, rate)
    near = slice(*(int((source.time_s + k) * rate) for k in (-2, 2)))
    scale = 10.0 ** (snr_db / 20.0) * sea.std() / vessel[near].std()
    total = sea + scale * vessel
    if line_db is not None:
        total += _line(rng, source, sea, line_db, rate, place.sensor_m)
    facts = {"id": "h1", "kind": "omni", "channels": ["omni"]}
    facts |= {"depth_m": place.sensor_m, "depth_std_m": 0.5, "full_scale_db": 170.0}
    slant = source.slant_m(place.sensor_m)
    passage = Passage(source.time_s, source.speed_mps, slant)
    scaled = 0.5 * total / np.abs(total).max()
    return Drawn(rate, scaled, (passage,), facts), source


def draw_power(
    seed: int, *, is_deep: bool, snr_db: float = -8.0, swing_db: float = 1.5,
    rate: float = RATE_HZ, window_s: float = 0.5,
) -> tuple[np.ndarray, np.ndarray, Source]:  # fmt: skip
    """Draw the same in power of Hann windows that overlap by half, at a tenth of the cost.

    Returns frequencies, power of shape (frame, frequency), and the source.
    """
    rng, source, known = expected(
        seed, is_deep=is_deep, snr_db=snr_db, swing_db=swing_db, rate=rate, window_s=window_s
    )
    return known.frequency_hz, noisy(rng, known.sea + known.vessel), source


class Expected(NamedTuple):
    """What a recording of a passage has in the mean."""

    time_s: np.ndarray
    """Middle of each frame."""
    frequency_hz: np.ndarray
    sea: np.ndarray
    """Density of the sea, shape (frame, frequency)."""
    vessel: np.ndarray
    """Density of the vessel, of the same shape."""


def time_bound_s(source: Source, known: Expected) -> float:
    """Return the least deviation of a closest approach, s.

    By the Cramer-Rao bound of densities that are known but for the level and slope of
    each frame, time and R/v (Kay 1993, section 3.9): a cell of b Hz and s seconds counts
    b s values of one complex degree of freedom.
    """
    time, frequency = known.time_s, known.frequency_hz
    used = (frequency > 100.0) & (frequency < 7000.0)
    total = (known.sea + known.vessel)[:, used]
    later = np.gradient(known.vessel[:, used], time, axis=0) / total
    own = np.log(frequency[used])
    own = (own - own.mean()) / own.std()
    later -= later.mean(axis=1, keepdims=True)
    later -= np.outer((later * own).mean(axis=1), own)
    each = np.stack([later, later * (time - source.time_s)[:, None]])
    values = (time[1] - time[0]) * (frequency[1] - frequency[0])
    information = values * np.tensordot(each, each, axes=([1, 2], [1, 2]))
    return float(np.sqrt(np.linalg.inv(information)[0, 0]))


def expected(
    seed: int, *, is_deep: bool, snr_db: float = -8.0, swing_db: float = 1.5,
    rate: float = RATE_HZ, window_s: float = 0.5,
) -> tuple[np.random.Generator, Source, Expected]:  # fmt: skip
    """Return what `draw_power` has in the mean, and what its noise is drawn with."""
    rng, source, place = scene(seed, is_deep=is_deep)
    n_frames = int(place.seconds / (0.5 * window_s)) - 1
    time = (np.arange(n_frames) + 1.0) * 0.5 * window_s
    frequency = np.arange(1, int(0.44 * rate * window_s)) / window_s
    emitted = np.arange(-LEAD_S, place.seconds + LEAD_S, 0.05)
    flat = np.hypot(source.flat_m, source.speed_mps * (emitted - source.time_s))
    field = np.zeros((n_frames, frequency.size), np.complex64)
    step_hz = frequency[1] - frequency[0]
    # what arrives at a frequency was made at another, by the Doppler shift
    direct_s = emitted + np.hypot(flat, place.ways[0][0]) / SOUND_MPS
    made = np.interp(time, direct_s[1:], np.diff(direct_s) / 0.05)
    for height, share in place.ways:
        slant = np.hypot(flat, height)
        begun = np.interp(time, emitted + slant / SOUND_MPS, emitted)
        delay = made * (time - begun)
        cycles = frequency[0] * delay
        first = np.exp(-2j * np.pi * cycles) * share / np.interp(begun, emitted, slant)
        turn = np.exp(-2j * np.pi * step_hz * delay)
        block = np.exp(-2j * np.pi * step_hz * delay[:, None] * np.arange(64)).astype(np.complex64)
        at = first
        leap = turn**64
        for k in range(0, frequency.size, 64):
            size = min(64, frequency.size - k)
            field[:, k : k + size] += at.astype(np.complex64)[:, None] * block[:, :size]
            at = at * leap
    vessel = np.abs(field) ** 2 * (frequency / 1e3) ** (place.vessel_slope_db / 3.01)
    sea = (frequency / 1e3) ** (place.sea_slope_db / 3.01)
    near = np.abs(time - source.time_s) < 2.0
    scale = 10.0 ** (snr_db / 10.0) * sea.sum() / vessel[near].mean(axis=0).sum()
    swing = 10.0 ** (swing_db * wander(rng, n_frames, 2.0 / window_s, 20.0) / 10.0)
    known = Expected(time, frequency, sea * swing[:, None], scale * vessel)
    return rng, source, known


def noisy(rng: np.random.Generator, density: np.ndarray) -> np.ndarray:
    """Draw the power of noise of a density in Hann windows that overlap by half."""
    shape = (density.shape[0] + 1, density.shape[1] + 2)
    # halves of a window: neighbours share one, and Hann joins three cells
    halves = rng.standard_normal((2, *shape), np.float32)
    white = halves[0] + 1j * halves[1]
    joined = 0.25 * white[:, :-2] + 0.5 * white[:, 1:-1] + 0.25 * white[:, 2:]
    joined = joined[1:] + (1.0 / 6.0) * joined[:-1]
    noise = np.abs(joined) ** 2
    return (density * noise / noise.mean()).astype(np.float32)


def fringes_of(frequency: np.ndarray, power: np.ndarray, rate: float = RATE_HZ) -> Fringes:
    """Return the image of power in windows of half a second that overlap by half."""
    n, window = power.shape[0], round(0.5 * rate)
    frames = Frames(
        start_sample=np.arange(n) * (window // 2), time_s=(np.arange(n) + 1.0) * 0.25,
        valid_fraction=np.ones(n), band_low_hz=np.zeros(0), band_high_hz=np.zeros(0),
        noise_db=np.zeros((n, 0)), threshold_db=np.full(n, np.nan), sensor="h1",
        sample_rate_hz=rate, window_samples=window, hop_samples=window // 2,
        fft_length=window,
    )  # fmt: skip
    block = Spectrogram(
        frames=frames, frequency_hz=frequency, power_density=power, reference="full scale"
    )
    return Fringes.join(list(measure_fringes(iter([block]))))


def _line(
    rng: np.random.Generator, source: Source, sea: np.ndarray, line_db: float,
    rate: float, sensor_m: float,
) -> np.ndarray:  # fmt: skip
    """Return a steady line, so many dB over the noise in 1 Hz at the closest approach."""
    rest_hz = float(rng.uniform(60.0, 400.0))
    spectrum = np.abs(np.fft.rfft(sea[: int(60 * rate)])) ** 2
    frequency = np.fft.rfftfreq(int(60 * rate), 1 / rate)
    about = np.abs(frequency - rest_hz) < 20.0
    density = 2.0 * spectrum[about].mean() / (60 * rate * rate)
    time = np.arange(sea.size) / rate
    emitted = np.arange(-LEAD_S, time[-1] + LEAD_S, 0.05)
    flat = np.hypot(source.flat_m, source.speed_mps * (emitted - source.time_s))
    slant = np.hypot(flat, sensor_m - source.depth_m)
    begun = np.interp(time, emitted + slant / SOUND_MPS, emitted)
    level = np.sqrt(2 * density * 10.0 ** (line_db / 10.0)) * slant.min()
    gain = level / np.interp(begun, emitted, slant)
    return gain * np.cos(2 * np.pi * (rest_hz * begun + rng.random()))
