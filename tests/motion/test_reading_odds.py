"""Odds of readings by Bayes' rule, halves of sources, and where lines and fits are near."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.data.presence import CONSTANT, JOINED, MACHINERY
from uwtrack_cli.motion import cpa
from uwtrack_cli.motion.cpa import FULL_SCALE
from uwtrack_cli.motion.passage import moving_lines, recording_passages
from uwtrack_cli.motion.passage.broadband_sum import KnownSources, SourceFit, source_parts
from uwtrack_cli.motion.passage.fit.estimator import fit_passage
from uwtrack_cli.motion.passage.fit.initial_estimates import find_initial_estimates
from uwtrack_cli.motion.passage.fit.likelihood_ratio import passage_likelihood_ratio
from uwtrack_cli.motion.passage.model.measurements import PassageData, make_blocks
from uwtrack_cli.motion.passage.model.unknowns import MANOEUVRE, RAMP, STEP, TURN, Change, law_of
from uwtrack_cli.motion.passage.moving_lines import Together
from uwtrack_cli.motion.passage.readings import change_scores
from uwtrack_cli.motion.passage.readings import competing_readings as competing
from uwtrack_cli.motion.passage.readings import still_readings as still
from uwtrack_cli.motion.passage.readings.change_priors import STRAIGHT
from uwtrack_cli.motion.passage.readings.change_scores import Scores
from uwtrack_cli.motion.passage.source_separation import _log_power, _with_halves

KINDS = (STEP, RAMP, MANOEUVRE, TURN)


def fit_of(kind=None):
    change = kind and SimpleNamespace(kind=kind, time_s=np.array([70.0]))
    return SimpleNamespace(change=change, theta=np.array([[50.0, 3.0, 5.0, -5.0]]))


@pytest.mark.parametrize("offset", [0.0, -500.0])
def test_readings_are_as_likely_as_bayes_says(monkeypatch, offset):
    """Passages share one cost; an unseen change is told by its share, else straight."""
    value = np.array([2.0, 3.1, 1.5]) + offset
    unseen = [SimpleNamespace(log_evidence=0.4, share=0.3, kind="manoeuvre"),
              SimpleNamespace(log_evidence=-0.6, share=0.8, kind="frequency-step")]  # fmt: skip
    nothing = {CONSTANT: -1.0 + offset, MACHINERY: 0.7 + offset, JOINED: -2.0 + offset}
    fits = [fit_of(), fit_of("manoeuvre"), fit_of("frequency-step")]
    tried = SimpleNamespace(
        fits=fits, searches=[None] * 3, unseen=[0, 1], time_std_s=[np.nan, 2.0, 3.0]
    )
    seen = {}
    monkeypatch.setattr(competing, "_evidences", lambda *_: value)
    monkeypatch.setattr(competing, "unseen_change", lambda k, *_: unseen[k])
    monkeypatch.setattr(competing, "still_frequencies", lambda *_: None)
    monkeypatch.setattr(competing, "still_evidences", lambda *_: nothing)
    monkeypatch.setattr(competing, "cost_of_motion", lambda fit, _: 0.9 * (fit is fits[1]))
    monkeypatch.setattr(competing, "fit_with_line_levels", lambda one, _: one)
    monkeypatch.setattr(
        competing, "mixed",
        lambda _whole, best, chance, left: seen.update(best=best, chance=chance, left=left),
    )  # fmt: skip
    _, reading = competing.weigh_readings(tried, SimpleNamespace())
    passing = np.exp(value - offset)
    hidden = np.exp(value[0] - offset + np.array([0.4, -0.6]))
    odds = {
        STRAIGHT: passing[0] + 0.7 * hidden[0] + 0.2 * hidden[1],
        "manoeuvre": passing[1] + 0.3 * hidden[0],
        "frequency-step": passing[2] + 0.8 * hidden[1],
    }
    odds = {name: one * np.exp(-0.9) for name, one in odds.items()}
    odds |= {name: np.exp(one - offset) for name, one in nothing.items()}
    total = sum(odds.values())
    ranked = sorted(odds, key=lambda name: -odds[name])
    assert reading.name == "manoeuvre"
    assert reading.weight == pytest.approx(odds["manoeuvre"] / total)
    rival = next(name for name in ranked if name != "manoeuvre")
    assert reading.rival == rival
    assert reading.rival_weight == pytest.approx(odds[rival] / total)
    none = sum(odds[name] for name in nothing) / total
    assert reading.nothing == pytest.approx(none)
    assert reading.change_time_std_s == pytest.approx(2.0)
    assert seen["best"] == 1
    whole = np.append(passing, hidden)
    np.testing.assert_allclose(seen["chance"], passing / whole.sum())
    np.testing.assert_allclose([one for one, _ in seen["left"]], hidden / whole.sum())


def test_what_is_not_told_to_pass_is_read_as_the_likeliest_of_all(monkeypatch):
    value = np.array([1.0, 2.5])
    monkeypatch.setattr(competing, "_evidences", lambda *_: value)
    monkeypatch.setattr(competing, "cost_of_motion", lambda *_: 0.5)
    monkeypatch.setattr(competing, "still_frequencies", lambda *_: None)
    found = {CONSTANT: 1.2, MACHINERY: -1.0}
    monkeypatch.setattr(competing, "still_evidences", lambda *_: dict(found))
    monkeypatch.setattr(competing, "unseen_passages", lambda *_: {STRAIGHT: 0.9})
    tried = SimpleNamespace(fits=[fit_of(), fit_of("manoeuvre")], searches=[None, None])
    reading = competing.read_still(fit_of(), SimpleNamespace(), tried)
    odds = np.exp([1.2, -1.0, 0.9, 2.0])
    assert reading.name == "manoeuvre"
    assert reading.weight == pytest.approx(odds[3] / odds.sum())
    assert reading.rival == CONSTANT
    assert reading.nothing == pytest.approx(odds[:2].sum() / odds.sum())


@pytest.mark.parametrize(("share", "rival"), [(0.049, ""), (0.051, MACHINERY)])
def test_a_rival_is_told_from_a_twentieth_on(share, rival):
    reading = competing._named({STRAIGHT: 1 - share, MACHINERY: share})
    assert (reading.name, reading.rival) == (STRAIGHT, rival)
    assert reading.rival_weight == (share if rival else 0.0)
    assert reading.nothing == share


def test_evidences_are_likelihoods_less_search_and_cost(monkeypatch):
    gain = np.array([7.0, 9.5, 12.0])
    fits = [fit_of(), fit_of("manoeuvre"), fit_of("frequency-step")]
    monkeypatch.setattr(competing, "_log_likelihoods", lambda *_: gain.copy())
    monkeypatch.setattr(competing, "speed_prior", lambda fit: -1.0 - (fit is fits[2]))
    monkeypatch.setattr(competing, "cost_of_change", lambda *_: 0.7)
    place = {id(fits[0]): -0.5, id(fits[1]): -0.8, id(fits[2]): -0.4}
    monkeypatch.setattr(competing, "prior_of_place", lambda fit, _: place[id(fit)])
    searches = [None, *(SimpleNamespace(search=lambda g, s=s: s * g) for s in (0.1, 0.2))]
    blocks = SimpleNamespace(shift=SimpleNamespace(is_empty=False), time_s=None)
    found = competing._evidences(fits, searches, blocks)
    expected = [-1.0, 2.5 - 1.0 - 0.25 - 0.7 - 0.3, 5.0 - 2.0 - 1.0 - 0.7]
    np.testing.assert_allclose(found, expected)
    fits[0].theta[0, 2] = 0.0
    assert competing._evidences(fits, searches, blocks)[0] == -np.inf
    blocks.shift.is_empty = True
    np.testing.assert_allclose(competing._evidences(fits, searches, blocks), gain - 7.0)


def test_a_closest_approach_outside_the_measurements_has_a_normal_prior():
    """Its variances are those of uniform ones: of the time, and of the logarithm of R/v."""
    time = np.arange(0.0, 201.0, 2.0)
    blocks = SimpleNamespace(time_s=time, weight=np.ones((1, 1, time.size)))
    decades = np.log(100.0)
    for at_s, width_s in ((100.0, 20.0), (-60.0, 20.0), (100.0, 500.0)):
        fit = SimpleNamespace(theta=np.array([[at_s, 0.0]]), range_over_speed_s=np.array([width_s]))
        each = ((at_s, 100.0, 200.0), (np.log(width_s), np.log(20.0), decades))
        expected = sum(
            norm.logpdf(x, mean, span / np.sqrt(12)) - norm.logpdf(mean, mean, span / np.sqrt(12))
            for x, mean, span in each
        )
        assert still.prior_of_place(fit, blocks) == pytest.approx(expected)


def test_a_search_is_worth_the_mean_of_what_its_instants_would_gain():
    """Of white noise alone every instant counts; a gain of none costs nothing."""
    gain, spacing = np.array([1.0, 6.0, 4.0, 2.0]), np.array([1.0, 0.5, 0.5, 2.0])
    blank = np.zeros((4, 1))
    made = Scores("frequency-step", gain, blank[:, 0], blank[:, 0], blank, spacing,
                  blank, blank, blank)  # fmt: skip
    mean = np.average(np.exp(gain - 6.0), weights=spacing)
    for asked in (6.0, 60.0):
        assert made.search(asked) == pytest.approx(-np.log(mean))
    half = np.average(np.exp(0.5 * (gain - 6.0)), weights=spacing)
    assert made.search(3.0) == pytest.approx(-np.log(half))
    assert made.search(-1.0) == pytest.approx(0.0)
    assert still._search(gain, 3.0) == pytest.approx(-np.log(np.mean(np.exp(0.5 * (gain - 6.0)))))
    assert still._search(gain, -1.0) == pytest.approx(0.0)


@pytest.mark.parametrize("gain", [-2.0, 0.0, 8.0, 800.0])
def test_a_size_costs_what_an_even_prior_of_its_logarithm_does(gain):
    """Prior density at the size over that of a normal posterior whose peak it is."""
    low, high = 1e-4, 5e-2
    deviations = np.sqrt(2 * max(gain, 0.0))
    size = 3e-3
    prior = 0.5 / (size * (np.log(high / low) + 1.0))
    if deviations:
        std = size / deviations
        expected = max(-np.log(prior * std * np.sqrt(2 * np.pi)), 0.0)
    else:
        expected = 0.0
    assert still._cost_of_size(gain, low, high) == pytest.approx(expected)


@pytest.mark.parametrize("is_coloured", [None, True, False])
def test_a_variant_has_the_better_of_both_noises_and_pays_for_its_change(is_coloured):
    profile = np.array([1.0, 5.0, 3.0])
    for change, n_rows in (("", 1), ("frequency-step", 3)):
        one = still.Variant(
            MACHINERY, np.zeros(3), np.zeros((3, 1)), is_coloured, change,
            profile if change else None, n_rows, 0.4,
        )  # fmt: skip
        white, coloured = 4.0, 9.0
        ways = {None: np.exp(4.0) + np.exp(6.0), True: np.exp(6.0), False: np.exp(4.0)}
        found = np.log(ways[is_coloured] / 2.0) + 0.4
        if change:
            gain = found - 1.5
            found -= still._cost_of_size(gain, 1e-4, 5e-2) + np.log(3.0)
            found -= still._search(profile, gain)
        assert one.value(white, coloured, 1.5) == pytest.approx(found)


def test_halves_of_a_source_lie_beside_it_and_are_together_as_loud():
    """A source in two: each half as wide, six tenths of d/v from the middle, and where
    the whole bears then."""
    time_s = np.linspace(0.0, 200.0, 41)
    theta = np.array([0.1, 1.0, 0.0, 0.0, 1.2, 0.0, 0.0, 0.0, 80.0, np.log(20.0), 2.0, 0.7])
    known = KnownSources(np.zeros((1, 41)), np.zeros((1, 41)))
    # of two free sources each is parted in its own place
    two = SourceFit(np.append(theta, theta[8:] + 1.0), np.ones(2), 0.0, 1)
    parted, _ = _with_halves(two, np.zeros((0, 20)), np.zeros((0, 3)), (1.0, -1.0))
    np.testing.assert_allclose(parted[2:, 8:12], np.tile(theta[8:], (2, 1)))
    assert np.abs(parted[2:, 12] - 81.0).min() > 1.0
    for turn in (1.0, -1.0):
        fit = SourceFit(theta, np.array([turn]), 0.0, 1)
        starts, turns = _with_halves(
            fit, np.tile(np.append(theta, np.zeros(4)), (2, 1)), np.full((2, 2), turn), (1.0, -1.0)
        )
        assert starts.shape == (4, 16)
        assert turns[2:].tolist() == [[turn, turn], [turn, -turn]]
        for start in starts[2:]:
            np.testing.assert_allclose(start[:8], theta[:8])
            halves = start[8:].reshape(2, 4)
            np.testing.assert_allclose(halves[:, 0], [68.0, 92.0])
            np.testing.assert_allclose(np.exp(halves[:, 1]), 10.0)
            np.testing.assert_allclose(halves[:, 2], 2.0)
            whole = 0.7 + turn * np.arctan((halves[:, 0] - 80.0) / 20.0)
            np.testing.assert_allclose(halves[:, 3], whole)
        parts = source_parts(theta[None], fit.turn[None], time_s, known)
        loud = _log_power(fit.motion[0][None], 1.0, time_s[:, None])[:, 0]
        np.testing.assert_allclose(np.log(parts.power[0, 1]), loud)


@pytest.mark.parametrize("own_s", [4.0, 30.0])
@pytest.mark.parametrize("off", [-0.02, 0.02])
def test_a_fit_is_near_lines_within_two_of_the_longer_width(own_s, off):
    """By when it is heard: the sound takes range over speed of sound."""
    speed, heard_s = 20.0, 100.0 + own_s * 20.0 / 1500.0
    fit = SimpleNamespace(
        theta=np.array([[100.0, 0.0, speed, 0.0]]), range_over_speed_s=np.array([own_s]),
        medium=Medium(1500.0),
    )  # fmt: skip
    reach = 2.0 * max(own_s, 10.0)
    for side in (-1.0, 1.0):
        place = Together(heard_s + side * (reach + off), 10.0, np.zeros(0), 0.0)
        assert recording_passages._is_near(fit, place) is (off < 0)


def test_of_lines_that_claim_one_time_the_strongest_is_kept():
    """Two of the wider d/v apart is enough."""

    def at(time_s, width_s, gain):
        return Together(time_s, width_s, np.zeros(1, int), gain)

    found = [at(0.0, 10.0, 20.0), at(19.9, 4.0, 30.0), at(40.1, 10.0, 25.0), at(60.3, 3.0, 12.0)]
    kept = moving_lines._apart(found)
    assert [one.gain for one in kept] == [30.0, 25.0, 12.0]
    assert [one.gain for one in moving_lines._apart(found[:1] + found[2:])] == [25.0, 20.0, 12.0]


def heard():
    """A passage of one line, a bearing and levels, with noise."""
    rng = np.random.default_rng(3)
    time = np.arange(0.0, 240.0, 2.0)
    x = (time - 110.0) / 18.0
    return PassageData(
        time, 90.0 * (1 - 6.0 / 1500.0 * x / np.hypot(1, x))[None]
        + 0.02 * rng.standard_normal((1, 120)), 0.02 + 0.0 * time[None],
        (40.0 + np.degrees(np.arctan(x)) + 2.0 * rng.standard_normal(120))[None] % 360.0,
        2.0 + 0.0 * time[None],
        60.0 - 10 * np.log10(1 + x**2)[None] + rng.standard_normal((1, 120)),
        1.0 + 0.0 * time[None],
    )  # fmt: skip


@cache
def fitted():
    blocks, medium = make_blocks(heard()), Medium(1500.0, 20.0, height_std_m=3.0)
    start = np.array([[110.0, np.log(17.9), 6.0, -9.0]])
    return fit_passage(blocks, start, np.ones(1), medium, with_coloured_noise=False), blocks


@pytest.mark.parametrize("kind", KINDS)
def test_a_change_gains_what_least_squares_with_it_do(kind):
    """Of the linear model with priors; its sizes and what the passage moves by, too."""
    fit, blocks = fitted()
    found = change_scores.score_changes(kind, fit, blocks)
    change = change_scores.instants(kind, fit, blocks)
    count = change.std.size
    theta = np.zeros((change.time_s.size, 5 + count))
    theta[:, : fit.theta.shape[1]] = fit.theta
    theta[:, 4] = fit.height_m
    if kind == TURN:
        widths = float(fit.range_over_speed_s[0]) * np.array([1.5, 4.0, 10.0])
        theta[:, 6] = np.repeat(widths, change.time_s.size // 3)
    value, base, extra, _ = change_scores._linearised(change, theta, fit, blocks)
    resting = np.linalg.lstsq(base, value, rcond=None)[0]
    for k in range(0, change.time_s.size, 9):
        columns = np.column_stack([base, extra[k].T])
        prior = np.zeros((count, columns.shape[1]))
        prior[:, -count:] = np.diag(1 / change.std)
        rows = np.concatenate([columns, prior])
        values = np.append(value, np.zeros(count))
        scale = np.sqrt((rows**2).sum(0))
        scale[scale == 0] = 1.0
        best = np.linalg.lstsq(rows / scale, values, rcond=1e-10)[0] / scale
        left = ((values - rows @ best) ** 2).sum()
        gain = 0.5 * (((value - base @ resting) ** 2).sum() - left)
        assert found.gain[k] == pytest.approx(gain, rel=1e-4, abs=1e-6)
        size = np.clip(best[-count:], -4 * change.std, 4 * change.std)
        np.testing.assert_allclose(found.theta[k, 5:] - theta[k, 5:], size, rtol=1e-3, atol=1e-6)
        width, speed = float(fit.range_over_speed_s[0]), float(fit.theta[0, 2])
        reach = np.array([2 * width, 1.0, 0.5 * speed])
        moved = np.clip(best[:3], -reach, reach * [1, 1, 2])
        np.testing.assert_allclose(
            found.theta[k, :3] - fit.theta[0, :3], moved, rtol=1e-3, atol=1e-5
        )


@pytest.mark.parametrize("kind", KINDS)
def test_columns_of_changes_are_what_small_changes_do_to_the_residuals(kind):
    fit, blocks = fitted()
    change = change_scores.instants(kind, fit, blocks)
    few = np.array([5, change.time_s.size // 2 + 3])
    change = Change(kind, change.time_s[few] + 0.3, change.sign[few])
    theta = np.zeros((2, 5 + change.std.size))
    theta[:, : fit.theta.shape[1]] = fit.theta
    theta[:, 4] = fit.height_m
    if kind == TURN:
        theta[:, 6] = 60.0
    _, base, extra, _ = change_scores._linearised(change, theta, fit, blocks)
    n = blocks.time_s.size
    for k in range(2):
        one = Change(kind, change.time_s[[k]], change.sign[[k]])

        def law(by, k=k, one=one):
            law = law_of(theta[[k]] + by, blocks.time_s, fit.medium, one)
            level = np.logaddexp(law.spread[0], fit.theta[0, 3])
            return np.concatenate([law.shift[0], fit.turn[0] * law.angle[0], level])

        kinds = (blocks.shift, blocks.bearing, blocks.level)
        root = np.concatenate([
            np.sqrt(block.weight[0, 0]) / noise.scale[0][0]
            for block, noise in zip(kinds, fit.noises, strict=True)
        ])  # fmt: skip
        places = [0, 1, 2, 4, *range(5, theta.shape[1])]
        for number, place in enumerate(places):
            step = np.zeros((1, theta.shape[1]))
            step[0, place] = 1e-5
            slope = (law(step) - law(-step)) / 2e-5 * root
            ours = base[2:, number] if number < 4 else extra[k, number - 4, 2:]
            if number < 4 and k == 1:
                continue  # the passage's own columns are those of the first
            size = max(np.abs(slope).max(), 1e-3)
            np.testing.assert_allclose(ours / size, slope / size, atol=2e-3)
    assert base.shape[0] == 3 * n + 2
    assert base[0, 3] == pytest.approx(1 / 3.0)  # the prior of the depth difference


def test_without_levels_of_lines_they_gain_nothing():
    fit, blocks = fitted()
    found = passage_likelihood_ratio(fit, blocks, 1e-3)
    assert found.line_level == 0.0
    assert found.is_passage
    # more false alarms allowed: the threshold is lower by their logarithm
    other = passage_likelihood_ratio(fit, blocks, 1e-2)
    assert found.threshold - other.threshold == pytest.approx(np.log(10.0))


def test_steps_of_lines_are_weighed_by_the_scatter_of_each(monkeypatch):
    fit, blocks = fitted()
    seen = []

    class Steps(still._Steps):
        def __init__(self, value, precision):
            seen.append((value, precision))
            super().__init__(value, precision)

    monkeypatch.setattr(still, "_Steps", Steps)
    found = still.still_frequencies(fit, blocks)
    ((value, precision),) = seen
    scale = fit.noises[0].scale[0]
    np.testing.assert_allclose(precision, blocks.shift.weight[0] / scale[:, None] ** 2)
    np.testing.assert_allclose(value, blocks.shift.value[0])
    np.testing.assert_allclose(found.precision, precision.sum(axis=0))


def test_bearings_that_scatter_all_round_say_nothing():
    fit, blocks = fitted()
    wild = np.random.default_rng(5).uniform(0.0, 360.0, (1, 120))
    other = make_blocks(replace(heard(), bearing_deg=wild))
    plain, found = (passage_likelihood_ratio(fit, b, 1e-3) for b in (blocks, other))
    assert plain.bearing > 10.0
    assert found.bearing == 0.0
    silent = make_blocks(replace(heard(), bearing_deg=np.full((1, 120), np.nan)))
    none = passage_likelihood_ratio(fit, silent, 1e-3)
    for name in ("over_line", "over_break"):
        assert getattr(found, name) == pytest.approx(getattr(none, name))


def test_starts_without_lines_have_no_speed():
    none = np.full((0, 120), np.nan)
    data = replace(heard(), frequency_hz=none, frequency_std_hz=none)
    found = find_initial_estimates(make_blocks(data), Medium(1500.0))
    assert found.theta.shape[0] > 0
    assert not found.theta[:, 2].any()


@pytest.mark.parametrize("kinds", [(1, 0), (0, 1), (1, 1), (0, 0)])
def test_the_reference_of_levels_is_that_of_what_was_heard(kinds):
    frames = SimpleNamespace(start_utc_ns=7)
    lines, levels = (
        SimpleNamespace(frames=frames, reference=f"{n} uPa", band_low_hz=1.0, band_high_hz=2.0)
        if is_there else None
        for n, is_there in enumerate(kinds)
    )  # fmt: skip
    found = cpa._context((lines, levels, None, None), None, None, 20.0)
    expected = "1 uPa" if levels else "0 uPa" if lines else FULL_SCALE
    assert found.reference == expected
    assert found.band_hz == ((1.0, 2.0) if levels else None)
    assert found.start_utc_ns == (7 if lines or levels else None)
