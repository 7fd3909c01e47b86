"""Sensor and deployment files: what the hydrophone is, and where.

**Conventions.** A sensor file is one TOML table, a deployment file several
``[[sensor]]`` tables, each with ``files``: the patterns of the recordings it made.
`pass.sensor.toml` beside `pass.wav` is found by itself. Nothing is invented: what
the file does not say stays unknown.

**Method.** A calibration says which pressure a full-scale sample stands for: directly
(``full_scale_db``), or as ``adc_peak_v * 10**(-(sensitivity + gain)/20)``, in uPa.
Recorders saturate between 60 and 240 dB re 1 uPa; a value outside betrays a wrong sign
or unit, and the term farthest from what is sold is named.
"""

import json
import math
from dataclasses import dataclass, field, fields
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from uwtrack_cli.data.options import AtLeast, AtMost, Unit, from_table, shown
from uwtrack_cli.data.sensor import Sensor, SoundSpeed
from uwtrack_cli.errors import DataError, OptionError, warn
from uwtrack_cli.files.tables.navigation import read_navigation
from uwtrack_cli.files.tables.toml_tables import read_toml

Degrees = Annotated[float, Unit("degree"), AtLeast(-360), AtMost(360)]
Gain = Annotated[float, AtLeast(0.01), AtMost(100)]
Share = Annotated[float, AtLeast(-0.9), AtMost(0.9)]
Place = Annotated[float, Unit("m"), AtLeast(-1e7), AtMost(1e7)]
Frequency = Annotated[float, Unit("Hz"), AtLeast(1e-3), AtMost(1e6)]
Decibel = Annotated[float, Unit("dB"), AtLeast(-120), AtMost(120)]
DipoleName = Literal["east", "north", "-east", "-north"]

WAVE_GUIDES = (2_000.0, 2.9e8)
"""Speeds between these, m/s, belong neither to sound in a fluid nor to light."""

FULL_SCALE_DB = (60.0, 240.0)
"""Levels of a full-scale sample that recorders have, dB re 1 uPa."""

MAX_ID = 200
"""Most characters of an identifier."""

FEWEST_ELEMENTS = 2
"""Hydrophones that an array needs."""

APERTURES_M = (0.01, 2000.0)
"""Shortest and longest array; millimetres and inches come out beyond."""

STRAIGHT_SHARE = 1e-3
"""An array narrower than this share of its length is a line."""

LISTS: dict[str, tuple[str, type]] = {
    "channels": (",", str),
    "multiplex": (",", str),
    "response_db": (",:", float),
    "dipole_gains": (",", float),
    "omni_crosstalk": (",", float),
    "element_along_m": (",", float),
    "element_positions_m": (";,", float),
}
"""Keys with lists, which a sensor holds as texts: what stands between the elements, the
outer ones first, and what they are."""

TOW_KEYS = {
    "tow_offset_m": (
        "the distance along the track from the navigation's place back to the array's middle, 0 if the "
        "navigation is the array's own"
    ),
    "heading_source": (
        '"track" if the array follows the ship\'s track, "compass" if heading_deg of the '
        "navigation is the array's"
    ),
}
"""What must be known of a towed array, and what it means."""

PLACE_KEYS = ("element_along_m", "element_positions_m")
"""Where the hydrophones of a line array are, and those of any other."""

ARRAY_KEYS = (*PLACE_KEYS, *TOW_KEYS)
"""Keys that only an array has."""

SOLE_CHANNEL = {"omni": "omni", "difar-multiplexed": "multiplex"}
"""Name of the channel of a sensor with one, by kind."""

DIPOLE_KEYS = ("dipole_gains", "dipole_crosstalk", "omni_crosstalk")
"""Keys that only a sensor with dipoles has."""

MULTIPLEX_KEYS = ("multiplex", "response_db")
"""Keys that only a buoy whose audio is multiplexed has."""

DIPOLES = ("-east", "north")
"""Dipole in phase with the phase pilot and the one ahead of it, unless told."""

USUAL = {
    "sensitivity_db_re_v_per_upa": (-230.0, -120.0),
    "gain_db": (-40.0, 80.0),
    "adc_peak_v": (0.05, 60.0),
}
"""What is sold, by term of a calibration, in the term's unit."""

