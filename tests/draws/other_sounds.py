"""Sound without a passage, of a generator that shares nothing with the program's.

Every closest approach that is found in these recordings is false. Kinds of sound are
mixed by lot, one to three in each recording of two to five minutes.
"""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from tests.draws.vehicle_sounds import coloured, wander


def cycles(frequency_hz, rate):
    """Return the phase of a tone in cycles."""
    return np.cumsum(frequency_hz) / rate


def tones(turns, numbers, gains, rng):
    """Sum multiples of a phase, with phases by lot."""
    return sum(
        gain * np.cos(2 * np.pi * (number * turns + rng.random()))
        for number, gain in zip(numbers, gains, strict=True)
    )


def hump_db(rng, time_s):
    """Draw a rise and fall of the level whose flanks differ, dB."""
    span = time_s[-1]
    middle, flank = rng.uniform(0.2, 0.8) * span, rng.uniform(10, 0.35 * span, 2)
    lag = time_s - middle
    return rng.uniform(6, 20) * np.exp(-((lag / flank[(lag > 0).astype(int)]) ** 2))


def swept(rng, time_s, rate, count, seconds, gains, law):
    """Sum calls whose frequency follows a law of the time within them, 0 to 1."""
    sound = np.zeros(time_s.size)
    for _ in range(rng.integers(*count)):
        size = int(rng.uniform(*seconds) * rate)
        first = rng.integers(0, time_s.size - size)
        call = np.cos(2 * np.pi * cycles(law(np.linspace(0, 1, size)), rate))
        sound[first : first + size] += rng.uniform(*gains) * np.hanning(size) * call
    return sound


def rain(rng, time_s, rate):
    """Draw rain: white sound above some hundred hertz that rises and falls."""
    white = coloured(rng, time_s.size, rate, 0, rng.uniform(300, 900), 0.48 * rate)
    return 0.2 * np.sqrt(10 ** (hump_db(rng, time_s) / 10) - 1) * white


def rumble(rng, time_s, rate):
    """Draw an aircraft far off: low sound that rises and falls."""
    low = coloured(rng, time_s.size, rate, -2, 30, rng.uniform(150, 500))
    return 0.4 * np.sqrt(10 ** (hump_db(rng, time_s) / 10) - 1) * low


def whales(rng, time_s, rate):
    """Draw calls that rise, fall, bend or drop as the lines of a passage do."""
    laws = (
        lambda x: 1 + 0.7 * x, lambda x: 1 - 0.4 * x,
        lambda x: 1 + 0.2 * np.sin(np.pi * x), lambda x: 1 - 0.15 * np.tanh(6 * x - 3),
    )  # fmt: skip

    def law(x):
        return rng.uniform(60, 250) * laws[rng.integers(len(laws))](x)

    return swept(rng, time_s, rate, (4, 25), (0.6, 3), (0.1, 1), law)


def whistles(rng, time_s, rate):
    """Draw whistles of dolphins."""
    top = min(0.42 * rate, 9000.0)

    def law(x):
        wave = rng.uniform(0, 0.15) * np.sin(2 * np.pi * rng.uniform(1, 3) * x)
        frequency = rng.uniform(0.4, 0.8) * top * (1 + rng.uniform(-0.3, 0.2) * x + wave)
        return np.minimum(frequency, top)

    return swept(rng, time_s, rate, (10, 50), (0.3, 1.5), (0.05, 0.5), law)


def sonar(rng, time_s, rate):
    """Draw pings with echoes."""
    size, frequency = int(rng.uniform(0.05, 0.6) * rate), rng.uniform(800, 0.4 * rate)
    law = frequency * (1 + rng.uniform(0, 0.1) * np.linspace(0, 1, size))
    ping = np.cos(2 * np.pi * cycles(law, rate)) * np.hanning(size)
    sound = np.zeros(time_s.size)
    for first_s in np.arange(rng.uniform(0, 2), time_s[-1] - 3, rng.uniform(1.5, 12)):
        for delay_s, gain in zip((0, *rng.uniform(0.05, 1.2, 4)), (0.8, *[0.12] * 4), strict=True):
            first = int((first_s + delay_s) * rate)
            sound[first : first + size] += gain * ping
    return sound


