"""Sound of an array to beams: the bearing-time record, and peaks with bearings.

**Method.** The spectra of all hydrophones are turned and summed for every direction
(conventional beams, shaded), a block of frames at a time. Peaks are sought over
frequency and direction, each beam with a noise floor of its own; the level of every
beam over time is the bearing-time record, for which beams of minimum variance (MVDR)
separate sources that lie within one beam's width.

**Conventions.** A line measures the angle from its head, a cone, and not a bearing:
port and starboard look alike. Bearings are written for one side; `tma` settles which it
is when own ship turns. A planar or volume array hears bearings and elevations, and its
broadband sound gives directions frame by frame (`broadband_directions`). Levels are
those of a plane wave at one hydrophone.

**References.** H. L. Van Trees, Optimum Array Processing (2002), chapters 2 and 6;
J. Capon, Proc. IEEE 57 (1969).
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from uwtrack_cli.arrays.array_place import ArrayPlace, check_place, place_of_array
from uwtrack_cli.arrays.beam_peaks import (
    BEAMS_AT_ONCE,
    Beams,
    FormedBeams,
    PeakRules,
    beam_floors,
    find_beam_peaks,
    median_of_beams,
)
from uwtrack_cli.arrays.broadband_directions import DirectionSearch, FoundDirections
from uwtrack_cli.arrays.direction_grid import LOBE_DB, MOST_BEAMS, SpatialArray
from uwtrack_cli.arrays.direction_table import TableFacts, ambiguity_of, direction_table
from uwtrack_cli.arrays.element_check import ElementCheck, with_silent_elements
from uwtrack_cli.arrays.line_array import CLEAR_SHARE, LineArray, Shading
from uwtrack_cli.arrays.spatial_peaks import Lobes, SharedFloor, SpatialBeams, find_spatial_peaks
from uwtrack_cli.arrays.steering import Steering
from uwtrack_cli.data.base import BoolArray, FloatArray, IntArray
from uwtrack_cli.data.bearing_time import MIRROR, BearingTime
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.options import AtLeast, AtMost, Increasing, Unit, checked, resolved_by
from uwtrack_cli.data.peaks import Peaks
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.spectra import FULL_SCALE, MICROPASCAL
from uwtrack_cli.errors import DataError, OptionError, warn
from uwtrack_cli.estimation.angles import wrap_deg
from uwtrack_cli.estimation.noise_floor import TILE_FRAMES
from uwtrack_cli.spectra.frame_transform import FrameTransform
from uwtrack_cli.spectra.spectrogram import (
    describe_frames,
    frame_blocks,
    plan_frames,
    resolve_decimation,
)

FEWEST_STEPS = 32
"""Steps from beam to beam at least: those beyond ahead and astern then reach little farther
than that, and see no grating lobe of the other end (of two hydrophones with 8 steps the
misfit of cones at 0.84 of the design frequency is 1.66 deviations, with 16 0.91)."""

BLOCK_FRAMES = 2 * TILE_FRAMES
"""Frames of a block of conventional beams."""

DIFFUSE_POINTS = 32
"""Frequencies at which noise from all around is looked at."""

LINE_SHARE = 4.0
"""Power over the mean of a beam's cells from which a cell counts no more: of noise, it
leaves out 2 % (exp -4). Lines of 20 and 30 dB lift a beam of 200 cells least there, by 0.1
dB, and noise scatters by 2 % more (studies/constants/bearing_contacts.py)."""

STRIP_CELLS = 16
"""Cells whose beams are formed at once."""

PART_VALUES = 1 << 24
"""Values of beams, frames and cells that are held at once, but for one tile of frames:
64 MB, and as much for their floors."""

SAME_DB = 0.05
"""Height below the main lobe from which a lobe is as high, as far as it is printed."""

MOST_VALUES = 3_000_000
"""Beams times cells of an array that is no line: 16 frames of them are 200 MB."""

Probability = Annotated[float, AtLeast(1e-9), AtMost(0.5)]


def resolve_beams(recording: Recording, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the decimation that the band allows, where it is left open."""
    band_hz, sensor = options["band_hz"], recording.sensor
    drops = options["above_design"] == "drop" and sensor.element_along_m is not None
    if drops and len(sensor.element_places_m) > 1:
        array = LineArray(sensor.element_places_m, sensor.sound_speed_mps)
        clear_hz = CLEAR_SHARE * array.design_frequency_hz
        band_hz = (0.0, clear_hz if band_hz is None else min(band_hz[1], clear_hz))
    return resolve_decimation(recording, {**options, "band_hz": band_hz})


