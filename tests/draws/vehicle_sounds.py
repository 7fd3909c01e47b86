"""Sounds of vehicles that pass a microphone, drawn by formulas of their own.

Nothing is shared with the program's simulator: engine orders whose rate wanders by
0.2-1 %, fading, tyres, directivity, a reflecting ground, wind, hum of traffic, clipped
and 8-bit files; and ships that only stay.
"""

from typing import NamedTuple

import numpy as np
from scipy.io import wavfile

SOUND_MPS = 343.0
SPEEDS_MPS = {
    "car": (22, 45), "gear": (10, 25), "brake": (10, 32), "motorbike": (12, 45),
    "lorry": (12, 26), "two cars": (12, 35), "aircraft": (60, 130), "ship": (0, 0),
}  # fmt: skip
ENGINE_HZ = {"motorbike": (50, 160), "lorry": (18, 35), "aircraft": (60, 110)}


class Pass(NamedTuple):
    """Time (s), speed (m/s) and range (m) at the closest approach."""

    time_s: float
    speed_mps: float
    range_m: float


def wander(rng, n, rate, time_s):
    """Draw a smooth random walk about zero of unit variance, shape (n,)."""
    step = time_s / 8
    coarse = np.zeros(int(n / rate / step) + 3)
    coarse[0], keep = rng.standard_normal(), np.exp(-1 / 8)
    for k, push in enumerate(rng.standard_normal(coarse.size - 1)):
        coarse[k + 1] = keep * coarse[k] + np.sqrt(1 - keep**2) * push
    return np.interp(np.arange(n) / rate, np.arange(coarse.size) * step, coarse)


def coloured(rng, n, rate, slope_db, low_hz, high_hz):
    """Draw noise of unit variance with a slope in dB per octave between two edges."""
    frequency = np.maximum(np.fft.rfftfreq(n, 1 / rate), 1e-3)
    gain = frequency ** (slope_db / 6.02) / (1 + (low_hz / frequency) ** 4)
    gain[(frequency > high_hz) | (frequency < low_hz / 4)] = 0.0
    sound = np.fft.irfft(np.fft.rfft(rng.standard_normal(n)) * gain, n)
    return sound / sound.std()


def orders(rng, rate_hz, rate, numbers, gains, fade_db):
    """Sum the orders of an engine with a given rate (Hz, shape (n,)), each fading."""
    turns = np.cumsum(rate_hz) / rate
    sound = np.zeros(rate_hz.size)
    for number, gain in zip(numbers, gains, strict=True):
        fade = 10 ** (fade_db * wander(rng, turns.size, rate, 0.7) / 20)
        wave = np.cos(2 * np.pi * (number * turns + rng.random()))
        sound += gain * fade * wave * (number * rate_hz < 0.42 * rate)
    return sound / max(sound.std(), 1e-9)


def travelled(lag_s, speed_mps, change_mps2):
    """Return the way from the closest approach; speeds change within four seconds."""
    first, last = -4.0, 4.0
    if change_mps2:
        stop = (2.0 - speed_mps) / change_mps2
        first, last = (max(first, stop), 4.0) if stop < 0 else (-4.0, min(last, stop))
    inside = np.clip(lag_s, first, last)
    way = speed_mps * inside + 0.5 * change_mps2 * inside**2
    return way + (lag_s - inside) * (speed_mps + change_mps2 * inside)


def heard(time_s, place, sound, first_s, rate, gains_db):
    """Return what arrives: exact time of emission, range, direction, interpolation."""
    emitted = time_s.copy()
    for _ in range(60):
        emitted = time_s - np.linalg.norm(place(emitted), axis=0) / SOUND_MPS
    at = place(emitted)
    slant = np.linalg.norm(at, axis=0)
    cosine = at[0] / slant
    samples = (emitted - first_s) * rate
    whole = np.floor(samples).astype(int)
    out = np.zeros(time_s.size)
    for k in range(-11, 13):
        lag = samples - whole - k
        kernel = np.sinc(lag) * np.cos(np.pi * lag / 24) ** 2
        out += kernel * sound[np.clip(whole + k, 0, sound.size - 1)]
    return out / slant * 10 ** ((gains_db[0] * cosine + gains_db[1] * cosine**2) / 20)


