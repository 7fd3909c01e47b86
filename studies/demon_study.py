"""What `demon` hears: shafts and blades under the ambient noise, and rates in noise.

**Method.** A cavitating vessel whose blades turn at 9.6 Hz on a shaft of 2.4 Hz sounds
between 400 and 1800 Hz, once 9 dB under white ambient noise in that band with 30 %
modulation, once 6 dB under it with 15 %. The sound goes through `demodulate`, `trace` and
`rate_families` as the shipped recipes have them. The same is asked of noises without a
vessel: white, swell of 6 dB, log-normal gusts, drift of 8 dB, snaps, knocks, 6 dB an
octave, a bump of 15 dB, a notch of 20 dB, mains with harmonics, and two tones that beat.
The sound is drawn here, by formulas of its own.

**Conventions.** Modulation is that of the amplitude: 1 + d (cos b + cos(2 b) / 2 + cos(s) / 2)
with blade phase b and shaft phase s. Rates count from 0.5 Hz.

**References.** None gives figures for this chain; the ratios and depths are those at
which it is to work.
"""

from collections.abc import Callable, Iterator

import numpy as np

from studies.rows import rate_row, share_row
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.recording import Recording, Samples
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.study import Study, StudyRow
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.presence.line_summary import LineSummary, summarise
from uwtrack_cli.presence.presence import LOWEST_RATE_HZ, rate_families

RATE_HZ = 4000.0
"""Sample rate, Hz."""

BLADE_HZ, SHAFT_HZ = 9.6, 2.4
"""Rates of the vessel, Hz."""

BAND_HZ = (400.0, 1800.0)
"""Band of its cavitation, Hz."""

SCENES = ((-9.0, 0.3), (-6.0, 0.15))
"""Power over the ambient in the band, dB, and depth of the modulation."""

SCENE_S, NOISE_S = 300.0, 1200.0
"""Length of a scene and of a noise, s."""

SHAFT_BAND_HZ = 0.02
"""Error of the shaft rate that is allowed, Hz."""


def study_demon(runs: int = 20, seed: int = 1) -> Study:
    """Shafts and blades under the ambient noise, and false rates in noise alone.

    ``runs``: recordings of each kind.
    """
    rows: list[StudyRow] = []
    for snr_db, depth in SCENES:
        case = f"{snr_db:g} dB, {depth:.0%}"
        found = np.array([_one_scene(snr_db, depth, (seed, k)) for k in range(runs)])
        for number, name in enumerate(("blade rate", "one family", "shaft in 0.02 Hz")):
            row = share_row(case, f"found: {name}, %", None, found[:, number] > 0.5, percent=True)
            rows.append(row)
    for kind, noise in NOISES.items():
        count = sum(_rates(noise(np.random.default_rng((seed, 50, k)))) for k in range(runs))
        hours = runs * NOISE_S / 3600.0
        rows.append(rate_row(kind, "false rates, 1/h", None, count, hours))
    remark = (
        f"scenes of {SCENE_S:g} s and noises of {NOISE_S:g} s each, at {RATE_HZ:g} Hz; "
        "no publication has figures for this chain"
    )
    return Study("demon", "no published figures", runs, seed, tuple(rows), (remark,))


def _one_scene(snr_db: float, depth: float, seed: tuple[int, int]) -> list[bool]:
    generator = np.random.default_rng(seed)
    lines = _heard(cavitation(generator, snr_db, depth))
    near = np.abs(lines.frequency_hz - BLADE_HZ) < 0.05
    families = rate_families(
        lines.frequency_hz, lines.frequency_std_hz, lines.level_db, lines.resolution_hz
    )
    of_blades = [f for f in families if near[f.rows].any()]
    is_family = any((np.abs(lines.frequency_hz[f.rows] - SHAFT_HZ) < 0.1).any() for f in of_blades)
    is_shaft = any(abs(f.shaft_hz - SHAFT_HZ) < SHAFT_BAND_HZ for f in of_blades)
    return [bool(near.any()), is_family, is_shaft]


def cavitation(generator: np.random.Generator, snr_db: float, depth: float) -> FloatArray:
    """Return a cavitating vessel in white ambient noise of unit variance.

    ``snr_db``: power over the ambient noise in the band, dB. ``depth``: modulation of
    the amplitude at the blade rate.
    """
    n = round(SCENE_S * RATE_HZ)
    turns = np.arange(n) / RATE_HZ * SHAFT_HZ
    phases = generator.random(3)
    envelope = 1.0 + depth * (
        np.cos(2 * np.pi * (BLADE_HZ / SHAFT_HZ * turns + phases[0]))
        + 0.5 * np.cos(2 * np.pi * (2 * BLADE_HZ / SHAFT_HZ * turns + phases[1]))
        + 0.5 * np.cos(2 * np.pi * (turns + phases[2]))
    )
    hiss = _band_limited(generator.standard_normal(n), *BAND_HZ)
    hiss *= envelope / np.sqrt(np.mean(envelope**2))
    ambient = generator.standard_normal(n)
    return ambient + 10 ** (snr_db / 20) * hiss


def _band_limited(white: FloatArray, low_hz: float, high_hz: float) -> FloatArray:
    spectrum = np.fft.rfft(white)
    frequency = np.fft.rfftfreq(white.size, 1.0 / RATE_HZ)
    spectrum[(frequency < low_hz) | (frequency > high_hz)] = 0.0
    limited: FloatArray = np.fft.irfft(spectrum, white.size)
    return limited


