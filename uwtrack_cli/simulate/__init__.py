"""Truth to measurements, seeded; shares no formula with the estimators."""

from uwtrack_cli.simulate.recordings import simulate_recordings
from uwtrack_cli.simulate.scenario import Scenario
from uwtrack_cli.simulate.table import from_table
from uwtrack_cli.simulate.truth import truth

__all__ = ["Scenario", "from_table", "simulate_recordings", "truth"]
