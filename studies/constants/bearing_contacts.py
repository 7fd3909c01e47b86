"""Where the constants of a line array's broadband contacts come from: drawn records.

Draws bearing-time records with and without vessels and prints

* how many directions noise alone has in an average at each height (`SURE_DEVIATIONS`:
  the first at which it has fewer than one in ten thousand);
* which share of drawn vessels, alone and in pairs whose cones cross, is followed as one
  contact from end to end with each density of acceleration (`ACCELERATION_DENSITY`);
* how far bearings of averages in which the array turns are off, and how many are told,
  with each turn that is let in (`TURNING_DEG`);
* what a line in one of so many cells lifts its beam by, and how the scatter of noise
  changes, with each share at which a cell counts no more (`LINE_SHARE` of beamforming).

The second number is the first seed: python -m studies.constants.bearing_contacts 20 5000
"""

import sys
from collections.abc import Iterator

import numpy as np

import uwtrack_cli.arrays.track_bearings as stage
from tests.arrays.test_track_bearings import drawn, turned
from uwtrack_cli.data.base import FloatArray
from uwtrack_cli.data.series import Series

HEIGHTS = (2.0, 3.0, 4.0, 5.0, 6.0)
DENSITIES = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2)
TURNS_DEG = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
SHARES = (2.0, 3.0, 4.0, 6.0, 10.0, 1e9)
"""What is tried."""

NAMES = ("SURE_DEVIATIONS", "ACCELERATION_DENSITY", "TURNING_DEG", "FEWEST_POINTS", "HEARD_SHARE")
USUAL = {name: getattr(stage, name) for name in NAMES}
"""Constants as they are."""

N_FRAMES, N_AVERAGES = 600, 60
"""Length of a record, s, and its averages of 10 s."""

SPEED_MPS, RANGE_M = (2.0, 10.0), (300.0, 6000.0)
"""Ranges of speed and of closest approach of the drawn vessels."""

HEIGHT, N_CELLS, LINE_DB = (0.1, 0.4), 200, (10.0, 20.0, 30.0)
"""How far a vessel stands out of the noise, cells of a beam, and power of a line over
the noise of its cell."""


def set_constants(**changed: float) -> None:
    """Set some constants of the stage, and all others to what they are."""
    for name, value in (USUAL | changed).items():
        setattr(stage, name, value)


def vessel(rng: np.random.Generator) -> FloatArray:
    """Return the compass bearings of a vessel that goes straight past own ship."""
    speed = np.exp(rng.uniform(*np.log(SPEED_MPS)))
    width = np.exp(rng.uniform(*np.log(RANGE_M))) / speed
    lag = np.arange(N_FRAMES) - rng.uniform(0.0, N_FRAMES)
    turn = np.degrees(np.arctan(lag / width)) * rng.choice([-1.0, 1.0])
    return np.asarray(rng.uniform(60.0, 120.0) + turn)


def contacts(truths: list[FloatArray], heading: FloatArray, seed: int) -> Series:
    """Return the contacts of vessels on the starboard side."""
    rng = np.random.default_rng([seed, 3])
    heights = tuple(rng.uniform(*HEIGHT, size=len(truths)))
    return stage.track_bearings(drawn(truths, heading, seed, heights=heights))


def cone_deg(truth: FloatArray, heading: FloatArray) -> FloatArray:
    """Return the angle from ahead."""
    return np.asarray(np.abs((truth - heading + 180.0) % 360.0 - 180.0))


def false_directions(height: float, count: int, seed: int) -> float:
    """Return the directions of noise in an average at some height."""
    set_constants(SURE_DEVIATIONS=height, FEWEST_POINTS=1, HEARD_SHARE=0.0)
    still = np.zeros(N_FRAMES)
    found = sum(contacts([], still, seed + k).time_s.size for k in range(count))
    return found / (count * N_AVERAGES)


