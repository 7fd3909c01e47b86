"""Passages as real recordings have them: vessels, weather and machines drawn by chance.

**Method.** A scenario is drawn part by part, each from a generator of its own, so that
leaving out a disturbance changes nothing else. Depths of the source, ranges down to an
overhead passage, beginnings and ends near the closest approach, sample rates, band
edges and the disturbances follow what recorders in harbours and reserves show.

**Conventions.** Ranges are drawn uniformly unless stated otherwise; levels are relative
to the ambient density at 1 kHz.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.errors import OptionError
from uwtrack_cli.simulate.scenario import Scenario, make_scenario

Table = dict[str, Any]

SAMPLE_RATES_HZ = (4e3, 8e3, 16e3, 24e3, 48e3, 96e3)
"""Sample rates that are drawn, Hz."""

_PARTS = {"sensor": 1, "noise": 2, "vessels": 3, "disturbances": 4}


def draw_scenario(
    seed: int,
    *,
    n_vessels: int | None = None,
    kinds: Sequence[str] | None = None,
    sample_rate_hz: float | None = None,
    duration_s: float = 480.0,
) -> Scenario:
    """Draw a recording of one sensor with vessels and disturbances.

    ``n_vessels``: number of passages, 0 or more; drawn from one to four unless given.
    ``kinds``: disturbances, among the keys of `DISTURBANCES`; each with an even chance
    unless given. ``sample_rate_hz``: sample rate, Hz; drawn from `SAMPLE_RATES_HZ`
    unless given. ``duration_s``: length of the recording, s.

    Raises
    ------
    OptionError
        A disturbance is not known.

    Examples
    --------
    >>> scenario = draw_scenario(3, n_vessels=2, kinds=["rain"], duration_s=60.0)
    >>> len(scenario.vessels), len(scenario.noise.rain)
    (2, 1)
    """
    unknown = sorted(set(kinds or ()) - set(DISTURBANCES))
    if unknown:
        msg = f"unknown disturbance {unknown[0]!r}; known: {', '.join(DISTURBANCES)}."
        raise OptionError(msg)
    sensor = _generator(seed, "sensor")
    rate = sample_rate_hz or float(sensor.choice(SAMPLE_RATES_HZ))
    depth = float(np.exp(sensor.uniform(np.log(9.0), np.log(60.0))))
    ambient = float(sensor.uniform(55.0, 75.0))
    table: Table = {
        "seed": int(sensor.integers(2**31)),
        "duration_s": duration_s,
        "sample_rate_hz": rate,
        "sensor": [{
            "id": "h1", "kind": str(sensor.choice(["omni", "difar"])), "depth_m": depth,
            "full_scale_db": ambient + 115.0,
        }],
        "noise": {
            "density_db": ambient,
            "slope_db_per_decade": float(sensor.uniform(-20.0, -12.0)),
        },
    }  # fmt: skip
    vessels = _generator(seed, "vessels")
    count = int(vessels.integers(1, 5)) if n_vessels is None else n_vessels
    table["vessel"] = [_vessel(np.random.default_rng([seed, 30, k]), table) for k in range(count)]
    chances = _generator(seed, "disturbances").random(len(DISTURBANCES))
    for k, (kind, add) in enumerate(DISTURBANCES.items()):
        if chances[k] < 0.5 if kinds is None else kind in kinds:
            add(np.random.default_rng([seed, 40, k]), table)
    return make_scenario(table)


def _generator(seed: int, part: str) -> np.random.Generator:
    return np.random.default_rng([seed, _PARTS[part]])


def _vessel(rng: np.random.Generator, table: Table) -> Table:
    """Draw a passage: some overhead, some near the begin or the end of the recording."""
    duration, rate = table["duration_s"], table["sample_rate_hz"]
    time = rng.uniform(0.2, 0.8) * duration
    ending = rng.random()
    if ending < 0.15:
        time = duration - rng.uniform(0.0, 40.0)
    elif ending < 0.3:
        time = rng.uniform(0.0, 40.0)
    overhead = rng.random() < 0.15
    reach = rng.uniform(0.0, 5.0) if overhead else np.exp(rng.uniform(*np.log([20, 800])))
    base = rng.uniform(8.0, 40.0)
    strength = rng.uniform(18.0, 42.0)
    vessel: Table = {
        "source_depth_m": float(rng.uniform(0.4, 7.0)),
        "surface_image": float(rng.uniform(0.5, 1.0)),
        "closest_approach": {
            "time_s": float(np.clip(time, 0.0, duration)),
            "horizontal_range_m": float(reach),
            "speed_mps": float(rng.uniform(3.0, 25.0) * KNOT_MPS),
            "course_deg": float(rng.uniform(0.0, 360.0)),
            "side": str(rng.choice(["port", "starboard"])),
        },
        "line": [
            {"frequency_hz": float(base * n), "cn0_db_hz": float(strength - rng.uniform(0.0, 12.0))}
            for n in range(1, 2 + int(rng.integers(0, 8)))
        ],
        "frequency_jitter": {
            "fraction": float(10.0 ** rng.uniform(-5.0, -3.0)),
            "correlation_s": float(rng.uniform(5.0, 60.0)),
        },
        "broadband": {
            "band_hz": [50.0, 0.45 * rate],
            "snr_db": float(rng.uniform(-5.0, 25.0)),
            "slope_db_per_decade": -20.0,
        },
    }
    if rng.random() < 0.6:
        vessel["broadband"]["cavitation"] = {
            "blade_rate_hz": float(base * rng.integers(1, 4) / 2.0),
            "depth": float(rng.uniform(0.1, 0.5)),
            "harmonics": 3,
        }
    return vessel


def _rain(rng: np.random.Generator, table: Table) -> None:
    table["noise"]["rain"] = [{
        "peak_s": float(rng.uniform(0.1, 0.9) * table["duration_s"]),
        "density_db": _above(rng, table, -5.0, 12.0),
        "rise_s": float(rng.uniform(30.0, 180.0)),
        "hold_s": float(rng.uniform(0.0, 120.0)),
        "fall_s": float(rng.uniform(60.0, 240.0)),
    }]  # fmt: skip


def _drift(rng: np.random.Generator, table: Table) -> None:
    table["noise"]["drift"] = {"range_db": 8.0, "correlation_s": float(rng.uniform(60.0, 900.0))}


def _swell(rng: np.random.Generator, table: Table) -> None:
    table["noise"]["swell"] = {
        "amplitude_db": float(rng.uniform(1.0, 6.0)),
        "period_s": float(rng.uniform(7.0, 13.0)),
    }


def _gusts(rng: np.random.Generator, table: Table) -> None:
    table["noise"]["gusts"] = {
        "density_db": _above(rng, table, 5.0, 30.0),
        "rate_per_min": float(rng.uniform(1.0, 8.0)),
        "duration_s": float(rng.uniform(3.0, 15.0)),
    }


def _shrimp(rng: np.random.Generator, table: Table) -> None:
    table["noise"]["shrimp"] = {
        "rate_per_min": float(10.0 ** rng.uniform(2.0, 3.7)),
        "peak_db": _above(rng, table, 45.0, 70.0),
        "lowest_hz": float(rng.uniform(1500.0, 3000.0)),
    }


def _knocks(rng: np.random.Generator, table: Table) -> None:
    table["noise"]["knocks"] = {
        "rate_per_min": float(rng.uniform(0.5, 20.0)),
        "peak_db": _above(rng, table, 40.0, 65.0),
        "decay_s": float(10.0 ** rng.uniform(-2.0, -0.7)),
    }


def _mains(rng: np.random.Generator, table: Table) -> None:
    first = _above(rng, table, 15.0, 40.0)
    falls = np.cumsum(rng.uniform(0.0, 8.0, 8))
    table["noise"]["hum"] = {
        "mains_hz": float(rng.choice([50.0, 60.0])),
        "levels_db": [first, *(first - falls).tolist()],
        "fraction": float(10.0 ** rng.uniform(-6.0, -4.0)),
    }


def _distant_ship(rng: np.random.Generator, table: Table) -> None:
    """Add a ship so far away that level and frequencies are constant."""
    bearing = rng.uniform(0.0, 2.0 * np.pi)
    away = rng.uniform(10e3, 20e3)
    base = rng.uniform(5.0, 15.0)
    level = _above(rng, table, 20.0, 35.0) + 20.0 * np.log10(away)
    table["vessel"].append({
        "name": "distant ship",
        "source_depth_m": 6.0,
        "track": {
            "east_m": float(away * np.sin(bearing)),
            "north_m": float(away * np.cos(bearing)),
            "course_deg": float(np.degrees(bearing + 0.5 * np.pi) % 360.0),
            "speed_mps": float(rng.uniform(4.0, 8.0)),
        },
        "line": [
            {"frequency_hz": float(base * n), "source_level_db": float(level - n)}
            for n in range(4, 12)
        ],
    })  # fmt: skip


def _machine(rng: np.random.Generator, table: Table, **course: float) -> None:
    first = _above(rng, table, 18.0, 40.0)
    levels = [first, *(first - rng.uniform(0.0, 12.0, int(rng.integers(0, 5))))]
    table["noise"].setdefault("machine", []).append({
        "fundamental_hz": float(rng.uniform(15.0, 120.0)),
        "levels_db": [float(level) for level in levels],
        "bearing_deg": float(rng.uniform(0.0, 360.0)),
        **course,
    })  # fmt: skip


def _pumps(rng: np.random.Generator, table: Table) -> None:
    for _ in range(int(rng.integers(1, 3))):
        on, off = rng.uniform(15.0, 180.0, 2)
        _machine(rng, table, on_s=float(on), off_s=float(off), fraction=1e-4)


def _drifting_machine(rng: np.random.Generator, table: Table) -> None:
    _machine(rng, table, fraction=1e-3, correlation_s=float(rng.uniform(20.0, 200.0)))


def _stepping_machine(rng: np.random.Generator, table: Table) -> None:
    _machine(
        rng, table, step_fraction=0.05, step_every_s=float(rng.uniform(30.0, 200.0)), fraction=1e-4
    )


def _gear_change(rng: np.random.Generator, table: Table) -> None:
    """Let the first vessel change its speed of rotation once or twice."""
    if not table["vessel"]:
        return
    times = np.sort(rng.uniform(0.0, table["duration_s"], int(rng.integers(1, 3))))
    changes = []
    for k, time in enumerate(times):
        if k and time - times[k - 1] < 20.0:
            continue
        changes.append({
            "at_s": float(time),
            "factor": float(rng.uniform(0.7, 1.4)),
            "duration_s": float(rng.uniform(1.0, 8.0)),
            "revving": float(rng.uniform(0.0, 0.3)),
        })  # fmt: skip
    table["vessel"][0]["gear_change"] = changes


def _spectral_features(rng: np.random.Generator, table: Table) -> None:
    """Add a bump and a notch to the noise and to every vessel's broadband sound."""
    owners = [table["noise"]]
    owners += [v["broadband"] for v in table["vessel"] if "broadband" in v]
    for owner in owners:
        centres = np.exp(rng.uniform(np.log(80.0), np.log(0.4 * table["sample_rate_hz"]), 2))
        owner["feature"] = [
            {
                "centre_hz": float(centre),
                "width_hz": float(centre * rng.uniform(0.1, 0.6)),
                "gain_db": float(sign * rng.uniform(4.0, 15.0)),
            }
            for centre, sign in zip(centres, (1.0, -1.0), strict=True)
        ]


def _band_edges(rng: np.random.Generator, table: Table) -> None:
    table["sensor"][0]["recorder"] = {
        "high_pass_hz": float(10.0 ** rng.uniform(0.3, 1.7)),
        "low_pass_hz": float(rng.uniform(0.35, 0.48) * table["sample_rate_hz"]),
        "order": int(rng.integers(1, 7)),
    }


def _above(rng: np.random.Generator, table: Table, low: float, high: float) -> float:
    """Draw a level by its distance from the ambient density at 1 kHz, dB."""
    return float(table["noise"]["density_db"] + rng.uniform(low, high))


DISTURBANCES: dict[str, Callable[[np.random.Generator, Table], None]] = {
    "rain": _rain,
    "drift": _drift,
    "swell": _swell,
    "gusts": _gusts,
    "shrimp": _shrimp,
    "knocks": _knocks,
    "mains": _mains,
    "distant ship": _distant_ship,
    "pumps": _pumps,
    "drifting machine": _drifting_machine,
    "stepping machine": _stepping_machine,
    "gear change": _gear_change,
    "spectral features": _spectral_features,
    "band edges": _band_edges,
}
"""What may be drawn besides the passages, by name."""
