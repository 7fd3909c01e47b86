"""Part of real recordings, where ``UWTRACK_REAL_DATA`` names their folder.

Their truth is known in part (``README.md`` of that folder). Values, standard deviations,
status and codes are held, and where the truth is known, whether a row agrees with it.
"""

import json
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tests.acceptance.outcomes import Outcome, command, run

Case = Callable[[Path], Outcome]


class Known(NamedTuple):
    """A real recording and what is known of it; None where nothing is."""

    pattern: str
    """Its file below the folder."""
    time_s: float | None = None
    """Closest approach."""
    speed_mps: float | None = None
    """Speed."""
    range_over_speed_s: float | None = None
    """Range over speed."""
    words: tuple[str, ...] = ()
    """Options that it is run with."""


AIR = ("--sound-speed-mps", "340")
RECORDINGS = {
    "train": Known("train/*.wav", 9.60, 34.1, None, ("--sound-speed-mps", "343")),
    "car at 30 mph": Known("cars/*.wav", None, None, 0.45, AIR),
    "kennicott": Known("ships/kennicott*.wav"),
    "nave orbit": Known("ships/nave*.wav"),
    "ruby princess": Known("ships/ruby*.wav"),
    "hum": Known("orcasound/*.flac"),
    "infrasound": Known("array/*.wav", words=("--sound-speed-mps", "343")),
    "28 mph": Known("vehicles/28_mph.wav", 2.63, None, 0.3, AIR),
    "civic": Known("vehicles/CIVIC*.wav", 2.56, None, 0.13, AIR),
    "corvette": Known("vehicles/Corvette*.wav", 1.66, 52.0, None, AIR),
    "doppler": Known("vehicles/doppler.wav", 3.89, 12.1, None, AIR),
    "formula 1": Known("vehicles/formula_1.wav", words=AIR),
    "20 mph": Known("vehicles/known_20*.wav", 4.69, None, 0.28, AIR),
    "lola": Known("vehicles/lola2.wav", 1.95, 14.5, None, AIR),
    "racing car": Known("vehicles/racecar2.wav", 0.95, 50.0, None, AIR),
}
NORTH_SEA = (Known("", range_over_speed_s=1070.0), Known("", range_over_speed_s=300.0))
"""Passages that stacking along hyperbolas shows; their times are known to half a minute."""

QUIETEST_WITHIN = 3.0
"""Standard deviations beyond which a row disagrees with what is known."""

TOLERANCES = {"time_s": 0.1, "speed_mps": 0.05, "range_over_speed_s": 0.3}
"""What the known values are uncertain by: s, and shares."""


def folder_of_data() -> Path | None:
    """Return the folder of real recordings, None without one."""
    told = os.environ.get("UWTRACK_REAL_DATA")
    return Path(told) if told else None


def row_of(row: dict[str, Any], known: Known) -> dict[str, Any]:
    """Return what is held of a row."""
    kept: dict[str, Any] = {"status": row["status"], "reading": row.get("motion_model")}
    agrees = True
    for name in ("time_s", "range_over_speed_s", "speed_mps"):
        stem, unit = name.rsplit("_", 1)
        if row[name] is None:
            continue
        std = float(row[f"{stem}_std_{unit}"])
        kept[name] = {"value": float(row[name]), "std": std}
        truth = getattr(known, name)
        if truth is not None:
            share = TOLERANCES[name] * (1.0 if name == "time_s" else truth)
            agrees &= abs(row[name] - truth) < QUIETEST_WITHIN * np.hypot(std, share)
    is_known = known.time_s is not None or known.range_over_speed_s is not None
    kept["verdict"] = "right" if is_known and agrees else "false"
    return kept


def recording(name: str, folder: Path) -> Outcome:
    """Run one recording by default."""
    data, known = folder_of_data(), RECORDINGS[name]
    assert data is not None
    (path,) = data.glob(known.pattern)
    link = folder / f"real{path.suffix}"
    link.symlink_to(path.resolve())
    rows, codes = run(link, known.words)
    return {"rows": [row_of(row, known) for row in rows], "codes": codes}


def small_array(folder: Path) -> Outcome:
    """Run the infrasound array with the places of its microphones."""
    data = folder_of_data()
    assert data is not None
    (path,) = (data / "array").glob("*.wav")
    (table,) = (data / "array").glob("*.positions.csv")
    places = np.loadtxt(table, delimiter=",", skiprows=1)[:, 1:]
    rows = [[float(east), float(north), 0.0] for east, north in places]
    channels = [f"e{number}" for number in range(1, len(rows) + 1)]
    link = folder / "real.wav"
    link.symlink_to(path.resolve())
    link.with_suffix(".sensor.toml").write_text(
        f'id = "array"\nkind = "array"\nchannels = {json.dumps(channels)}\n'
        f"element_positions_m = {json.dumps(rows)}\nheading_deg = 0.0\n"
        "depth_m = 0.0\nsound_speed_mps = 343.0\n"
    )
    told, codes = run(link, ("--recipe", "small-array"))
    return {"rows": [row_of(row, Known("")) for row in told], "codes": codes}


def north_sea(folder: Path) -> Outcome:
    """Run the three files of the North Sea as one recording, by `batch --join`."""
    data = folder_of_data()
    assert data is not None
    command("batch", *sorted((data / "north_sea").glob("*.flac")), "-o", folder / "out",
            "--join", "-q")  # fmt: skip
    (product,) = (folder / "out").glob("*.h5")
    told = json.loads(command("show", product, "encounters", "--format", "json"))
    stretches = json.loads(command("show", product, "presence", "--format", "json"))
    codes = {f"{one['kind']} {one.get('motion_model') or ''}".strip() for one in stretches if not one["encounter"]}  # fmt: skip
    rows = [row_of(row, _nearest(row)) for row in told]
    return {"rows": rows, "codes": sorted(codes)}


def _nearest(row: dict[str, Any]) -> Known:
    """Return the passage of the North Sea whose range over speed is nearest."""
    width_s = row["range_over_speed_s"]
    apart = [abs(width_s - (one.range_over_speed_s or 0.0)) for one in NORTH_SEA]
    return NORTH_SEA[int(np.argmin(apart))]


def cases() -> dict[str, Case]:
    """Return all cases, none without the folder."""
    if folder_of_data() is None:
        return {}
    made: dict[str, Case] = {name: partial(recording, name) for name in RECORDINGS}
    made["infrasound array"] = small_array
    made["north sea"] = north_sea
    return made