def one_pass(rng, kind, closest_s, length_s, rate):
    """Return the sound of one vehicle, loudness one at the closest approach, and it."""
    speed = float(rng.uniform(*SPEEDS_MPS[kind]))
    change = rng.choice([-1, 1]) * rng.uniform(0.7, 4.0) if kind == "brake" else 0.0
    flies = kind == "aircraft"
    above = float(rng.uniform(0.8, 1.8))  # the microphone over the ground
    slant = float(np.exp(rng.uniform(*np.log((100, 600) if flies else (2.5, 20)))))
    height = slant * np.sin(rng.uniform(0.5, 1.57)) if flies else 0.4 - above
    aside = np.sqrt(max(slant**2 - height**2, 1.0))

    def place(emitted, height=height):
        way = travelled(emitted - closest_s, speed, change)
        return np.stack([way, 0 * way + aside, 0 * way + height])

    far = np.linalg.norm(place(np.array([-5.0, length_s + 1.0])), axis=0).max()
    first_s = -far / SOUND_MPS - 2.0
    n = int((length_s + 1.0 - first_s) * rate)
    lag = first_s + np.arange(n) / rate - closest_s
    jitter = rng.uniform(0.002, 0.01) * (0.2 if flies else 1.0)
    engine = 1 + jitter * wander(rng, n, rate, rng.uniform(0.5, 4.0))
    engine *= rng.uniform(*ENGINE_HZ.get(kind, (20, 60)))
    if kind == "brake":
        engine *= np.maximum(np.gradient(place(lag + closest_s)[0]) * rate / speed, 0.2)
    if kind == "gear":
        lag_of_gear = lag - rng.normal()
        ratio = rng.uniform(1.2, 1.4) ** rng.choice([-1, 1])
        engine *= ratio ** (0.5 + 0.5 * np.tanh(lag_of_gear / rng.uniform(0.1, 0.4)))
        engine *= 1 + rng.uniform(0, 0.25) * np.exp(-0.5 * (lag_of_gear / 0.35) ** 2)
    numbers = np.arange(1, rng.integers(6, 20)) * (1.0 if flies else rng.choice([0.5, 1]))
    gains = 10 ** (-numbers * rng.uniform(0.3, 2.0) / 20 + rng.normal(0, 0.25, numbers.size))
    tones_db = rng.uniform(0, 10) if kind in {"motorbike", "aircraft"} else rng.uniform(-10, 8)
    sound = 10 ** (tones_db / 20) * orders(rng, engine, rate, numbers, gains, rng.uniform(1, 4))
    sound += coloured(rng, n, rate, rng.uniform(-6, -1), 80, min(0.45 * rate, 8000))
    gains_db = rng.uniform(-3, 3), rng.uniform(-2.4, 2.4)
    time = np.arange(int(length_s * rate)) / rate
    mirrored = height + 2 * above if flies else -height - 2 * above
    out = heard(time, place, sound, first_s, rate, gains_db)
    out += rng.uniform(0, 0.9) * heard(
        time, lambda t: place(t, mirrored), sound, first_s, rate, gains_db
    )
    return out * slant / sound.std(), Pass(closest_s, speed, float(np.hypot(aside, height)))


def vehicles(rng, kind):
    """Draw a recording of 8-60 s: rate, sound and the passages in it."""
    rate, length_s = (int(rng.choice([8000, 11025, 16000, 22050, 48000])), rng.uniform(8, 45))
    closest = np.sort(rng.uniform(0.2, 0.8, 1 + (kind == "two cars"))) * length_s
    pairs = [one_pass(rng, kind, float(at), length_s, rate) for at in closest]
    quiet = surroundings(rng, pairs[0][0].size, rate)
    return rate, sum(one for one, _ in pairs) + quiet, [one for _, one in pairs]


