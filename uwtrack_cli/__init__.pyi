"""Types of the public names: see `__init__.py`, which imports them when used."""

from uwtrack_cli.arrays.beamform import (
    form_beams as form_beams,
)
from uwtrack_cli.arrays.delays import (
    measure_delays as measure_delays,
)
from uwtrack_cli.arrays.directions import (
    find_directions as find_directions,
)
from uwtrack_cli.arrays.track_bearings import (
    track_bearings as track_bearings,
)
from uwtrack_cli.clutter.pdaf import (
    track_in_clutter as track_in_clutter,
)
from uwtrack_cli.data.base import (
    Container as Container,
)
from uwtrack_cli.data.bearing_time import (
    BearingTime as BearingTime,
)
from uwtrack_cli.data.decidecades import (
    Decidecades as Decidecades,
)
from uwtrack_cli.data.decidecades import (
    RadiatedLevels as RadiatedLevels,
)
from uwtrack_cli.data.decisions import (
    Decision as Decision,
)
from uwtrack_cli.data.directions import (
    Delays as Delays,
)
from uwtrack_cli.data.directions import (
    Directions as Directions,
)
from uwtrack_cli.data.encounters import (
    Encounters as Encounters,
)
from uwtrack_cli.data.encounters import (
    Fixes as Fixes,
)
from uwtrack_cli.data.frames import (
    Frames as Frames,
)
from uwtrack_cli.data.fringes import (
    Fringes as Fringes,
)
from uwtrack_cli.data.lines import (
    Lines as Lines,
)
from uwtrack_cli.data.motions import (
    Motions as Motions,
)
from uwtrack_cli.data.peaks import (
    Families as Families,
)
from uwtrack_cli.data.peaks import (
    Peaks as Peaks,
)
from uwtrack_cli.data.presence import (
    Presence as Presence,
)
from uwtrack_cli.data.recording import (
    Lock as Lock,
)
from uwtrack_cli.data.recording import (
    RecordedFiles as RecordedFiles,
)
from uwtrack_cli.data.recording import (
    Recording as Recording,
)
from uwtrack_cli.data.scans import (
    Contacts as Contacts,
)
from uwtrack_cli.data.scans import (
    Roc as Roc,
)
from uwtrack_cli.data.scans import (
    Scans as Scans,
)
from uwtrack_cli.data.sensor import (
    Navigation as Navigation,
)
from uwtrack_cli.data.sensor import (
    Sensor as Sensor,
)
from uwtrack_cli.data.series import (
    Series as Series,
)
from uwtrack_cli.data.spectra import (
    Levels as Levels,
)
from uwtrack_cli.data.spectra import (
    Overview as Overview,
)
from uwtrack_cli.data.spectra import (
    Spectrogram as Spectrogram,
)
from uwtrack_cli.data.targets import (
    Target as Target,
)
from uwtrack_cli.data.transients import (
    Transients as Transients,
)
from uwtrack_cli.discrimination.discriminate import (
    discriminate_contacts as discriminate_contacts,
)
from uwtrack_cli.errors import (
    DataError as DataError,
)
from uwtrack_cli.errors import (
    OptionError as OptionError,
)
from uwtrack_cli.errors import (
    OutputError as OutputError,
)
from uwtrack_cli.errors import (
    UwtrackError as UwtrackError,
)
from uwtrack_cli.errors import (
    UwtrackWarning as UwtrackWarning,
)
from uwtrack_cli.files.audio.recording_file import (
    open_recording as open_recording,
)
from uwtrack_cli.files.hdf5.product import (
    Product as Product,
)
from uwtrack_cli.files.hdf5.product import (
    read_product as read_product,
)
from uwtrack_cli.files.hdf5.product import (
    write_product as write_product,
)
from uwtrack_cli.files.tables.dataframes import (
    to_pandas as to_pandas,
)
from uwtrack_cli.files.tables.dataframes import (
    to_xarray as to_xarray,
)
from uwtrack_cli.files.tables.sensors import (
    find_sensor as find_sensor,
)
from uwtrack_cli.flow.engine import (
    run_recipe as run_recipe,
)
from uwtrack_cli.flow.recipe import (
    Recipe as Recipe,
)
from uwtrack_cli.flow.results import (
    Results as Results,
)
from uwtrack_cli.flow.results import (
    SourceOptions as SourceOptions,
)
from uwtrack_cli.flow.results import (
    read_results as read_results,
)
from uwtrack_cli.flow.results import (
    run as run,
)
from uwtrack_cli.flow.shipped_recipes import (
    copy_sample as copy_sample,
)
from uwtrack_cli.flow.shipped_recipes import (
    load_recipe as load_recipe,
)
from uwtrack_cli.lines.classify import (
    classify_peaks as classify_peaks,
)
from uwtrack_cli.lines.trace import (
    trace_lines as trace_lines,
)
from uwtrack_cli.lines.track import (
    track_lines as track_lines,
)
from uwtrack_cli.lines.track_pda import (
    track_lines_pda as track_lines_pda,
)
from uwtrack_cli.motion.cpa import (
    find_encounters as find_encounters,
)
from uwtrack_cli.motion.locate import (
    locate_vessels as locate_vessels,
)
from uwtrack_cli.motion.tma import (
    estimate_motion as estimate_motion,
)
from uwtrack_cli.presence.presence import (
    find_presence as find_presence,
)
from uwtrack_cli.simulate import (
    make_scenario as make_scenario,
)
from uwtrack_cli.simulate import (
    simulate_recordings as simulate_recordings,
)
from uwtrack_cli.spectra.demon import (
    demodulate as demodulate,
)
from uwtrack_cli.spectra.levels import (
    measure_levels as measure_levels,
)
from uwtrack_cli.spectra.overview import (
    pool_overview as pool_overview,
)
from uwtrack_cli.spectra.peaks import (
    find_peaks as find_peaks,
)
from uwtrack_cli.spectra.spectrogram import (
    compute_spectrogram as compute_spectrogram,
)
from uwtrack_cli.spectra.transients import (
    find_transients as find_transients,
)

__version__: str
