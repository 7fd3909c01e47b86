"""Fits held against their own data: levels that stand still, halves that disagree."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from tests.draws.passage_truth import Scene, received, true_motion
from tests.motion.passing_vessel import lines_of_scenes
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.motion.cpa import find_encounters
from uwtrack_cli.motion.passage.candidates import (
    RecordingSpan,
    examine_contacts,
    has_closest_approach,
    tell_once,
)
from uwtrack_cli.motion.passage.checks.fit_checks import (
    check_fit,
    count_stationary_lines,
    doppler_misfit,
)
from uwtrack_cli.motion.passage.fit.nuisances import nuisance_priors

SCENE = Scene(rest_hz=(120.0, 180.0))
DIFAR = Sensor(id="h1", kind="difar", depth_m=22.0)
MEDIUM = nuisance_priors(DIFAR, None, None, 3.0, 2.0).medium


def lines_of(*scenes, seed=2):
    return lines_of_scenes([*scenes], np.random.default_rng(seed))


def candidate_of(lines):
    (one,) = examine_contacts(lines, MEDIUM, 1e-3)[0]
    return one


def test_lines_whose_levels_stand_still_are_no_passage():
    lines = lines_of(SCENE)
    steady = replace(lines, measured_level_db=np.full(lines.line.size, 100.0))
    found = find_encounters(steady, None, DIFAR)
    assert found.n_encounters == 0
    assert found.refused_code[0] == "line-levels"


@pytest.mark.parametrize("share", [0.7, 0.2])
def test_a_level_that_stays_speaks_against_bearings_that_turn(share):
    """A line that keeps its frequency: two that beat swing between two bearings."""
    lines = lines_of(replace(SCENE, rest_hz=(120.0,)))
    mean = lines.measured_level_db.mean()
    steady = replace(
        lines,
        measured_frequency_hz=120.0 + 0.003 * np.random.default_rng(4).normal(size=lines.line.size),
        measured_level_db=mean + share * (lines.measured_level_db - mean),
    )
    found = find_encounters(steady, None, DIFAR)
    of_levels = dict(candidate_of(steady).decision.nepers)["line-levels"]
    assert (of_levels > 1.0) is (share > 0.5)
    assert found.n_encounters == 1


def test_the_misfit_is_the_share_of_the_shift_by_which_lines_leave_their_curve():
    one = candidate_of(lines_of(SCENE))
    assert doppler_misfit(one.fit, one.blocks) < 0.02
    mach = SCENE.speed_mps / 1500.0
    wave = 0.5 * mach * np.sqrt(2) * np.sin(one.blocks.time_s / 23.0)
    value = one.blocks.value.copy()
    value[:, one.blocks.parts[0]] += wave
    bent = replace(one.blocks, value=value)
    # the median of a sine's square is its mean, a normal variable's 0.455 of it
    due = 0.5 / np.sqrt(0.455)
    assert doppler_misfit(one.fit, bent) == pytest.approx(due, rel=0.15)


@pytest.mark.parametrize("n_still", [0, 1, 2])
def test_lines_that_stand_still_are_counted_and_speak_against_one_vessel(n_still):
    lines = lines_of(replace(SCENE, rest_hz=(120.0, 180.0, 240.0)))
    one = candidate_of(lines)
    value, noise = one.blocks.value.copy(), np.random.default_rng(6)
    for part in one.blocks.parts[:2]:
        rows = value[0, part]
        rows[:n_still] = 1e-5 * noise.normal(size=rows[:n_still].shape)
    blocks = replace(one.blocks, value=value)
    assert count_stationary_lines(one.fit, blocks) == (n_still, 3)
    checked = check_fit(replace(one, blocks=blocks))
    against = dict(checked.decision.nepers)["stationary-lines"]
    assert (against < -0.25) is (n_still > 1)


@pytest.mark.parametrize(("gain", "is_told"), [(6.0, True), (14.0, False)])
def test_a_line_stands_still_from_a_gain_in_likelihood_of_9_nepers_on(gain, is_told):
    """As much as 1 in 10,000 passages loses: half the chi-square that is as rare."""
    one = candidate_of(lines_of(replace(SCENE, rest_hz=(120.0, 180.0, 240.0))))
    assert 6.0 < 0.5 * chi2.isf(1e-4, 2) < 14.0
    frequencies, bearings, _ = one.blocks.parts
    value, weight = one.blocks.value.copy(), one.blocks.weight.copy()
    still = value[0, frequencies][:2]
    still[:] = 0.0
    weight[0, bearings][:2] = 0.0
    ratio, *_ = received(SCENE, one.blocks.time_s, true_motion(SCENE))
    own = weight[0, frequencies][:2] / one.fit.noises[0].scale[0][:2, None] ** 2
    lost = 0.5 * (own * (ratio - np.median(ratio)) ** 2).sum(axis=1)
    weight[0, frequencies][:2] *= (gain / lost)[:, None]
    blocks = replace(one.blocks, value=value, weight=weight)
    assert (count_stationary_lines(one.fit, blocks)[0] == 0) is is_told


def test_a_passage_of_one_motion_keeps_its_deviations():
    one = candidate_of(lines_of(SCENE))
    checked = check_fit(one)
    assert checked.passes
    widened = np.diag(checked.fit.covariance[0]) / np.diag(one.fit.covariance[0])
    assert (widened < 2.0).all()


def test_halves_of_two_speeds_widen_what_they_disagree_about():
    slow, fast = (lines_of(replace(SCENE, speed_mps=v, range_m=40 * v)) for v in (5, 7))
    late = slow.time_s > SCENE.closest_s
    frequency = np.where(late, fast.measured_frequency_hz, slow.measured_frequency_hz)
    lines = replace(slow, measured_frequency_hz=frequency)
    one = candidate_of(lines)
    checked = check_fit(one)
    widened = np.sqrt(checked.fit.covariance[0, 2, 2] / one.fit.covariance[0, 2, 2])
    assert widened > 1.5


def test_one_passage_of_two_contacts_is_told_once():
    lines = lines_of(SCENE)
    unknown = np.full(lines.time_s.size, np.nan)
    one = candidate_of(replace(lines, measured_bearing_deg=unknown))
    theta = one.fit.theta.copy()
    theta[0, 0] += 40.0
    again = replace(one, contacts=(9,))
    other = replace(one, contacts=(10,), fit=replace(one.fit, theta=theta))
    told = {item.contacts[0]: item for item in tell_once([one, again, other])}
    assert told[1].passes
    assert told[10].passes
    assert told[9].rejection.code == "duplicate"


def test_contacts_that_fit_together_tell_the_passage_together():
    lines = lines_of(SCENE)
    unknown = np.full(lines.time_s.size, np.nan)
    one = candidate_of(replace(lines, measured_bearing_deg=unknown))
    again = replace(one, contacts=(9,))
    both = replace(one, contacts=(1, 9))
    assert tell_once([one, again], lambda *_: both) == [both]
    doubtful = both.measured(stationary_share=1.0, n_lines=20.0, line_level=-100.0)
    for refused in (None, doubtful):
        first, second = tell_once([one, again], lambda *_, made=refused: made)
        assert first is one
        assert second.rejection.sentence.startswith("the passage of contact 1")


def test_bearings_decide_whether_two_contacts_are_one_vessel():
    one = candidate_of(lines_of(SCENE))
    turned = replace(one.fit, bearing_deg=one.fit.bearing_deg + 60.0)
    again = replace(one, contacts=(9,))
    other = replace(one, contacts=(10,), fit=turned)
    told = {item.contacts[0]: item for item in tell_once([one, again, other])}
    assert told[1].passes
    assert told[10].passes
    assert told[9].rejection.code == "duplicate"


def test_a_line_whose_bearings_are_anothers_widens_the_course():
    """By what the course moves without it; the fit alone would be sure of the mean."""
    lines = lines_of(replace(SCENE, rest_hz=(120.0, 180.0, 240.0)))
    strange = lines.line == lines.line_id[2]
    turned = np.where(strange, 15.0, 0.0) + lines.measured_bearing_deg
    mixed = replace(lines, measured_bearing_deg=turned % 360.0)
    alone, wider = (find_encounters(one, None, DIFAR) for one in (lines, mixed))
    off = wider.course_deg[0] - alone.course_deg[0]
    assert 2.0 < abs(off) < 3.0 * wider.course_std_deg[0]
    assert wider.course_std_deg[0] > 1.5 * alone.course_std_deg[0]


@pytest.mark.parametrize(("width_s", "turns"), [(1842.0, False), (388.0, True)])
def test_a_passage_that_hardly_turns_within_the_recording_is_none(width_s, turns):
    """Over 18 degrees of the line of sight a machine that drifts has the same lines."""
    fit = SimpleNamespace(
        range_over_speed_s=np.array([width_s]), theta=np.array([[570.0, 2.0, 6.5, 0.0]]),
        covariance=np.diag([10.0, 0.01 * width_s**2, 1.0, 1.0])[None],
    )  # fmt: skip
    blocks = SimpleNamespace(
        time_s=np.linspace(0.5, 589.5, 590),
        **dict.fromkeys(
            ("shift", "bearing", "level"), SimpleNamespace(weight=np.ones((1, 1, 590)))
        ),
    )
    span = RecordingSpan(1.0, 0.0, 600.0)
    assert has_closest_approach(fit, blocks, span) is turns