HINTS = {
    "sensitivity_db_re_v_per_upa": (
        "hydrophones have -230 to -120 dB re 1 V/uPa; a value re 1 V/Pa needs -120 dB"
    ),
    "gain_db": "amplifiers have -40 to 80 dB; an amplification factor is no dB value",
    "adc_peak_v": "converters have 0.05 to 60 V; the peak is meant, in volts",
}


@dataclass(frozen=True, kw_only=True)
class SensorTable:
    """The keys of a sensor in a file; None is not given, and stays unknown."""

    id: str
    """Identifier, unique in a deployment."""
    kind: Literal["omni", "difar", "difar-multiplexed", "array"] = "omni"
    """One hydrophone, a vector sensor, a sonobuoy's one channel of audio in which omni
    and dipoles are multiplexed, or many hydrophones."""
    channels: list[str] | None = None
    """Names of the channels in the order of the file; "-" leaves one out."""
    multiplex: tuple[DipoleName, DipoleName] | None = None
    """Dipole in phase with the 15 kHz pilot, and the one a quarter of a period ahead of
    it; "-" inverts one. "-east" and "north" if not given."""
    response_db: list[tuple[Frequency, Decibel]] | None = None
    """Frequencies in Hz and the response of the buoy there in dB, which is equalised;
    flat if not given. Constant before the first and after the last."""
    latitude: Annotated[float, Unit("degree"), AtLeast(-90), AtMost(90)] | None = None
    """Latitude, north positive."""
    longitude: Annotated[float, Unit("degree"), AtLeast(-180), AtMost(180)] | None = None
    """Longitude, east positive."""
    east_m: Place | None = None
    """Position east of the origin of a local grid."""
    north_m: Place | None = None
    """Position north of the origin of a local grid."""
    position_std_m: Annotated[float, Unit("m"), AtLeast(0), AtMost(1e6)] | None = None
    """Standard deviation of each coordinate."""
    depth_m: Annotated[float, Unit("m"), AtLeast(0), AtMost(11_000)] | None = None
    """Depth below the surface."""
    depth_std_m: Annotated[float, Unit("m"), AtLeast(0), AtMost(11_000)] | None = None
    """Standard deviation of the depth."""
    heading_deg: Degrees | None = None
    """Compass heading of axes that turn with the housing, or of a fixed array."""
    dipole_gains: tuple[Gain, Gain] | None = None
    """Output of the first and of the second dipole for sound along its axis, over that
    of the omni channel; 1 and 1 if not given. `uwtrack calibrate` measures it."""
    dipole_crosstalk: Share | None = None
    """Share of the other dipole that each dipole hears (axes that are not square)."""
    omni_crosstalk: tuple[Share, Share] | None = None
    """Share of the omni channel in the first and in the second dipole."""
    element_along_m: list[Place] | None = None
    """Place of each hydrophone of an array, from its middle, positive to its head."""
    element_positions_m: list[tuple[Place, Place, Place]] | None = None
    """Places of the hydrophones of a planar or volume array: starboard, ahead, up."""
    tow_offset_m: Annotated[float, Unit("m"), AtLeast(0), AtMost(1e5)] | None = None
    """Distance along the track from the place that the navigation gives back to the array's middle."""
    heading_source: Literal["track", "way", "compass"] | None = None
    """Heading of an array: along the ship's track (once "way"), or the navigation's heading_deg."""
    sound_speed_mps: SoundSpeed | None = None
    """Sound speed at the sensor."""
    sound_speed_std_mps: Annotated[float, Unit("m/s"), AtLeast(0), AtMost(1e8)] | None = None
    """Standard deviation of the sound speed."""
    compass_offset_deg: Degrees | None = None
    """Added once to every bearing."""
    compass_std_deg: Annotated[float, Unit("degree"), AtLeast(0), AtMost(180)] | None = None
    """Standard deviation of the compass."""
    declination_deg: Literal["place"] | Degrees | None = None
    """Declination at a sensor whose compass shows magnetic north, east positive: added
    to the compass offset. "place" takes it from the World Magnetic Model, for the place
    of the sensor and the start of the recording."""
    clock_offset_s: Annotated[float, Unit("s"), AtLeast(-1e9), AtMost(1e9)] | None = None
    """Added once to every time."""
    clock_std_s: Annotated[float, Unit("s"), AtLeast(0), AtMost(1e6)] | None = None
    """Standard deviation of the clock."""
    clock_error_ppm: Annotated[float, AtLeast(-1e5), AtMost(1e5)] | None = None
    """By how much the recorder's clock makes frequencies too high, 1e-6: its sample rate
    is taken to be lower by that."""
    navigation: str | None = None
    """File with positions and headings over time, relative to this one."""
    navigation_position_std_m: Annotated[float, Unit("m"), AtLeast(0), AtMost(1e6)] | None = None
    """Standard deviation of each coordinate of the navigation; 10 m unless given."""
    navigation_velocity_std_mps: Annotated[float, Unit("m/s"), AtLeast(0), AtMost(100)] | None = (
        None
    )
    """Standard deviation of each component of its velocity; 0.1 m/s unless given."""
    sensitivity_db_re_v_per_upa: (
        Annotated[float, Unit("dB re 1 V/uPa"), AtLeast(-400), AtMost(400)] | None
    ) = None
    """Sensitivity of the hydrophone."""
    gain_db: Annotated[float, Unit("dB"), AtLeast(-200), AtMost(200)] | None = None
    """Gain of the amplifier."""
    adc_peak_v: Annotated[float, Unit("V"), AtLeast(1e-6), AtMost(1e6)] | None = None
    """Input voltage at full scale."""
    full_scale_db: (
        Annotated[float, Unit("dB re 1 uPa"), AtLeast(FULL_SCALE_DB[0]), AtMost(FULL_SCALE_DB[1])]
        | None
    ) = None
    """Level of a full-scale peak, instead of the three terms before."""

    def __post_init__(self) -> None:
        """Check what concerns several keys.

        Raises
        ------
        OptionError
            Keys are missing, exclude each other, or cannot be true together.
        """
        if not (self.id.strip() and self.id.isprintable() and len(self.id) <= MAX_ID):
            raise OptionError(
                f"id must be a text of 1 to {MAX_ID} characters that can be printed, "
                f"got {shown(self.id)}."
            )
        for one, other in (("latitude", "longitude"), ("east_m", "north_m")):
            given = [key for key in (one, other) if getattr(self, key) is not None]
            if len(given) == 1:
                missing = other if given == [one] else one
                raise OptionError(f"{given[0]} is given without {missing}.")
        if self.latitude is not None and self.east_m is not None:
            raise OptionError("give latitude and longitude, or east_m and north_m, not both.")
        if self.kind == "array":
            self._check_array()
        else:
            self._check_channels()
        self._check_dipoles()
        self._check_multiplex()
        self._check_calibration()

    def _check_array(self) -> None:
        used = [name for name in self.channels or [] if name != "-"]
        given = [key for key in PLACE_KEYS if getattr(self, key) is not None]
        if len(given) > 1:
            raise OptionError(
                f"an array has {' or '.join(PLACE_KEYS)}, not both: the first for a "
                f"line, the second for any other shape."
            )
        key = given[0] if given else PLACE_KEYS[0]
        places: list[Any] = getattr(self, key) or []
        if len(used) != len(places) or len(used) < FEWEST_ELEMENTS:
            raise OptionError(
                f"an array needs a channel and a place in {key} for each of "
                f"at least {FEWEST_ELEMENTS} hydrophones, got {len(used)} channels to "
                f'use and {len(places)} places; "-" leaves a channel out.'
            )
        wrong = [n for n in used if used.count(n) > 1 or "," in n or not n.strip()]
        if wrong:
            raise OptionError(
                f"channels of an array must have names of their own without a comma, "
                f"got {shown(wrong[0])}."
            )
        twice = [place for place in places if places.count(place) > 1]
        if twice:
            where = " ".join(f"{value:g}" for value in np.ravel(twice[0]))
            raise OptionError(
                f"{key} puts two hydrophones at {where} m: give each its "
                f'own place, or leave one out with channel name "-".'
            )
        spread = np.reshape(np.array(places, float), (len(places), -1))
        spans = np.linalg.svd(spread - spread.mean(axis=0), compute_uv=False)
        aperture_m = float(np.ptp(spread, axis=0).max())
        if not APERTURES_M[0] <= aperture_m <= APERTURES_M[1]:
            raise OptionError(
                f"{key} spans {aperture_m:g} m; arrays have "
                f"{APERTURES_M[0]:g} to {APERTURES_M[1]:g} m. Are the places in metres?"
            )
        if spans.size > 1 and spans[1] < STRAIGHT_SHARE * spans[0]:
            raise OptionError(
                "element_positions_m lie on one line, which measures an angle and no "
                "bearing: give element_along_m, the positions along that line."
            )
        self._check_tow()

    def _check_tow(self) -> None:
        if self.navigation is None:
            return
        if self.heading_deg is not None:
            raise OptionError("an array has heading_deg (it is fixed) or navigation, not both.")
        for key, meaning in TOW_KEYS.items():
            if getattr(self, key) is None:
                raise OptionError(f"an array with navigation needs {key}: {meaning}.")

    def _check_dipoles(self) -> None:
        own = [key for key in DIPOLE_KEYS if getattr(self, key) is not None]
        if own and self.kind not in {"difar", "difar-multiplexed"}:
            raise OptionError(f'{own[0]} belongs to a sensor with dipoles: give kind = "difar".')

    def _check_multiplex(self) -> None:
        own = [key for key in MULTIPLEX_KEYS if getattr(self, key) is not None]
        if own and self.kind != "difar-multiplexed":
            raise OptionError(f'{own[0]} belongs to a buoy: give kind = "difar-multiplexed".')
        axes = sorted(name.removeprefix("-") for name in self.multiplex or DIPOLES)
        if axes != ["east", "north"]:
            raise OptionError(
                f"multiplex names each dipole once, got {list(self.multiplex or ())}."
            )
        edges = [frequency_hz for frequency_hz, _ in self.response_db or [(1.0, 0.0)]]
        if not edges or edges != sorted(set(edges)):
            raise OptionError(f"frequencies of response_db must increase, got {edges}.")

    def _check_channels(self) -> None:
        own = [key for key in ARRAY_KEYS if getattr(self, key) is not None]
        if own:
            raise OptionError(f'{own[0]} belongs to an array: give kind = "array".')
        if self.channels is None and self.kind == "difar":
            raise OptionError('a difar sensor needs channels = ["omni", "east", "north"].')
        names = self.channel_names
        used = sorted(name for name in names if name != "-")
        sole = SOLE_CHANNEL.get(self.kind)
        accepted = [[sole]] if sole else [["east", "north", "omni"], ["omni", "x", "y"]]
        if used not in accepted:
            wanted = f'"{sole}" once' if sole else (
                '"omni", "east", "north" or "omni", "x", "y", each once'
            )  # fmt: skip
            raise OptionError(
                f"channels of a {self.kind} sensor must be {wanted} in file order, "
                f'with "-" for one to leave out, got {names}.'
            )
        if "x" in names and self.heading_deg is None and self.navigation is None:
            raise OptionError('channels "x" and "y" turn with the housing: give heading_deg.')

    def _check_calibration(self) -> None:
        terms = {key: getattr(self, key) for key in USUAL}
        missing = [key for key, value in terms.items() if value is None]
        if len(missing) == len(terms):
            return
        if self.full_scale_db is not None:
            raise OptionError(f"give full_scale_db, or {', '.join(terms)}, not both.")
        if missing:
            raise OptionError(
                f"a calibration needs {', '.join(terms)}; {', '.join(missing)} is "
                f"missing. Give all three, or full_scale_db, or none if unknown."
            )
        level_db = 20.0 * math.log10(terms["adc_peak_v"])
        level_db -= terms["sensitivity_db_re_v_per_upa"] + terms["gain_db"]
        if not FULL_SCALE_DB[0] <= level_db <= FULL_SCALE_DB[1]:
            wrong = max(USUAL, key=lambda key: _oddness_db(key, terms[key]))
            raise OptionError(
                f"the calibration gives a full-scale sample {level_db:.4g} dB re 1 uPa, "
                f"outside {FULL_SCALE_DB[0]:g} to {FULL_SCALE_DB[1]:g}; {wrong} = "
                f"{terms[wrong]:g} looks wrong ({HINTS[wrong]})."
            )

    @property
    def channel_names(self) -> list[str]:
        """Names of the channels, those of a sensor with one where none are given."""
        return self.channels or [SOLE_CHANNEL.get(self.kind, "omni")]

    def sensor(self, folder: Path) -> Sensor:
        """Return the sensor; files that it names lie relative to a folder."""
        facts = {f.name: getattr(self, f.name) for f in fields(SensorTable)}
        facts["channels"] = self.channel_names
        facts |= self._north(facts.pop("declination_deg"))
        if self.kind == "difar-multiplexed":
            facts["multiplex"] = self.multiplex or DIPOLES
        for key, (signs, _) in LISTS.items():
            facts[key] = None if facts[key] is None else _as_text(facts[key], signs)
        facts["response"] = facts.pop("response_db") or None
        if self.kind == "array" and self.heading_deg is not None:
            facts["heading_source"] = "fixed"
        if self.navigation is not None:
            facts["navigation"] = read_navigation(folder / self.navigation)
        return Sensor(**{k: v for k, v in facts.items() if v is not None})

    def _north(self, declination_deg: float | str | None) -> dict[str, Any]:
        """Return the compass offset and the north that bearings are from with it."""
        if declination_deg == "place":
            return {"north": "place"}
        if declination_deg is not None:
            offset_deg = (self.compass_offset_deg or 0.0) + float(declination_deg)
            return {"compass_offset_deg": offset_deg}
        untold = self.kind == "difar-multiplexed" and self.compass_offset_deg is None
        return {"north": "compass" if untold else None}