@resolved_by(resolve_beams)
@checked
def form_beams(  # noqa: PLR0913 (frames, beams and peaks are one pass over the sound)
    recording: Recording,
    *,
    window_s: Annotated[float, Unit("s"), AtLeast(1e-6), AtMost(3600)] = 1.0,
    overlap: Annotated[float, AtLeast(0), AtMost(0.999)] = 0.5,
    zero_padding: Annotated[int, AtLeast(1), AtMost(8)] = 2,
    band_hz: Annotated[tuple[float, float], Unit("Hz"), AtLeast(0), AtMost(1e6), Increasing()]
    | None = None,
    decimation: Annotated[int, AtLeast(1), AtMost(1024)] | None = None,
    beams: Annotated[int, AtLeast(5), AtMost(4097)] | None = None,
    shading: Shading | None = None,
    sidelobe_db: Annotated[float, Unit("dB"), AtLeast(15), AtMost(80)] = 30.0,
    beamformer: Literal["conventional", "mvdr"] = "conventional",
    snapshots: Annotated[int, AtLeast(1), AtMost(100_000)] | None = None,
    loading: Annotated[float, AtLeast(0), AtMost(100)] = 0.1,
    false_alarm_probability: Probability = 1e-4,
    kept_probability: Probability = 1e-3,
    side: Literal["starboard", "port"] = "starboard",
    above_design: Literal["drop", "mark"] = "drop",
    frame: Literal["compass", "array"] = "compass",
) -> Iterator[BearingTime]:
    """Form beams of an array, and find peaks in frequency and direction.

    A line array measures the angle between its head and the source, and detects weaker
    lines than one hydrophone. It does not separate port from starboard: bearings are
    written for one side, and tma determines the side when own ship turns. An array of
    another shape measures bearing and elevation, of lines and of broadband sound.

    Parameters
    ----------
    recording
        The recording of an array, opened for reading.
    window_s
        Length of the analysis window, s.
    overlap
        Share of a window that the next one covers again.
    zero_padding
        Spectral cells per natural bin.
    band_hz
        Lowest and highest frequency used, Hz; from where the array is half a wavelength
        long to its design frequency unless given.
    decimation
        Reduce the sample rate by this factor first, as far as the band allows and to
        10 kHz or more unless given.
    beams
        Beams of a line array from astern to ahead; 4 for each hydrophone and one more,
        and 33 or more, unless given.
    shading
        Weights of the hydrophones: uniform detects the weakest lines, chebyshev and
        hann keep strong ones out of other beams. By default chebyshev; arrays that are
        no line are uniform.
    sidelobe_db
        Sidelobes of chebyshev below the main lobe.
    beamformer
        Beams of the bearing-time record: conventional, or mvdr, which separates near
        sources but weakens one between two beams. Peaks are those of conventional
        beams.
    snapshots
        Frames behind a covariance of mvdr, in steps of 16; twice the hydrophones
        unless given.
    loading
        Addition to its diagonal, as a share of the mean power.
    false_alarm_probability
        Probability that noise alone exceeds the threshold, per beam and cell; and that
        a frame of noise has a direction of broadband sound.
    kept_probability
        The same for the weakest peaks kept, not below the first.
    side
        Side that bearings are written for.
    above_design
        What is done above the design frequency of a line array, where directions are
        not unique: drop, or keep and mark. Other arrays always mark.
    frame
        Compass bearings, or angles from the array's head alone.

    Returns
    -------
    Iterator[BearingTime]
        Blocks of the bearing-time record with the peaks found in them.

    Raises
    ------
    OptionError
        An option is out of range, or the band holds too few cells.
    DataError
        The recording is not of an array, has no heading, or too few hydrophones work.

    Notes
    -----
    B(f, u) = sum_n w_n X_n exp(-j 2 pi f x_n u / c), sum w = 1 (Van Trees 2002, section
    2.4). The direction of a tone at f in a cell at f_c, heard by an array that moves
    at v, is u = u' (f_c / f) / (1 - v u' / c).
    """
    if kept_probability < false_alarm_probability:
        raise OptionError(
            "kept_probability must be at least false_alarm_probability = "
            f"{false_alarm_probability:g}, got {kept_probability:g}."
        )
    array = _array_of(recording)
    is_line = isinstance(array, LineArray)
    if not is_line and (beams is not None or shading not in {None, "uniform"}):
        raise OptionError(
            "beams and shading are those of a line array; array "
            f"{recording.sensor.id!r} is none, and its beams are uniform: leave "
            f"{'shading' if beams is None else 'beams'} out."
        )
    shading = shading or "chebyshev"
    check_place(recording, needs_heading=frame == "compass")
    n_elements = len(recording.sensor.element_xyz_m)
    given_band = {"band_hz": band_hz, "decimation": decimation, "above_design": above_design}
    used = {**given_band, **resolve_beams(recording, given_band)}
    layout = plan_frames(recording, window_s, overlap, zero_padding, band_hz, used["decimation"])
    layout = replace(layout, kept=_band(layout, array, band_hz, above_design))
    block_frames = BLOCK_FRAMES
    if beamformer == "mvdr":
        wanted = 2 * n_elements if snapshots is None else snapshots
        if wanted < n_elements and loading == 0.0:
            raise OptionError(
                f"{wanted} snapshots of {n_elements} hydrophones have no inverse: give "
                f"at least {2 * n_elements}, or loading above 0."
            )
        block_frames = -(-wanted // TILE_FRAMES) * TILE_FRAMES
    rules = PeakRules(
        false_alarm_probability=false_alarm_probability,
        kept_probability=kept_probability,
        side=side,
        compass=frame == "compass",
        reference=FULL_SCALE if recording.sensor.full_scale_upa is None else MICROPASCAL,
    )
    given: dict[str, Any] = {
        "recording": recording,
        "layout": layout,
        "weights": np.full(n_elements, 1.0 / n_elements),
        "shading": shading if is_line else "uniform",
        "loading": loading if beamformer == "mvdr" else None,
        "rules": rules,
    }
    former: _BeamFormer
    if isinstance(array, LineArray):
        given["weights"] = array.weights(shading, sidelobe_db)
        former = _LineFormer(array=array, n_beams=_beam_count(array, beams), **given)
    else:
        former = _SpatialFormer(array=array, **given)
    if is_line and beamformer == "conventional":
        block_frames = min(block_frames, former.part_frames)
    return former.blocks(block_frames)


def _beam_count(array: LineArray, beams: int | None) -> int:
    n_beams = max(4 * array.n_places, FEWEST_STEPS) + 1 if beams is None else beams
    if n_beams < 2 * array.n_places + 1:
        raise OptionError(
            f"beams must be at least {2 * array.n_places + 1} for {array.n_places} "
            f"places of hydrophones, got {n_beams}: sources between beams are lost."
        )
    return n_beams


def _array_of(recording: Recording) -> LineArray | SpatialArray:
    sensor = recording.sensor
    if not len(sensor.element_xyz_m):
        raise DataError(
            f"{recording.name} was recorded by {sensor.kind} sensor {sensor.id!r}; "
            f'beams need kind = "array" with element_along_m or element_positions_m in '
            f"its sensor file (--sensor), and no --channel."
        )
    if sensor.element_positions_m is not None:
        return SpatialArray(sensor.element_xyz_m, sensor.sound_speed_mps)
    return LineArray(sensor.element_places_m, sensor.sound_speed_mps)


def _band(
    layout: FrameTransform,
    array: LineArray | SpatialArray,
    band_hz: tuple[float, float] | None,
    above_design: str,
) -> slice:
    """Return the cells in which directions can be told; say what is left out."""
    cells = np.fft.rfftfreq(layout.fft_length, 1.0 / layout.rate_hz)
    # two hydrophones are half a wavelength long at their design frequency alone
    longest = 4.0 if (isinstance(array, LineArray) and array.n_places == 2) else 2.0
    lowest_hz = array.sound_speed_mps / (longest * array.aperture_m)
    highest_hz = float(layout.frequency_hz[-1])
    low, high = band_hz or (lowest_hz, highest_hz)
    high = min(high, highest_hz)
    clear_hz = high
    if isinstance(array, LineArray):
        clear_hz = CLEAR_SHARE * array.design_frequency_hz
    if isinstance(array, LineArray) and above_design == "drop" and high > clear_hz:
        warn(
            f"hydrophones {array.spacing_m:g} m apart tell directions up to their "
            f"design frequency of {array.design_frequency_hz:.0f} Hz: the band ends at "
            f"{clear_hz:.0f} Hz (--above-design mark keeps what is above)."
        )
        high = clear_hz
    inside = np.flatnonzero((cells[1:-1] >= low) & (cells[1:-1] <= high)) + 1
    if isinstance(array, SpatialArray):
        beams = array.beams_needed(cells[inside])
        values = beams * (1 + np.arange(inside.size))
        if inside.size and beams[0] > MOST_BEAMS:
            raise OptionError(
                f"with {array.aperture_m:.4g} m between hydrophones, all directions "
                f"take {beams[0]:.0f} beams at {cells[inside[0]]:.4g} Hz already, more "
                f"than time and memory allow ({MOST_BEAMS}): are the positions in "
                f"metres? Give a lower --band-hz."
            )
        inside = inside[(beams <= MOST_BEAMS) & (values <= MOST_VALUES)]
        if 0 < inside.size < beams.size:
            warn(
                f"with {array.aperture_m:.4g} m between hydrophones, all directions "
                f"take {beams[-1]:.0f} beams at {high:.4g} Hz, more than time and memory "
                f"allow: the band ends at {cells[inside[-1]]:.4g} Hz."
            )
    if inside.size < 8:
        raise OptionError(
            f"the band from {low:.6g} to {high:.6g} Hz holds {inside.size} cells; at "
            f"least 8 are needed: give --band-hz or a longer --window-s."
        )
    return slice(int(inside[0]), int(inside[-1]) + 1)


@dataclass(kw_only=True)
class _BeamFormer(ABC):
    """Turns the blocks of one recording into beams."""

    recording: Recording
    """The recording."""
    layout: FrameTransform
    """How its sound is cut into frames."""
    weights: FloatArray
    """Weights of the hydrophones, shape (element,)."""
    shading: str
    """What the weights are."""
    loading: float | None
    """Loading of MVDR; None for conventional beams."""
    rules: PeakRules
    """What counts as a peak."""
    _frequency_hz: FloatArray = field(init=False)
    """Frequency of every cell, Hz."""
    _turns: Steering = field(init=False)
    """Turns of every hydrophone for every beam."""
    _check: ElementCheck = field(init=False)
    """Watches for hydrophones that fail."""

    def __post_init__(self) -> None:
        """Take the band from the layout."""
        self._frequency_hz = self.layout.frequency_hz

    def blocks(self, block_frames: int) -> Iterator[BearingTime]:
        """Yield the beams of the recording, so many frames at a time."""
        for heard, first, count in frame_blocks(self.recording, self.layout, block_frames):
            samples = with_silent_elements(heard)
            frames = describe_frames(self.recording, self.layout, samples, first, count)
            whole = bool((frames.valid_fraction == 1.0).all())
            yield from self._block(samples if whole else np.nan_to_num(samples), frames)

    def _block(self, samples: FloatArray, frames: Frames) -> Iterator[BearingTime]:
        """Yield the record of a block, as many frames at once as memory holds."""
        spectra = self.layout.spectra_of_all(samples, frames.n_frames)
        alive = self._check.alive(spectra, self._frequency_hz, float(frames.time_s[0]))
        spectra = self._check.upright(spectra)
        weights = np.where(alive, self.weights, 0.0)
        weights = weights / weights.sum()
        directions = self._directions(spectra, alive, frames)
        mvdr = None if self.loading is None else self._mvdr(spectra, alive)
        step = self.part_frames
        for first in range(0, frames.n_frames, step):
            rows = slice(first, first + step)
            part = frames.take("frame", rows)
            power = self._power(spectra[:, :, rows], weights)
            shown = power if mvdr is None else np.broadcast_to(mvdr, power.shape)
            place = place_of_array(self.recording.sensor, part)
            formed = FormedBeams(
                weights=weights,
                frequency_hz=self._frequency_hz,
                power=power,
                frames=part,
                place=place,
            )
            heard = directions and directions.of_part(rows)
            yield self._found(formed, shown, heard)

    @property
    @abstractmethod
    def part_frames(self) -> int:
        """Frames whose beams are held at once: whole tiles."""

    def _directions(
        self,
        spectra: NDArray[np.complex64],  # noqa: ARG002 - of those that tell directions
        alive: BoolArray,  # noqa: ARG002
        frames: Frames,  # noqa: ARG002
    ) -> FoundDirections | None:
        """Return the directions of broadband sound of a block, if the array tells them."""
        return None

    def _mvdr(self, spectra: NDArray[np.complex64], alive: BoolArray) -> FloatArray:
        """Return the power of beams of minimum variance, shape (beam, 1, cell)."""
        found = np.empty((self._turns.n_beams, 1, len(spectra)))
        turns = self._turns.of_elements(alive)
        for cells in _strips(len(spectra)):
            loading = float(self.loading or 0)
            made = mvdr_power(spectra[cells][:, alive], turns[cells], loading)
            found[:, 0, cells] = made.T
        return found

    @abstractmethod
    def _found(
        self, formed: FormedBeams, shown: FloatArray, directions: FoundDirections | None
    ) -> BearingTime:
        """Return the record of a part of a block with what was found in it.

        Peaks are found in the conventional beams ``formed``; ``shown`` is the density of
        the beams of the record, shape (beam, frame, cell).
        """

    def _power(self, spectra: NDArray[np.complex64], weights: FloatArray) -> FloatArray:
        """Power density of every beam, shape (beam, frame, cell)."""
        n_cells, _, n_frames = spectra.shape
        found = np.empty((self._turns.n_beams, n_frames, n_cells), np.float32)
        for cells in _strips(n_cells):
            weighted = spectra[cells] * weights.astype(np.float32)[:, None]
            pressure = self._turns[cells] @ weighted
            power = pressure.real**2 + pressure.imag**2
            found[:, :, cells] = power.transpose(1, 2, 0)
        return found

    def _record(
        self, shown: FloatArray, noise: FloatArray, peaks: Peaks, place: ArrayPlace, **own: Any
    ) -> BearingTime:
        frames = peaks.frames
        with np.errstate(divide="ignore", invalid="ignore"):
            level_db = 10.0 * np.log10(shown.sum(axis=2) * frames.bin_hz).T
            mean = [_broadband_mean(one / noise) for one in _beams_at_once(shown)]
            excess_db = 10.0 * np.log10(np.concatenate(mean)).T
        silent = frames.valid_fraction < 0.5
        level_db[silent], excess_db[silent] = np.nan, np.nan
        return BearingTime(
            frames=frames,
            level_db=level_db,
            excess_db=excess_db,
            east_m=place.east_m,
            north_m=place.north_m,
            heading_deg=place.heading_deg,
            bend_deg=place.bend_deg,
            band_low_hz=float(self._frequency_hz[0]),
            band_high_hz=float(self._frequency_hz[-1]),
            shading=self.shading,
            beamformer="conventional" if self.loading is None else "mvdr",
            side=self.rules.side,
            reference=self.rules.reference,
            peaks=peaks,
            **own,
        )


@dataclass(kw_only=True)
class _LineFormer(_BeamFormer):
    """Beams of a line array, evenly spaced in the cosine with its head."""

    array: LineArray
    """The hydrophones."""
    n_beams: int
    """Number of beams."""

    def __post_init__(self) -> None:
        """Prepare the turns of every hydrophone for every beam."""
        super().__post_init__()
        self._cosines = self.array.beam_cosines(self.n_beams)
        self._turns = Steering(self._frequency_hz, self.array.lead_s(self._cosines))
        some = np.linspace(0, self._frequency_hz.size - 1, DIFFUSE_POINTS).astype(int)
        self._diffuse = self.array.diffuse_power(
            self._frequency_hz[some], self._cosines, self.weights
        )
        self._check = ElementCheck(
            self.recording.sensor.channel_names,
            self.array.along_m,
            self.array.design_frequency_hz / 2.0,
        )

    @property
    def part_frames(self) -> int:
        tile_values = self._turns.n_beams * self._frequency_hz.size * TILE_FRAMES
        return TILE_FRAMES * max(1, PART_VALUES // tile_values)

    def _found(
        self,
        formed: FormedBeams,
        shown: FloatArray,
        directions: FoundDirections | None,  # noqa: ARG002 - a line has none
    ) -> BearingTime:
        beams = Beams(**vars(formed), array=self.array, cos_angle=self._cosines)
        floor = beam_floors(formed.power, formed.frames)
        noise = _median_over(floor, np.arange(len(floor)))
        peaks = find_beam_peaks(beams, floor, noise, self.rules)
        return self._record(
            shown,
            noise,
            peaks,
            formed.place,
            cos_angle=self._cosines,
            diffuse_power=self._diffuse,
            sidelobe_db=self.array.sidelobe_db(formed.weights),
            design_frequency_hz=self.array.design_frequency_hz,
            ambiguity=MIRROR if self.rules.compass else "none",
        )


@dataclass(kw_only=True)
class _SpatialFormer(_BeamFormer):
    """Beams of a planar or volume array, over all directions that it hears."""

    array: SpatialArray

    def __post_init__(self) -> None:
        """Prepare the beams, what they cannot tell apart, and the search."""
        super().__post_init__()
        array, names = self.array, self.recording.sensor.channel_names
        self._grid = array.grid(float(self._frequency_hz[-1]))
        self._turns = Steering(self._frequency_hz, array.lead_s(self._grid.toward))
        self._lobes = Lobes.of(array, self._grid, self._frequency_hz)
        padding = round(self.layout.fft_length / self.layout.window)
        self._natural = slice(0, None, max(1, padding))
        self._natural_turns = self._turns.thinned(max(1, padding))
        self._search = DirectionSearch(
            array, self._grid, self._frequency_hz[self._natural], self.rules.false_alarm_probability
        )
        # the nearest hydrophones are those whose signs can be compared
        self._check = ElementCheck(
            names,
            np.arange(len(names), dtype=float),
            array.sound_speed_mps / (4.0 * array.aperture_m),
        )
        self._tell_lobes()

    @property
    def part_frames(self) -> int:
        return TILE_FRAMES

    def _tell_lobes(self) -> None:
        """Say from where on in the band the array has lobes that may be mistaken."""
        lobes = self._lobes
        high = np.flatnonzero(lobes.share > 10.0 ** (-LOBE_DB / 10.0))
        if not high.size:
            return
        first_hz = float(lobes.frequency_hz[high[0]])
        at_hz = float(lobes.frequency_hz[int(np.argmax(lobes.share))])
        below_db = -10.0 * np.log10(float(lobes.share.max()))
        height = (
            "another direction looks the same as the right one"
            if below_db < SAME_DB
            else f"a lobe reaches within {below_db:.1f} dB of the main one"
        )
        warn(
            f"hydrophones {self.array.closest_m:.4g} m apart and more are sparse for "
            f"this band: lines from {first_hz:.4g} Hz on may be given a wrong direction "
            f"(at {at_hz:.4g} Hz {height}). Such peaks are marked (is_aliased); other "
            f"directions that explain the broadband sound of a frame are listed as its "
            f"lobes."
        )

    def _directions(
        self, spectra: NDArray[np.complex64], alive: BoolArray, frames: Frames
    ) -> FoundDirections:
        return self._search.find(
            spectra[self._natural], self._natural_turns, alive, frames.valid_fraction == 1.0
        )

    def _found(
        self, formed: FormedBeams, shown: FloatArray, directions: FoundDirections | None
    ) -> BearingTime:
        power, frames, place = formed.power, formed.frames, formed.place
        beams = SpatialBeams(**vars(formed), array=self.array, grid=self._grid, lobes=self._lobes)
        centres, owner = self._grid.floor_beams
        floor = beam_floors(power[centres], frames)
        noise = _median_over(floor, owner)
        peaks = find_spatial_peaks(beams, SharedFloor(floor, owner), noise, self.rules)
        found = directions or FoundDirections.none()
        facts = TableFacts(
            time_s=frames.time_s,
            heading_deg=place.heading_deg,
            first_frame=frames.first_frame,
            start_utc_ns=frames.start_utc_ns,
            probability=self.rules.false_alarm_probability,
            band_hz=(float(self._frequency_hz[0]), float(self._frequency_hz[-1])),
            method="beams",
            reference=self.rules.reference,
        )
        level = power[found.beam, found.frame].sum(axis=1) * frames.bin_hz
        return self._record(
            self._loudest(shown),
            noise,
            peaks,
            place,
            azimuth_deg=self._azimuth_deg,
            design_frequency_hz=self.array.sound_speed_mps / (2.0 * self.array.closest_m),
            ambiguity=ambiguity_of(self.array),
            directions=direction_table(
                found, self.array, self.recording.sensor, facts, 10.0 * np.log10(level)
            ),
        )

    @cached_property
    def _azimuth_deg(self) -> FloatArray:
        count = max(8, int(2.0 * np.pi / self._grid.step))
        return 360.0 / count * np.arange(count)

    def _loudest(self, power: FloatArray) -> FloatArray:
        """Return power over azimuth: in every cell that of the loudest elevation."""
        toward, step = self._grid.toward, 360.0 / self._azimuth_deg.size
        own = np.degrees(np.arctan2(toward[:, 0], toward[:, 1])) % 360.0
        level = np.hypot(toward[:, 0], toward[:, 1])
        found = np.zeros((self._azimuth_deg.size, *power.shape[1:]), power.dtype)
        for row, azimuth in enumerate(self._azimuth_deg):
            apart = np.abs(wrap_deg(own - azimuth))
            near = (apart <= step) & (level > 0.3) & (level <= 1.0 + self._grid.step)
            chosen = np.flatnonzero(near) if near.any() else [int(np.argmin(apart))]
            found[row] = power[chosen].max(axis=0)
        return found


def _broadband_mean(ratio: FloatArray) -> FloatArray:
    """Mean over the cells in which lines count as much as strong noise.

    A line would lift its own beam and, in its main lobe, those of other contacts.
    """
    mean: FloatArray = ratio.mean(axis=2)
    for _ in range(2):  # lines that raised the first mean do not raise the second
        mean = np.minimum(ratio, LINE_SHARE * mean[:, :, None]).mean(axis=2)
    return mean / np.float32(1.0 - np.exp(-LINE_SHARE))


def _median_over(floor: FloatArray, owner: IntArray) -> FloatArray:
    """Return the median over the beams of floors that they share, shape (frame, cell)."""
    noise = np.empty(floor.shape[1:], np.float32)
    for cells in _strips(floor.shape[2]):
        noise[:, cells] = median_of_beams(floor[:, :, cells][owner])
    return noise


def _beams_at_once(power: FloatArray) -> Iterator[FloatArray]:
    """Yield some of the beams after the other."""
    for first in range(0, len(power), BEAMS_AT_ONCE):
        yield power[first : first + BEAMS_AT_ONCE]


def _strips(n_cells: int) -> Iterator[slice]:
    """Cut the cells into strips, whose beams stay in the cache."""
    for first in range(0, n_cells, STRIP_CELLS):
        yield slice(first, first + STRIP_CELLS)


def mvdr_power(
    spectra: NDArray[np.complex64], steering: NDArray[np.complex64], loading: float
) -> FloatArray:
    """Return 1 / (v^H (R + e I)^-1 v) of every cell and beam, shape (cell, beam).

    Minimum-variance beams (Capon 1969) pass a direction unchanged and let the least of
    all else through. R is the mean over the frames of spectra (cell, element, frame); a
    share of the mean power of a hydrophone is added to its diagonal, so that a source
    between two beams is not suppressed as if it were noise (Carlson 1988, IEEE Trans.
    Aerosp. Electron. Syst. 24). Steering has the shape (cell, beam, element).
    """
    wide = spectra.astype(np.complex128)
    n_elements, n_frames = wide.shape[1:]
    covariance = wide @ wide.conj().transpose(0, 2, 1) / n_frames
    trace = np.trace(covariance, axis1=1, axis2=2).real / n_elements
    floor = np.maximum(loading * trace, np.finfo(np.float32).tiny)
    inverse = np.linalg.inv(covariance + floor[:, None, None] * np.eye(n_elements))
    turned = steering.astype(np.complex128)
    denominator = ((turned @ inverse) * turned.conj()).sum(axis=2).real
    return np.asarray(1.0 / denominator)
