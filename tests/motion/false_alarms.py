"""How often noise is taken for a passage, and how weak a passage is found.

Prints tables in Markdown, in half an hour or more; its three numbers are measured noise,
recordings of noise, and passages of each strength:
python -m tests.motion.false_alarms 1000 100 12
"""

import sys
import warnings
from dataclasses import replace

import numpy as np
from scipy.stats import beta

from tests.motion.passage_truth import Scene
from tests.motion.passing_vessel import levels_of_scene, lines_of_scenes
from tests.motion.random_passages import DEPTH_M, LENGTH_S, RATE_HZ
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.flow.engine import run_recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.motion.cpa import find_encounters
from uwtrack_cli.simulate import make_scenario, simulate_recordings

DIFAR = Sensor(id="h1", kind="difar", depth_m=22.0)
STATED = (0.1, 0.03, 0.01, 0.001)
LENGTH = 300.0


def gauss_markov(rng, time_s, correlation_time_s):
    """Unit noise with an exponential correlation time, at one-second steps."""
    decay = np.exp(-1.0 / correlation_time_s)
    steps = np.sqrt(1 - decay**2) * rng.normal(size=time_s.size)
    steps[0] = rng.normal()
    for k in range(1, steps.size):
        steps[k] += decay * steps[k - 1]
    return steps


def _path(rng, time_s):
    """Fractional jitter of a machine: none, a random walk, or one that returns."""
    kind = rng.integers(3)
    if kind == 0:
        return np.zeros(time_s.size)
    fraction = 10 ** rng.uniform(-5, -3)
    if kind == 1:
        walk = np.cumsum(rng.normal(size=time_s.size))
        return fraction * walk / np.sqrt(time_s.size)
    return fraction * gauss_markov(rng, time_s, 10 ** rng.uniform(0.7, 2.5))


def still_recording(seed):
    """Draw the lines and levels of machines that stay where they are, in noise."""
    rng = np.random.default_rng(seed)
    scenes = [
        Scene(
            speed_mps=1e-6,
            rest_hz=tuple(rng.uniform(30, 300) * np.arange(1, rng.integers(2, 6))),
            length_s=LENGTH,
            closest_s=LENGTH / 2,
            bearing_deg=rng.uniform(0, 360),
        )
        for _ in range(rng.integers(1, 3))
    ]
    lines = lines_of_scenes(scenes, rng)
    time = np.unique(lines.time_s)
    contact = lines.line_contact[lines.line - 1]
    frequency, bearing = lines.measured_frequency_hz, lines.measured_bearing_deg
    for number in np.unique(contact):
        own = contact == number
        path = np.interp(lines.time_s, time, _path(rng, time))
        frequency = np.where(own, frequency * (1 + path), frequency)
        if rng.random() < 0.5:
            around = 360 * rng.random(bearing.size)
            bearing = np.where(own, around, bearing)
    lines = replace(
        lines, measured_frequency_hz=frequency, measured_bearing_deg=bearing
    )
    levels = levels_of_scene(scenes[0], rng, snr_db=-60.0)
    drift = 0.0
    if rng.random() < 0.7:
        drift = 10 ** rng.uniform(-0.5, 0.6) * gauss_markov(
            rng, time, 10 ** rng.uniform(0.7, 2.5)
        )
    around = 360 * rng.random(levels.bearing_deg.size)
    return lines, replace(
        levels,
        excess_db=levels.excess_db + drift,
        level_db=levels.level_db + drift,
        bearing_deg=around,
        bearing_std_deg=around * 0 + 60,
    )


def claims(lines, levels, sensor, stated):
    """Tell at which stated probabilities a closest approach is claimed.

    What is not claimed at one probability is claimed at no smaller one.
    """
    found = dict.fromkeys(stated, False)
    for probability in sorted(stated, reverse=True):
        rows = find_encounters(
            lines, levels, sensor, false_alarm_probability=probability
        )
        found[probability] = bool(np.isfinite(rows.time_s).any())
        if not found[probability]:
            break
    return [found[probability] for probability in stated]


def heard_claims(scenario, stated):
    """Run the chain over a drawn recording, and decide at each probability."""
    (recording,) = simulate_recordings(scenario)
    made = run_recipe(recording, load_recipe("vessel"))
    lines, levels = (
        next(item for item in made if isinstance(item, kind))
        for kind in (Lines, Levels)
    )
    return claims(lines, levels, recording.sensor, stated)


def noise_scenario(seed):
    """Draw a recording of noise, half of them with a machine's hum that jitters."""
    rng = np.random.default_rng([seed, 1])
    noise = {
        "density_db": 70.0,
        "slope_db_per_decade": float(rng.uniform(-20.0, 0.0)),
    }
    if rng.random() < 0.5:
        noise["hum"] = {
            "mains_hz": float(rng.uniform(25.0, 60.0)),
            "levels_db": list(rng.uniform(85.0, 100.0, rng.integers(1, 5))),
            "fraction": float(10 ** rng.uniform(-5, -3)),
            "correlation_s": float(10 ** rng.uniform(0.7, 2.3)),
        }
    return _scenario(rng, [], noise)