def chain(rng, time_s, rate):
    """Draw the clank of a mooring: hits of some modes, in bouts."""
    modes, tail_s = rng.uniform(300, 0.4 * rate, 5), np.arange(int(0.3 * rate)) / rate
    sound = np.zeros(time_s.size)
    for _ in range(rng.integers(3, 8)):
        at_s, pause_s = rng.uniform(0, time_s[-1] - 8), 1 / rng.uniform(1, 9)
        stop_s = min(at_s + rng.uniform(3, 25), time_s[-1] - 0.5)
        while at_s < stop_s:
            decay = np.exp(-tail_s[:, None] / rng.uniform(0.01, 0.08, 5))
            hit = (decay * np.sin(2 * np.pi * modes * tail_s[:, None])).sum(axis=1)
            first = int(at_s * rate)
            sound[first : first + hit.size] += rng.uniform(0.1, 0.6) * hit
            at_s += rng.exponential(pause_s)
    return sound


def machine(rng, time_s, rate):
    """Draw machinery that stays: its speed wanders and steps, its level swells."""
    size = time_s.size
    dev = rng.uniform(2e-4, 3e-3) * smooth(rng, size, rate, rng.uniform(5, 40))
    for _ in range(rng.integers(0, 3)):
        at = (time_s - rng.uniform(0.1, 0.9) * time_s[-1]) / rng.uniform(0.3, 8)
        dev += rng.choice([-1, 1]) * rng.uniform(0.003, 0.06) * 0.5 * (1 + np.tanh(at))
    level_db = 4 * smooth(rng, size, rate, rng.uniform(8, 50))
    level_db += rng.integers(0, 2) * 0.5 * hump_db(rng, time_s)
    first_hz = rng.uniform(8, 60)
    numbers = rng.choice(np.arange(1, 30), rng.integers(3, 10), replace=False)
    numbers = numbers[numbers * first_hz * 1.1 < 0.45 * rate]
    gains = rng.uniform(0.02, 0.25, numbers.size)
    lines = tones(cycles(first_hz * (1 + dev), rate), numbers, gains, rng)
    return 10 ** (level_db / 20) * lines


def idling(rng, time_s, rate):
    """Draw a boat that stays, with bursts of throttle and cavitation."""
    push = np.zeros(time_s.size)
    for _ in range(rng.integers(2, 8)):
        up, hold, down = rng.uniform((0.4, 0, 0.6), (6, 12, 8))
        lag = time_s - rng.uniform(0, time_s[-1])
        burst = (1 + np.tanh(lag / up)) * (1 - np.tanh((lag - hold - up - down) / down))
        push = np.maximum(push, rng.uniform(0.1, 1.2) * 0.25 * burst)
    jitter = 1 + 0.002 * wander(rng, time_s.size, rate, 1.0)
    turns = cycles(rng.uniform(10, 25) * (1 + push) * jitter, rate)
    gain = 10 ** (18 * push / 20)
    numbers = np.array([1, 2, 3, 4, 6, 8, 12, 16, 24])
    lines = gain * tones(turns, numbers, rng.uniform(0.01, 0.15, numbers.size), rng)
    hiss = coloured(rng, time_s.size, rate, 0, 200, 0.4 * rate)
    return lines + 0.15 * (gain - 1) * hiss * (1 + 0.5 * np.cos(2 * np.pi * turns))


def tidal(rng, time_s, rate):
    """Draw flow noise that comes and goes, and a mooring that strums with it."""
    flow = 10 ** (0.25 * smooth(rng, time_s.size, rate, rng.uniform(30, 120)))
    jitter = 1 + 0.004 * wander(rng, time_s.size, rate, 1.0)
    strum = tones(cycles(rng.uniform(20, 90) * flow**0.3 * jitter, rate), [1], [1], rng)
    low = coloured(rng, time_s.size, rate, -9, 8, 0.4 * rate)
    return 0.8 * flow * low + rng.uniform(0, 0.2) * flow * strum


