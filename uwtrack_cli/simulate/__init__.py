"""Truth to measurements, seeded; shares no formula with the estimators."""

from uwtrack_cli.simulate.recordings import simulate_recordings
from uwtrack_cli.simulate.scenario import Scenario, make_scenario
from uwtrack_cli.simulate.scenario_truth import truth

__all__ = ["Scenario", "make_scenario", "simulate_recordings", "truth"]