def _as_text(value: Any, signs: str) -> str:
    """Return a list as a text with a sign between its elements, one for each depth."""
    if not signs:
        return value if isinstance(value, str) else repr(value)
    return signs[0].join(_as_text(one, signs[1:]) for one in value)


def _as_list(text: str, signs: str, kind: type) -> Any:
    """Return the list of a text that `_as_text` made."""
    if not signs:
        return kind(text)
    return [_as_list(part, signs[1:], kind) for part in text.split(signs[0])]


def sensor_text(sensor: Sensor, navigation_name: str = "") -> str:
    """Return a sensor file: the facts of a sensor as TOML."""
    facts = {f.name: getattr(sensor, f.name, None) for f in fields(SensorTable)}
    facts |= {"response_db": sensor.response, "navigation": navigation_name or None}
    if sensor.is_multiplexed:  # what its file holds
        facts["channels"] = "multiplex"
    if sensor.heading_source == "fixed":
        facts["heading_source"] = None
    elif "x" not in sensor.channel_names:
        facts["heading_deg"] = None
    facts["dipole_crosstalk"] = sensor.dipole_crosstalk or None
    known = {key: value for key, value in facts.items() if value is not None}
    known |= {key: _as_list(known[key], *how) for key, how in LISTS.items() if key in known}
    return "".join(f"{key} = {json.dumps(value)}\n" for key, value in known.items())