def hum(rng, time_s, rate):
    """Draw mains whose frequency wanders, with steps of the load."""
    wave = np.sin(2 * np.pi * (time_s / rng.uniform(60, 200) + rng.random()))
    turns = cycles(rng.choice([50.0, 60.0]) * (1 + 2e-4 * wave), rate)
    gain_db = np.zeros(time_s.size)
    for _ in range(rng.integers(1, 6)):
        gain_db[time_s > rng.uniform(0, time_s[-1])] += rng.uniform(-8, 8)
    numbers = np.flatnonzero(rng.random(20) < 0.6) + 1
    gains = rng.uniform(0.02, 0.2, numbers.size) / np.sqrt(numbers)
    return 10 ** (gain_db / 20) * tones(turns, numbers, gains, rng)


def far_ship(rng, time_s, rate):
    """Draw a ship far away that turns and changes its speed, and fades."""
    size, span_s = time_s.size, time_s[-1]

    def step(width_s):
        lag = time_s - rng.uniform(0.2, 0.8) * span_s
        return 0.5 * (1 + np.tanh(lag / rng.uniform(*width_s)))

    first, second = rng.uniform(3, 10) * rng.uniform(-1, 1, 2)
    closing_mps = first + (second - first) * step((10, 60))
    speed = 1 + rng.integers(0, 2) * rng.uniform(-0.1, 0.1) * step((2, 20))
    turns = cycles(rng.uniform(5, 12) * speed * (1 - closing_mps / 1500), rate)
    numbers = rng.choice(np.arange(2, 40), 8, replace=False)
    gains = [
        rng.uniform(0.02, 0.2) * 10 ** (0.2 * smooth(rng, size, rate, rng.uniform(15, 60)))
        for _ in numbers
    ]
    low = coloured(rng, size, rate, 0, 40, 400) * (1 + 0.4 * np.cos(8 * np.pi * turns))
    low *= 10 ** (0.2 * smooth(rng, size, rate, 30))
    return tones(turns, numbers, gains, rng) + 0.3 * low


def smooth(rng, size, rate, time_s):
    """Draw what wanders as a mass does, without a kink, of unit variance, shape (size,)."""
    step_s = time_s / 10
    knots = int(size / rate / step_s) + 22
    wave = gaussian_filter1d(rng.standard_normal(knots), 5.0)[10:-10]
    wave /= np.sqrt(1 / (2 * np.sqrt(np.pi) * 5.0))
    return np.interp(np.arange(size) / rate, np.arange(wave.size) * step_s, wave)


KINDS = (rain, rumble, whales, whistles, sonar, chain, machine, idling, tidal, hum, far_ship)


def draw(seed):
    """Return rate, sound and the kinds in it: the first in turn, the others by lot."""
    rng = np.random.default_rng(seed)
    rate = int(rng.choice([4000, 8000, 16000], p=[0.4, 0.4, 0.2]))
    time_s = np.arange(int(rng.uniform(120, 300) * rate)) / rate
    more = rng.choice(len(KINDS), rng.integers(0, 3), replace=False)
    chosen = dict.fromkeys([seed % len(KINDS), *more.tolist()])
    ambient = coloured(rng, time_s.size, rate, rng.uniform(-7, -1), 10, 0.48 * rate)
    drift_db = rng.uniform(0, 4) * smooth(rng, time_s.size, rate, rng.uniform(20, 60))
    sound = 10 ** (drift_db / 20) * ambient
    for number in chosen:
        sound += KINDS[number](rng, time_s, rate)
    return rate, 0.9 * sound / np.abs(sound).max(), [KINDS[n].__name__ for n in chosen]
