"""The truth of a scenario, as plain values for a JSON file.

**Conventions.** Times in seconds from the first sample (true clock), angles in
compass degrees; ``encounters`` holds one object per sensor, vessel and closest
approach, under the names that results use; no vessel gives an empty list. A closest
approach before or after the recording has ``inside`` false.
``track`` is sampled each second (sparser beyond an hour: 3600 steps).
"""

from dataclasses import asdict
from typing import Any

import numpy as np

from uwtrack_cli.simulate.approach import Approach, closest_approaches, direct_path
from uwtrack_cli.simulate.noise import ambient_density
from uwtrack_cli.simulate.scenario import Noise, Scenario, SensorPlan
from uwtrack_cli.simulate.source_levels import (
    BroadbandSource,
    Tone,
    band_noise_power,
    broadband_source,
    reference_range_m,
    tones,
)
from uwtrack_cli.simulate.trajectories import Trajectory, sensor_trajectory, vessel_trajectory
from uwtrack_cli.simulate.vessels import Vessel

FORMAT = "uwtrack-truth"
VERSION = 1


def truth(scenario: Scenario, sensor: str | None = None) -> dict[str, Any]:
    """Return the truth of a scenario, ready for JSON.

    ``sensor``: name of the one sensor to describe; by default all of them.

    Returned: facts of the recording, ``sensors`` with their hidden errors, ``vessels``
    with their tracks, ``encounters``, and ``noise`` (None without noise).
    """
    plans = [plan for plan in scenario.sensors if sensor in (None, plan.id)]
    return {
        "format": FORMAT,
        "version": VERSION,
        "seed": scenario.seed,
        "duration_s": scenario.duration_s,
        "sample_rate_hz": scenario.sample_rate_hz,
        "sound_speed_mps": scenario.sound_speed_mps,
        "start_utc": scenario.start_utc,
        "sensors": [_sensor(scenario, plan) for plan in plans],
        "vessels": [_vessel(scenario, vessel, i) for i, vessel in enumerate(scenario.vessels, 1)],
        "encounters": [
            found
            for plan in plans
            for i, vessel in enumerate(scenario.vessels, 1)
            for found in _encounters(scenario, plan, vessel, i)
        ],
        "noise": None if scenario.noise is None else asdict(scenario.noise),
        **({} if scenario.sea_bed is None else {"sea_bed": asdict(scenario.sea_bed)}),
    }


def _sensor(scenario: Scenario, plan: SensorPlan) -> dict[str, Any]:
    facts = {
        "id": plan.id,
        "kind": plan.kind,
        "east_m": plan.east_m,
        "north_m": plan.north_m,
        "latitude": plan.latitude,
        "longitude": plan.longitude,
        "depth_m": plan.depth_m,
        "full_scale_upa": plan.full_scale_upa,
        "position_error_m": list(plan.position_error_m),
        "compass_error_deg": plan.compass_error_deg,
        "clock_error_s": plan.clock_error_s,
    }
    if plan.kind == "array":
        facts["element_along_m"] = list(plan.element_along_m)
        facts["element_positions_m"] = [list(place) for place in plan.element_positions_m]
    if plan.track is not None:
        facts["track"] = _track(sensor_trajectory(plan), scenario.duration_s)
    return facts


def _vessel(scenario: Scenario, vessel: Vessel, number: int) -> dict[str, Any]:
    sound = broadband_source(scenario, vessel)
    return {
        "vessel": number,
        "name": vessel.name,
        "source_depth_m": vessel.source_depth_m,
        "surface_image": vessel.surface_image,
        "frequency_jitter": asdict(vessel.frequency_jitter),
        "reference_range_m": reference_range_m(scenario, vessel),
        "lines": [
            {
                "rest_frequency_hz": tone.frequency_hz,
                "source_level_db": _db(0.5 * tone.amplitude_upa**2),
            }
            for tone in tones(scenario, vessel)
        ],
        "broadband": None
        if sound is None
        else {
            "band_hz": list(sound.band_hz),
            "source_level_db": _db(sound.power()),
            "cavitation": _cavitation(vessel),
        },
        "gear_changes": [asdict(change) for change in vessel.gear_changes],
        "track": _track(vessel_trajectory(vessel, scenario), scenario.duration_s),
    }


def _cavitation(vessel: Vessel) -> dict[str, Any] | None:
    if vessel.broadband is None or vessel.broadband.cavitation is None:
        return None
    return asdict(vessel.broadband.cavitation)


def _encounters(
    scenario: Scenario, plan: SensorPlan, vessel: Vessel, number: int
) -> list[dict[str, Any]]:
    path = direct_path(scenario, vessel, plan)
    lines, sound = tones(scenario, vessel), broadband_source(scenario, vessel)
    return [
        {
            "sensor": plan.id,
            "vessel": number,
            **asdict(found),
            "range_over_speed_s": found.slant_range_m / found.speed_mps,
            "inside": 0.0 <= found.time_s <= scenario.duration_s,
            "rest_frequencies_hz": [tone.frequency_hz for tone in lines],
            "sound_speed_mps": scenario.sound_speed_mps,
            **_ratios(scenario.noise, lines, sound, _loss_db(vessel, found)),
        }
        for found in closest_approaches(path, scenario.duration_s)
    ]


def _loss_db(vessel: Vessel, found: Approach) -> float:
    return float(vessel.spreading_db_per_decade * np.log10(found.slant_range_m))


def _ratios(
    noise: Noise | None, lines: tuple[Tone, ...], sound: BroadbandSource | None, loss_db: float
) -> dict[str, Any]:
    """Return levels and ratios at closest approach (direct path alone)."""
    levels = [_db(0.5 * tone.amplitude_upa**2) - loss_db for tone in lines]
    band_db = None if sound is None else _db(sound.power()) - loss_db
    ratios: dict[str, Any] = {
        "line_levels_db": levels,
        "band_level_db": band_db,
        "cn0_db_hz": None,
        "snr_db": None,
    }
    if noise is not None:
        frequencies = np.array([tone.frequency_hz for tone in lines])
        density_db = 10.0 * np.log10(ambient_density(noise, frequencies))
        ratios["cn0_db_hz"] = (np.array(levels) - density_db).tolist()
        if sound is not None and band_db is not None:
            ratios["snr_db"] = band_db - _db(band_noise_power(noise, sound.band_hz))
    return ratios


def _track(trajectory: Trajectory, duration_s: float) -> dict[str, list[float]]:
    step = max(1.0, float(np.ceil(duration_s / 3600.0)))
    time_s = np.arange(0.0, duration_s + step, step)
    east, north, east_rate, north_rate = trajectory.at(time_s)
    return {
        "time_s": time_s.tolist(),
        "east_m": east.round(4).tolist(),
        "north_m": north.round(4).tolist(),
        "velocity_east_mps": east_rate.round(6).tolist(),
        "velocity_north_mps": north_rate.round(6).tolist(),
    }


def _db(power: float) -> float:
    return float(10.0 * np.log10(power))