@dataclass(frozen=True, kw_only=True)
class DeployedSensorTable(SensorTable):
    """The keys of a sensor in a deployment file."""

    files: str | list[str] = field(default_factory=list)
    """Patterns of the names, or ends of paths, of the recordings that it made; none for
    a sensor of a table."""


@dataclass(frozen=True, kw_only=True)
class DeployedSensor:
    """A sensor of a deployment, and the patterns of its recordings."""

    sensor: Sensor
    """What the file says of it."""
    files: tuple[str, ...]
    """Patterns of its recordings; empty in a file of one sensor."""


def find_sensor(recording: Path | str, sensor_file: Path | str | None = None) -> Sensor | None:
    """Return the sensor of a recording, None if nothing says what it is.

    Parameters
    ----------
    recording
        The recording.
    sensor_file
        A sensor or deployment file; without it, `NAME.sensor.toml` beside the
        recording is taken, if there is one.

    Raises
    ------
    DataError
        The file is wrong, or a deployment names no or several sensors for it.
    """
    recording = Path(recording)
    if sensor_file is None:
        sensor_file = _beside(recording)
        if not sensor_file.exists():
            return None
    deployed = load_deployment(sensor_file)
    if len(deployed) == 1 and not deployed[0].files:
        return deployed[0].sensor
    matching = [d.sensor for d in deployed if _matches(recording, d.files)]
    if len(matching) != 1:
        ids = ", ".join(repr(s.id) for s in matching) or "none"
        raise DataError(
            f"{sensor_file}: exactly one sensor must claim {recording.name} with its "
            f"`files` patterns, found {ids}."
        )
    return matching[0]


