"""A drawn recording: its sound, what its owner knows of the sensor, and what is true."""

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import soundfile

from tests.draws.passage_bounds import bounds
from uwtrack_cli.simulate import Scenario, simulate_recordings

LARGEST_BOUND = 0.05
"""A passage is due where the bounds of its speed and of its R/v are below this share."""

DEPTH_STD_M, SOUND_SPEED_STD_MPS, COMPASS_STD_DEG = 0.5, 7.5, 2.0
"""Standard deviations that the owner of a drawn sensor states, and errs by."""

QUANTITIES = ("time_s", "range_over_speed_s", "speed_mps", "slant_range_m", "course_deg")


@dataclass(frozen=True)
class Passage:
    """One vessel that passes, at its closest approach."""

    time_s: float
    speed_mps: float
    slant_range_m: float
    course_deg: float = float("nan")
    side: str = ""
    bound: dict[str, float] = field(default_factory=dict)
    """Cramer-Rao bounds of `QUANTITIES` in their units; empty if there are none."""
    is_due: bool = True
    """Whether it must be found."""

    @property
    def truth(self) -> dict[str, float]:
        """The quantities of a row."""
        return {
            "time_s": self.time_s,
            "range_over_speed_s": self.slant_range_m / self.speed_mps,
            "speed_mps": self.speed_mps,
            "slant_range_m": self.slant_range_m,
            "course_deg": self.course_deg,
        }


@dataclass(frozen=True)
class Drawn:
    """One recording."""

    rate_hz: float
    sound: np.ndarray
    """Samples within -1 and 1, shape (sample,) or (sample, channel)."""
    passages: tuple[Passage, ...] = ()
    sensor: dict[str, object] | None = None
    """Facts of its sensor file; None for none."""
    words: tuple[str, ...] = ()
    """Options that it is run with."""

    @property
    def hours(self) -> float:
        """Its length."""
        return len(self.sound) / self.rate_hz / 3600.0

    def write(self, path: Path) -> None:
        """Write it in 16 bits, with its sensor file beside it."""
        soundfile.write(path, self.sound, int(self.rate_hz), subtype="PCM_16")
        if self.sensor is not None:
            text = "".join(f"{k} = {json.dumps(v)}\n" for k, v in self.sensor.items())
            path.with_suffix(".sensor.toml").write_text(text, encoding="utf-8")


def sensor_facts(
    rng: np.random.Generator, kind: str, depth_m: float, sound_speed_mps: float = 1500.0
) -> dict[str, object]:
    """State a sensor with the errors that its owner states: depth, medium, compass."""
    depth, sound, compass = rng.standard_normal(3)
    channels = ["omni", "east", "north"] if kind == "difar" else ["omni"]
    return {
        "id": "h1",
        "kind": kind,
        "channels": channels,
        "depth_m": depth_m + DEPTH_STD_M * depth,
        "depth_std_m": DEPTH_STD_M,
        "sound_speed_mps": sound_speed_mps + SOUND_SPEED_STD_MPS * sound,
        "sound_speed_std_mps": SOUND_SPEED_STD_MPS,
        "compass_offset_deg": COMPASS_STD_DEG * compass,
        "compass_std_deg": COMPASS_STD_DEG,
    }


def of_scenario(scenario: Scenario, seed: int) -> Drawn:
    """Return the only recording of a scenario, its sensor stated with errors."""
    (recording,) = simulate_recordings(scenario)
    assert recording.reader is not None
    sound = np.concatenate(list(recording.reader(1 << 18)))
    plan = scenario.sensors[0]
    facts = sensor_facts(np.random.default_rng([seed, 4]), plan.kind, plan.depth_m)
    if recording.sensor.full_scale_db is not None:
        facts["full_scale_db"] = recording.sensor.full_scale_db
    passing = tuple(
        _passage(scenario, number)
        for number, vessel in enumerate(scenario.vessels)
        if vessel.closest_approach is not None
    )
    return Drawn(scenario.sample_rate_hz, sound, passing, facts)


def _passage(scenario: Scenario, number: int) -> Passage:
    """Return the truth of a vessel, with its bounds.

    Sound speed and compass are unknown with a prior, and what they scale or turn has
    their variance besides (Van Trees, Bell and Tian 2013, section 4.3).
    """
    vessel, sensor = scenario.vessels[number], scenario.sensors[0]
    plan = vessel.closest_approach
    assert plan is not None
    height = sensor.depth_m - vessel.source_depth_m
    slant = float(np.hypot(plan.horizontal_range_m, height))
    least = bounds(scenario, number)
    medium = SOUND_SPEED_STD_MPS / scenario.sound_speed_mps
    bound = {
        "time_s": least["time"],
        "range_over_speed_s": least["width"] * slant / plan.speed_mps,
        "speed_mps": np.hypot(least["speed"], medium) * plan.speed_mps,
        "slant_range_m": np.hypot(least["range"], medium) * slant,
        "course_deg": np.hypot(least["course"], COMPASS_STD_DEG),
    }
    return Passage(
        plan.time_s, plan.speed_mps, slant, plan.course_deg, plan.side,
        {name: float(value) for name, value in bound.items() if np.isfinite(value)},
        bool(max(least["speed"], least["width"]) < LARGEST_BOUND),
    )  # fmt: skip