def surroundings(rng, n, rate):
    """Draw ambient sound, wind and hum of traffic, 8 to 35 dB below a vehicle."""
    ambient = coloured(rng, n, rate, rng.uniform(-6, -2), 20, 0.48 * rate)
    if rng.random() < 0.5:  # wind
        gusts = 10 ** (rng.uniform(3, 10) * wander(rng, n, rate, 1.5) / 20)
        ambient += rng.uniform(0.3, 2.0) * gusts * coloured(rng, n, rate, -9, 10, 400)
    for _ in range(int(rng.integers(0, 4))):  # hum of traffic
        hum_hz = rng.uniform(40, 300) * (1 + 0.003 * wander(rng, n, rate, 3.0))
        ambient += rng.uniform(0.1, 0.5) * np.sin(2 * np.pi * np.cumsum(hum_hz) / rate)
    return 10 ** (-rng.uniform(8, 35) / 20) / ambient.std() * ambient


def standing(rng):
    """Draw 8-45 s of an engine in place that runs up, runs down and changes its load."""
    rate = int(rng.choice([8000, 16000, 22050]))
    n = int(rng.uniform(8, 45) * rate)
    time_s = np.arange(n) / rate
    changes = np.zeros(n)
    for _ in range(rng.integers(1, 4)):
        lag = (time_s - rng.uniform(0.1, 0.9) * time_s[-1]) / rng.uniform(0.1, 1.5)
        kind = rng.integers(3)
        bend = np.tanh(lag), np.exp(-0.5 * lag**2), lag / np.hypot(1.0, lag)
        changes += rng.choice([-1, 1]) * rng.uniform(0.02, 0.3) * bend[kind]
    jitter = rng.uniform(0.002, 0.01) * wander(rng, n, rate, rng.uniform(0.5, 4.0))
    engine_hz = rng.uniform(20, 80) * np.exp(changes + jitter)
    numbers = np.arange(1, rng.integers(6, 20)) * rng.choice([0.5, 1])
    gains = 10 ** (-numbers * rng.uniform(0.3, 2.0) / 20)
    sound = orders(rng, engine_hz, rate, numbers, gains, rng.uniform(1, 4))
    sound += 10 ** (rng.uniform(-8, 8) / 20) * coloured(rng, n, rate, -3, 80, 0.45 * rate)
    load_db = rng.uniform(0, 40) * changes + rng.uniform(0, 3) * wander(rng, n, rate, 2.0)
    return rate, sound * 10 ** (load_db / 20) + surroundings(rng, n, rate), []


def ship(rng):
    """Draw 5-8 minutes of 35 teeth 1.755 Hz apart, or fewer wider ones, in surf."""
    rate, spacing = int(rng.choice([4000, 8000, 16000])), 1.755
    if rng.random() < 0.5:
        spacing = float(np.exp(rng.uniform(*np.log((1.2, 9.0)))))
    n = int(rng.uniform(300, 480) * rate)
    shaft = spacing * (1 + rng.uniform(1e-4, 2e-3) * wander(rng, n, rate, rng.uniform(20, 120)))
    numbers = np.arange(35 if spacing < 4 else rng.integers(8, 30)) + rng.integers(1, 4)
    comb = orders(rng, shaft, rate, numbers, 10 ** rng.normal(0, 0.15, numbers.size), 2.0)
    surf = coloured(rng, n, rate, rng.uniform(-6, -3), 5, 0.48 * rate)
    surf *= 10 ** (rng.uniform(1, 4) * wander(rng, n, rate, 8.0) / 20)
    shrimp = np.where(rng.random(n) < 20 / rate, rng.exponential(3.0, n), 0.0)
    return rate, rng.uniform(0.3, 1.5) * comb + surf + shrimp, []


def recording_file(rng, kind, path):
    """Write a drawn recording, some clipped, of 8 bit or in stereo; its passages."""
    made = {"ship": ship, "standing": standing}.get(kind)
    rate, sound, truth = made(rng) if made else vehicles(rng, kind)
    loud = rng.uniform(1.2, 2.0) if rng.random() < 0.2 else rng.uniform(0.2, 0.95)
    scaled = np.clip(sound / np.abs(sound).max() * loud, -1, 1)
    if rng.random() < 0.3:
        scaled = np.stack([scaled, 0.9 * np.roll(scaled, 5)], axis=1)
    is_coarse = rng.random() < 0.2
    whole = np.round(scaled * 127 + 128).astype("u1")
    wavfile.write(path, rate, whole if is_coarse else np.round(scaled * 32767).astype("<i2"))
    return truth