def sensor_files(recording: Path, sensor_file: Path | None = None) -> list[Path]:
    """Return the files that `find_sensor` reads for a recording, as far as they tell.

    ``sensor_file``: a sensor or deployment file, as for `find_sensor`.
    """
    sensor_file = sensor_file or _beside(recording)
    try:
        content = read_toml(sensor_file)
    except DataError:
        return [sensor_file]
    tables = content.get("sensor", content)
    names = [
        table["navigation"]
        for table in (tables if isinstance(tables, list) else [tables])
        if isinstance(table, dict) and isinstance(table.get("navigation"), str)
    ]
    return [sensor_file, *(sensor_file.parent / name for name in names)]


def load_sensor(path: Path | str) -> Sensor:
    """Read a sensor file.

    Raises
    ------
    DataError
        The file is wrong, or is a deployment of several sensors.
    """
    deployed = load_deployment(Path(path))
    if len(deployed) != 1:
        raise DataError(f"{path} describes {len(deployed)} sensors; a single one is needed here.")
    return deployed[0].sensor


def load_deployment(path: Path | str) -> list[DeployedSensor]:
    """Read a deployment file, or a sensor file as a deployment of one.

    Raises
    ------
    DataError
        Missing file, unknown key, wrong type or range, or an id used twice.
    """
    path = Path(path)
    content = read_toml(path)
    try:
        deployed = _deployed(content, path)
    except OptionError as error:
        raise DataError(f"{path}: {error}") from error
    for item in deployed:
        _remark_on_speed(item.sensor, path)
    return deployed


