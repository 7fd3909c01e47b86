"""Sound that two recorders of one clock hear with a delay, and the bound of the delay.

`python -m tests.draws.recorder_delays SEED COUNT` prints, for some ratios of signal and
noise, the root mean square error of `delays` over the bound of Knapp and Carter (1976), and
over the stated deviation, over COUNT pairs of recordings each.
"""

import sys

import numpy as np

from uwtrack_cli.arrays.delays import measure_delays
from uwtrack_cli.arrays.recorders import join_recorders
from uwtrack_cli.data.recording import HeldSamples, Recording
from uwtrack_cli.data.sensor import Sensor

RATE_HZ, BAND_HZ, WINDOW_S, DURATION_S = 4000.0, (200.0, 1000.0), 4.0, 24.0
START_NS = 1_700_000_000_000_000_000


def recorders(seed, snr_db, *, distance_m=600.0, clock_std_s=1e-3):
    """Return two recordings and the delay of the second, s.

    The clocks differ as drawn, and so do the times at which the recorders begin.
    """
    draw = np.random.default_rng(seed)
    count = int(DURATION_S * RATE_HZ)
    clock_s = draw.normal(0.0, clock_std_s)
    delay_s = draw.uniform(-0.95, 0.95) * distance_m / 1500.0
    late_s = draw.uniform(0.0, 0.5)  # of the second recorder's begin
    padded = count + 4 * int(RATE_HZ)
    spectrum = np.fft.rfft(draw.standard_normal(padded))
    frequency = np.fft.rfftfreq(padded, 1.0 / RATE_HZ)
    spectrum[(frequency < BAND_HZ[0]) | (frequency > BAND_HZ[1])] = 0.0
    amplitude = 10.0 ** (snr_db / 20.0)
    found = []
    for name, shift_s, east in (("r1", 0.0, 0.0), ("r2", delay_s + clock_s - late_s, distance_m)):
        moved = np.fft.irfft(spectrum * np.exp(-2j * np.pi * frequency * shift_s), padded)
        sound = amplitude * moved[2 * int(RATE_HZ) :][:count]
        sound = 0.01 * (sound + draw.standard_normal(count))
        start_ns = START_NS + (round(late_s * 1e9) if name == "r2" else 0)
        found.append(
            Recording(
                sensor=Sensor(id=name, east_m=east, north_m=0.0, clock_std_s=clock_std_s),
                name=f"{name}.wav",
                sample_rate_hz=RATE_HZ,
                n_samples=count,
                n_channels=1,
                start_utc_ns=start_ns,
                reader=HeldSamples(sound.astype(np.float32)[:, np.newaxis]),
            )
        )
    return found, delay_s + clock_s


def bound_s(snr_db):
    """Return the least deviation of a delay of one window (Knapp and Carter 1976), s."""
    snr = 10.0 ** (snr_db / 10.0)
    coherence2 = (snr / (1.0 + snr)) ** 2
    low, high = BAND_HZ
    wave2 = (2.0 * np.pi) ** 2 * (high**3 - low**3) / 3.0
    return 1.0 / np.sqrt(2.0 * WINDOW_S * wave2 * coherence2 / (1.0 - coherence2))


def errors(seed, snr_db):
    """Return errors and stated deviations of all delays of a pair of recorders, s."""
    pair, delay_s = recorders(seed, snr_db)
    blocks = list(
        measure_delays(join_recorders(pair), window_s=WINDOW_S, overlap=0.5, band_hz=BAND_HZ)
    )
    off = np.concatenate([block.delay_s for block in blocks]) - delay_s
    return off, np.concatenate([block.delay_std_s for block in blocks])


if __name__ == "__main__":
    first, count = map(int, sys.argv[1:3])
    for snr_db in (10.0, 0.0, -6.0, -10.0):
        found = [errors(first + n, snr_db) for n in range(count)]
        off, std = (np.concatenate(part) for part in zip(*found, strict=True))
        rms = np.sqrt(np.mean(off**2))
        held = np.mean(np.abs(off) < 1.96 * std)
        print(  # noqa: T201
            f"{snr_db:g} dB: {off.size} delays, rms {1e6 * rms:.1f} us, over the bound "
            f"{rms / bound_s(snr_db):.2f}, over its deviation "
            f"{np.sqrt(np.mean((off / std) ** 2)):.2f}, within 1.96: {held:.3f}"
        )
