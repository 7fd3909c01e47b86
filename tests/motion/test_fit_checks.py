"""Fits held against their own data: levels that stand still, halves that disagree."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from tests.draws.passage_truth import Scene, received, true_motion
from tests.motion.passing_vessel import lines_of_scenes
from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.motion.cpa import find_encounters
from uwtrack_cli.motion.decision import reject
from uwtrack_cli.motion.passage.candidates import (
    RecordingSpan,
    examine_contacts,
    not_a_passage,
    tell_once,
)
from uwtrack_cli.motion.passage.checks import fit_checks
from uwtrack_cli.motion.passage.checks.fit_checks import (
    check_fit,
    doppler_misfit,
    level_slope,
    stationary_lines,
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


def test_levels_of_a_passage_follow_the_range():
    lines = lines_of(SCENE)
    slope, std = level_slope(candidate_of(lines), lines)
    assert slope == pytest.approx(1.0, abs=0.02)  # 20 dB a decade, by the fixture
    assert std < 0.1


def test_lines_whose_levels_stand_still_are_no_passage():
    lines = lines_of(SCENE)
    steady = replace(lines, measured_level_db=np.full(lines.line.size, 100.0))
    found = find_encounters(steady, None, DIFAR)
    assert found.n_encounters == 0
    ((_, _, _, reason),) = found.refusals()
    assert "do not rise and fall" in reason


@pytest.mark.parametrize(("share", "is_told"), [(0.7, True), (0.4, False)])
def test_a_line_alone_must_follow_the_range_more_than_not(share, is_told):
    """Half-way between one, a passage's slope, and zero, a machine's."""
    lines = lines_of(replace(SCENE, rest_hz=(120.0,)))
    mean = lines.measured_level_db.mean()
    flat = mean + share * (lines.measured_level_db - mean)
    unknown = np.full(lines.line.size, np.nan)
    alone = replace(lines, measured_level_db=flat, measured_bearing_deg=unknown)
    against = check_fit(candidate_of(alone), alone).rejections
    assert [one.code for one in against] == ([] if is_told else ["line-levels"])
    heard = replace(lines, measured_level_db=flat)  # bearings show the passage, too
    assert not check_fit(candidate_of(heard), heard).rejections


@pytest.mark.parametrize("is_known", [True, False])
def test_bearings_speak_for_a_line_alone_if_they_tell_a_direction(is_known):
    """Two tones that beat have bearings, too, but between theirs."""
    lines = lines_of(replace(SCENE, rest_hz=(120.0,)))
    mean = lines.measured_level_db.mean()
    flat = mean + 0.4 * (lines.measured_level_db - mean)
    alone = replace(lines, measured_level_db=flat)
    candidate = candidate_of(alone)
    if not is_known:
        covariance = candidate.fit.covariance.copy()
        covariance[0, 3, 3] = 70.0**2
        candidate = replace(
            candidate, fit=replace(candidate.fit, covariance=covariance)
        )
    against = check_fit(candidate, alone).rejections
    assert any("its only line" in one.sentence for one in against) is not is_known


@pytest.mark.parametrize(("share", "is_told"), [(0.7, True), (0.2, False)])
def test_bearings_alone_are_no_passage_of_one_line_whose_level_stays(share, is_told):
    """A line that keeps its frequency: two that beat swing between two bearings."""
    lines = lines_of(replace(SCENE, rest_hz=(120.0,)))
    mean = lines.measured_level_db.mean()
    steady = replace(
        lines,
        measured_frequency_hz=120.0 + 0.003 * np.random.default_rng(4).normal(size=lines.line.size),
        measured_level_db=mean + share * (lines.measured_level_db - mean),
    )  # fmt: skip
    found = find_encounters(steady, None, DIFAR)
    assert (found.n_encounters == 1) is is_told
    if not is_told:
        ((_, _, _, reason),) = found.refusals()
        assert "its only line" in reason


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


@pytest.mark.parametrize(("n_still", "is_told"), [(0, True), (1, True), (2, False)])
def test_lines_that_mostly_stand_still_are_not_of_the_vessel_that_passes(
    n_still, is_told
):
    lines = lines_of(replace(SCENE, rest_hz=(120.0, 180.0, 240.0)))
    one = candidate_of(lines)
    value, noise = one.blocks.value.copy(), np.random.default_rng(6)
    for part in one.blocks.parts[:2]:
        rows = value[0, part]
        rows[:n_still] = 1e-5 * noise.normal(size=rows[:n_still].shape)
    against = stationary_lines(one.fit, replace(one.blocks, value=value))
    assert (against is None) is is_told
    if against is not None:
        assert against.sentence == "2 of its 3 lines stand still"


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
    assert (stationary_lines(one.fit, blocks) is None) is is_told


def test_a_passage_of_one_motion_keeps_its_deviations():
    one = candidate_of(lines_of(SCENE))
    checked = check_fit(one, lines_of(SCENE))
    assert not checked.rejections
    widened = np.diag(checked.fit.covariance[0]) / np.diag(one.fit.covariance[0])
    assert (widened < 2.0).all()


def test_halves_of_two_speeds_widen_what_they_disagree_about():
    slow, fast = (lines_of(replace(SCENE, speed_mps=v, range_m=40 * v)) for v in (5, 7))
    late = slow.time_s > SCENE.closest_s
    frequency = np.where(late, fast.measured_frequency_hz, slow.measured_frequency_hz)
    lines = replace(slow, measured_frequency_hz=frequency)
    one = candidate_of(lines)
    checked = check_fit(one, lines)
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
    assert not told[1].rejections
    assert not told[10].rejections
    assert told[9].rejections[0].code == "duplicate"


def test_contacts_that_fit_together_tell_the_passage_together():
    lines = lines_of(SCENE)
    unknown = np.full(lines.time_s.size, np.nan)
    one = candidate_of(replace(lines, measured_bearing_deg=unknown))
    again = replace(one, contacts=(9,))
    both = replace(one, contacts=(1, 9))
    assert tell_once([one, again], lambda *_: both) == [both]
    for refused in (None, both.rejected(reject("not-significant"))):
        first, second = tell_once([one, again], lambda *_, made=refused: made)
        assert first is one
        assert second.rejections[0].sentence.startswith("the passage of contact 1")


def test_bearings_decide_whether_two_contacts_are_one_vessel():
    one = candidate_of(lines_of(SCENE))
    turned = replace(one.fit, bearing_deg=one.fit.bearing_deg + 60.0)
    again = replace(one, contacts=(9,))
    other = replace(one, contacts=(10,), fit=turned)
    told = {item.contacts[0]: item for item in tell_once([one, again, other])}
    assert not told[1].rejections
    assert not told[10].rejections
    assert told[9].rejections[0].code == "duplicate"


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


@pytest.mark.parametrize(("width_s", "refused"), [(1842.0, True), (388.0, False)])
def test_a_passage_that_hardly_turns_within_the_recording_is_none(width_s, refused):
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
    told = not_a_passage(fit, blocks, RecordingSpan(1.0, 0.0, 600.0))
    assert (told is not None) == refused
    if refused:
        assert "turns by 18 degrees" in told.sentence


@pytest.mark.parametrize(("slope", "refused"), [(0.08, True), (0.78, False)])
@pytest.mark.parametrize("count", [1, 2, 5])
def test_lines_without_doppler_shift_need_levels_that_follow(
    monkeypatch, slope, refused, count
):
    """Machines that take turns in two directions turn the bearing, too."""
    monkeypatch.setattr(fit_checks, "level_slope", lambda *_: (slope, 0.2))
    fit = SimpleNamespace(
        theta=np.array([[257.0, 4.7, 0.23, 40.0]]),
        covariance=np.diag([9.0, 0.1, 0.04, 24.0**2])[None],
    )
    gain = SimpleNamespace(level=0.0, threshold=12.8)
    candidate = SimpleNamespace(
        line_ids=np.arange(count), fit=fit, likelihood_ratio=gain
    )
    assert bool(fit_checks.contradicting_levels(candidate, fit, object())) == refused


@pytest.mark.parametrize(
    ("count", "kind", "slope", "gain", "bearing_std_deg", "words"),
    [
        (
            5,
            None,
            0.61,
            -5.3,
            180.0,
            "levels of its lines",
        ),  # a machine, 12 deviations off
        (5, None, 0.61, -2.0, 180.0, ""),  # as likely as not
        (5, None, 1.46, -22.6, 180.0, ""),  # the surface makes a true one steeper
        (5, None, 0.61, -5.3, 20.0, ""),  # its bearings turn
        (1, "frequency-ramp", 0.97, 0.1, 180.0, "its only line changes"),
        (1, "frequency-ramp", 0.97, 4.0, 180.0, ""),
        (1, None, 0.97, 0.1, 180.0, ""),
        (2, "frequency-ramp", 0.97, 0.1, 180.0, ""),
    ],
)
def test_lines_that_alone_show_a_passage_need_levels_that_do_not_stay(
    monkeypatch, count, kind, slope, gain, bearing_std_deg, words
):
    """A machine that slows down as its level swells, and true ones of line_level_coverage."""
    monkeypatch.setattr(fit_checks, "level_slope", lambda *_: (slope, 0.05))
    fit = SimpleNamespace(
        theta=np.array([[257.0, 2.5, 6.0, 40.0]]), medium=Medium(1500.0),
        covariance=np.diag([9.0, 0.1, 0.04, bearing_std_deg**2])[None],
        change=SimpleNamespace(kind=kind) if kind else None,
    )  # fmt: skip
    told = SimpleNamespace(level=0.0, threshold=12.8, line_level=gain)
    item = SimpleNamespace(line_ids=np.arange(count), fit=fit, likelihood_ratio=told)
    found = fit_checks.contradicting_levels(item, fit, object())
    assert bool(found) == bool(words)
    assert not found or words in found.sentence