def _heard(sound: FloatArray) -> LineSummary:
    """Send sound through the steps of the shipped recipe; return its rates."""
    samples = np.asarray(0.05 * sound, np.float32)[:, None]

    def read(block: int) -> Iterator[Samples]:
        for start in range(0, len(samples), block):
            yield samples[start : start + block]

    recording = Recording(
        sensor=Sensor(id="h1"), name="drawn", sample_rate_hz=RATE_HZ,
        n_samples=len(samples), n_channels=1, reader=read,
    )  # fmt: skip
    steps = {step.name: step for step in load_recipe("presence").steps}
    demon, rates = steps["demon"], steps["rates"]
    blocks = demon.stage.function(recording, **demon.options)
    return summarise(Lines.join(list(rates.stage.function(blocks, **rates.options))))


def _rates(sound: FloatArray) -> int:
    return int(np.count_nonzero(_heard(sound).frequency_hz >= LOWEST_RATE_HZ))


def _time() -> FloatArray:
    return np.arange(round(NOISE_S * RATE_HZ)) / RATE_HZ


def _white(generator: np.random.Generator) -> FloatArray:
    return generator.standard_normal(_time().size)


def _swell(generator: np.random.Generator) -> FloatArray:
    level_db = 6.0 * np.sin(2 * np.pi * (0.11 * _time() + generator.random()))
    swelling: FloatArray = _white(generator) * 10 ** (level_db / 20)
    return swelling


def _gusts(generator: np.random.Generator) -> FloatArray:
    knots = np.arange(0.0, NOISE_S + 3.0, 3.0)
    level_db = np.interp(_time(), knots, 10.0 * generator.standard_normal(knots.size))
    rumble = _band_limited(_white(generator), 0.0, 200.0)
    return _white(generator) + 10 ** (level_db / 20) * rumble


def _drift(generator: np.random.Generator) -> FloatArray:
    knots = np.arange(0.0, NOISE_S + 60.0, 60.0)
    course = np.tanh(np.cumsum(0.4 * generator.standard_normal(knots.size)))
    return _white(generator) * 10 ** (8.0 * np.interp(_time(), knots, course) / 20)


def _snaps(generator: np.random.Generator) -> FloatArray:
    sound = _white(generator)
    count = generator.poisson(20.0 * NOISE_S)
    begin = generator.integers(0, sound.size - 8, count)
    peak = 8.0 * 10 ** (6.0 * generator.standard_normal(count) / 20)
    for sample in range(6):
        np.add.at(sound, begin + sample, peak * generator.standard_normal(count))
    return sound


def _knocks(generator: np.random.Generator) -> FloatArray:
    sound = _white(generator)
    ring = np.arange(round(0.2 * RATE_HZ)) / RATE_HZ
    count = generator.poisson(NOISE_S / 6.0)
    for begin in generator.integers(0, sound.size - ring.size, count):
        peak = 30.0 * 10 ** (3.0 * generator.standard_normal() / 20)
        tone = np.sin(2 * np.pi * generator.uniform(100.0, 800.0) * ring)
        sound[begin : begin + ring.size] += peak * np.exp(-ring / 0.05) * tone
    return sound


def _shaped(generator: np.random.Generator, gain_db: FloatArray) -> FloatArray:
    spectrum = np.fft.rfft(_white(generator)) * 10 ** (gain_db / 20)
    shaped: FloatArray = np.fft.irfft(spectrum, _time().size)
    return shaped


def _frequencies() -> FloatArray:
    frequency: FloatArray = np.fft.rfftfreq(_time().size, 1.0 / RATE_HZ)
    return frequency


def _falling(generator: np.random.Generator) -> FloatArray:
    return _shaped(generator, -20.0 * np.log10(np.maximum(_frequencies(), 20.0)))


def _hill(height_db: float, width_hz: float) -> FloatArray:
    centre_hz = 0.5 * sum(BAND_HZ)
    off = (_frequencies() - centre_hz) / width_hz
    hill: FloatArray = height_db * np.exp(-0.5 * off**2)
    return hill


def _bump(generator: np.random.Generator) -> FloatArray:
    return _shaped(generator, _hill(15.0, 30.0))


def _notch(generator: np.random.Generator) -> FloatArray:
    return _shaped(generator, _hill(-20.0, 40.0))


def _mains(generator: np.random.Generator) -> FloatArray:
    turns = 2 * np.pi * 50.0 * _time()
    sound = _white(generator)
    for k in range(1, 31):
        sound += 0.3 / k * np.sin(k * turns + 2 * np.pi * generator.random())
    return sound


def _beat(generator: np.random.Generator) -> FloatArray:
    phase = 2 * np.pi * _time()
    tones: FloatArray = np.cos(450.0 * phase) + np.cos(457.3 * phase)
    return _white(generator) + 0.2 * tones


NOISES: dict[str, Callable[[np.random.Generator], FloatArray]] = {
    "white noise": _white,
    "swell 6 dB": _swell,
    "gusts below 200 Hz": _gusts,
    "drift 8 dB": _drift,
    "snaps": _snaps,
    "knocks": _knocks,
    "6 dB an octave": _falling,
    "bump 15 dB": _bump,
    "notch 20 dB": _notch,
    "mains 50 Hz": _mains,
    "two tones that beat": _beat,
}
"""Sound without a vessel."""