def is_followed(truths: list[FloatArray], seed: int) -> Iterator[bool]:
    """Tell of each vessel whether one contact has nine tenths of its directions."""
    still = np.zeros(N_FRAMES)
    found = contacts(truths, still, seed)
    at = np.searchsorted(np.arange(N_FRAMES), found.time_s).clip(0, N_FRAMES - 1)
    cones = [cone_deg(truth, still) for truth in truths]
    own = np.argmin([abs(found.bearing_deg - cone[at]) for cone in cones], axis=0)
    for number, cone in enumerate(cones):
        # ahead and astern beams are wide: there contacts are not told apart
        heard = (own == number) & (cone[at] > 30.0) & (cone[at] < 150.0)
        names = found.contact[heard]
        most = np.bincount(names).max(initial=0) if names.size else 0
        yield bool(most >= 0.9 * names.size and names.size >= stage.FEWEST_POINTS)


def turning(limit_deg: float, count: int, seed: int) -> tuple[float, float, int]:
    """Return the scatter and the share beyond 1.96 of bearings in turns, and how many."""
    set_constants(TURNING_DEG=limit_deg)
    off = []
    for k in range(count):
        rng = np.random.default_rng([seed + k, 4])
        heading = turned(N_FRAMES, rng.uniform(10.0, 90.0))
        truth = vessel(rng)
        found = contacts([truth], heading, seed + k)
        rows = found.time_s.astype(int).clip(5, N_FRAMES - 6)
        moved = abs(heading[rows + 5] - heading[rows - 5])
        written = heading[rows] + cone_deg(truth, heading)[rows]
        error = (found.bearing_deg - written + 180.0) % 360.0 - 180.0
        off.append((error / found.bearing_std_deg)[moved > 0.25])
    every = np.concatenate(off)
    if not every.size:
        return float("nan"), float("nan"), 0
    return (float(1.4826 * np.median(abs(every))), float((abs(every) > 1.96).mean()), every.size)


def lifted(share: float, seed: int) -> tuple[float, list[float]]:
    """Return the scatter of noise over that of its mean, and lifts by lines, dB."""
    rng = np.random.default_rng(seed)
    noise = rng.exponential(size=(4000, N_CELLS))

    def mean(power: FloatArray) -> FloatArray:
        value = power.mean(axis=1, keepdims=True)
        for _ in range(2):
            value = np.minimum(power, share * value).mean(axis=1, keepdims=True)
        return np.asarray(value[:, 0] / (1.0 - np.exp(-share)))

    alone = mean(noise)
    lifts = []
    for line_db in LINE_DB:
        power = noise.copy()
        power[:, 0] += 10 ** (line_db / 10.0)
        lifts.append(float(10 * np.log10(mean(power).mean() / alone.mean())))
    return float(alone.std() / alone.mean() * np.sqrt(N_CELLS)), lifts


def main(count: int, seed: int) -> None:
    """Print a line for each value that is tried."""
    for height in HEIGHTS:
        rate = false_directions(height, 10 * count, seed)
        print(f"height {height:g}: {rate:.5f} directions of noise in an average")
    for density in DENSITIES:
        set_constants(ACCELERATION_DENSITY=density)
        alone, pairs = list[bool](), list[bool]()
        for k in range(count):
            rng = np.random.default_rng([seed + k, 5])
            truths = [vessel(rng), vessel(rng)]
            alone += is_followed(truths[:1], seed + k)
            pairs += is_followed(truths, seed + k)
        print(
            f"density {density:g}: {np.mean(alone):.0%} of {len(alone)} alone and "
            f"{np.mean(pairs):.0%} of {len(pairs)} in pairs are one contact"
        )
    for limit in TURNS_DEG:
        scatter, beyond, size = turning(limit, count, seed)
        print(
            f"turns to {limit:g} degrees: {size} bearings, median error {scatter:.2f} "
            f"of what is due, {beyond:.0%} beyond 1.96 deviations"
        )
    for share in SHARES:
        scatter, lifts = lifted(share, seed)
        words = ", ".join(
            f"{lift:.2f} dB by a line of {line:g} dB"
            for lift, line in zip(lifts, LINE_DB, strict=True)
        )
        print(f"share {share:g}: scatter {scatter:.3f} of that of noise; {words}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