def _deployed(content: dict[str, Any], path: Path) -> list[DeployedSensor]:
    if "sensor" not in content:
        table = from_table(SensorTable, content, "sensor")
        return [DeployedSensor(sensor=table.sensor(path.parent), files=())]
    tables = content["sensor"]
    if set(content) != {"sensor"}:
        unknown = next(key for key in content if key != "sensor")
        raise OptionError(f"unknown key {unknown!r} beside the [[sensor]] tables.")
    is_list = isinstance(tables, list) and all(isinstance(t, dict) for t in tables)
    if not is_list or not tables:
        raise OptionError("sensors are given as one [[sensor]] table each.")
    found: list[DeployedSensor] = []
    for number, given in enumerate(tables, 1):
        table = from_table(DeployedSensorTable, given, f"sensor {number}")
        files = [table.files] if isinstance(table.files, str) else table.files
        sensor = table.sensor(path.parent)
        if any(sensor.id == other.sensor.id for other in found):
            raise OptionError(f"the id {sensor.id!r} is given twice; each sensor needs its own.")
        found.append(DeployedSensor(sensor=sensor, files=tuple(files)))
    return found


def _remark_on_speed(sensor: Sensor, path: Path) -> None:
    if WAVE_GUIDES[0] < sensor.sound_speed_mps < WAVE_GUIDES[1]:
        warn(
            f"{path}: sound_speed_mps = {sensor.sound_speed_mps:g} is faster than "
            f"sound in water or air and slower than light; 4900 ft/s are 1500 m/s."
        )


def _oddness_db(key: str, value: float) -> float:
    """Return how far a term lies outside what is usual, dB."""
    low, high = USUAL[key]
    if key == "adc_peak_v":
        return 20.0 * math.log10(max(value / high, low / value))
    return max(low - value, value - high)


def _beside(recording: Path) -> Path:
    return recording.with_name(f"{recording.stem}.sensor.toml")


def _matches(recording: Path, patterns: tuple[str, ...]) -> bool:
    """Tell whether a name, or the path's end, matches one of the patterns."""
    places = ["/".join(recording.parts[i:]) for i in range(len(recording.parts))]
    return any(fnmatchcase(place, p) for p in patterns for place in places)