def passage_scenario(seed, line_db_hz, band_db):
    """Describe a passage that only one line, or only the broadband, tells of."""
    rng = np.random.default_rng([seed, 2])
    vessel = {
        "source_depth_m": 3.0,
        "closest_approach": {
            "time_s": float(rng.uniform(0.4, 0.6) * LENGTH_S),
            "horizontal_range_m": 250.0,
            "speed_mps": 6.0,
            "course_deg": float(rng.uniform(0.0, 360.0)),
            "side": str(rng.choice(["port", "starboard"])),
        },
    }
    if line_db_hz is not None:
        vessel["line"] = [{"frequency_hz": 120.0, "cn0_db_hz": line_db_hz}]
    if band_db is not None:
        vessel["broadband"] = {"band_hz": [100.0, 900.0], "snr_db": band_db}
    return _scenario(rng, [vessel], {"density_db": 70.0, "slope_db_per_decade": -10.0})


def _scenario(rng, vessels, noise):
    return make_scenario({
            "seed": int(rng.integers(2**31)),
            "duration_s": LENGTH_S,
            "sample_rate_hz": RATE_HZ,
            "sensor": [
                {
                    "id": "h1", "kind": "difar", "depth_m": DEPTH_M,
                    "full_scale_db": 175.0,
                }
            ],
            "vessel": vessels,
            "noise": noise,
        },
    )  # fmt: skip


def hump_claims(seed, snr_db, stated):
    """Decide on the levels of a passage alone, measured with 1 dB of noise."""
    rng = np.random.default_rng([seed, 3])
    scene = Scene(length_s=LENGTH, closest_s=LENGTH / 2)
    levels = levels_of_scene(scene, rng, snr_db=snr_db, has_bearing=False)
    return claims(None, levels, DIFAR, stated)


def interval(count, runs):
    """Return the interval of 95 % of a probability (Clopper and Pearson 1934)."""
    low = beta.ppf(0.025, count, runs - count + 1) if count else 0.0
    high = beta.ppf(0.975, count + 1, runs - count) if count < runs else 1.0
    return float(low), float(high)


def noise_table(kinds):
    """Return the rates in noise beside the stated ones, in Markdown."""
    lines = [
        "| noise | runs | stated | claimed | rate | interval of 95 % |",
        "|---|---|---|---|---|---|",
    ]
    for name, results in kinds.items():
        for stated, count in zip(STATED, np.sum(results, axis=0), strict=True):
            low, high = interval(int(count), len(results))
            lines.append(
                f"| {name} | {len(results)} | {stated:.1%} | {count} "
                f"| {count / len(results):.2%} | {low:.2%} to {high:.2%} |"
            )
    return "\n".join(lines)


def detection_table(kinds):
    """Return the shares of passages found against the ratio, in Markdown."""
    head = " | ".join(f"found at {stated:.1%}" for stated in STATED)
    lines = [
        f"| passage told by | ratio at closest approach | runs | {head} |",
        "|---" * (3 + len(STATED)) + "|",
    ]
    for (name, ratio), results in kinds.items():
        shares = " | ".join(f"{share:.0%}" for share in np.mean(results, axis=0))
        lines.append(f"| {name} | {ratio} | {len(results)} | {shares} |")
    return "\n".join(lines)


def main(measured, recorded, passages):
    """Print rates in noise and shares of passages found."""
    warnings.simplefilter("ignore")
    noise = {
        "measured lines and levels": [
            claims(*still_recording([11, k]), DIFAR, STATED) for k in range(measured)
        ],
        "recordings, whole chain": [
            heard_claims(noise_scenario(k), STATED) for k in range(recorded)
        ],
    }
    found = {}
    for ratio in (-9.0, -6.0, -3.0, 0.0, 3.0):
        found["levels of 1 dB each second", f"{ratio:+.0f} dB"] = [
            hump_claims(k, ratio, STATED) for k in range(4 * passages)
        ]
    for ratio in (-21.0, -18.0, -15.0, -12.0, -9.0):
        found["sound in 100-900 Hz, whole chain", f"{ratio:+.0f} dB"] = [
            heard_claims(passage_scenario(k, None, ratio), STATED)
            for k in range(passages)
        ]
    for ratio in (6.0, 9.0, 12.0, 15.0, 18.0):
        found["a line at 120 Hz, whole chain", f"{ratio:.0f} dB-Hz"] = [
            heard_claims(passage_scenario(k, ratio, None), STATED)
            for k in range(passages)
        ]
    command = f"python -m tests.motion.false_alarms {measured} {recorded} {passages}"
    sys.stdout.write(
        "# Noise taken for passages, and passages found, at the same thresholds\n\n"
        f"Made by `{command}`. Noise: machines that stay, their lines steady, walking or "
        "jittering by up to a thousandth, levels that drift by up to 4 dB; recordings "
        "of noise of 480 s, half of them with a jittering hum. Passages at 6 m/s, "
        f"250 m.\n\n{noise_table(noise)}\n\n{detection_table(found)}\n"
    )


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:4]))
