"""Priors of what changes beside a passage: proper, with the scales of vessels."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad

from uwtrack_cli.motion.passage.model.unknowns import MANOEUVRE, RAMP, STEP, Change
from uwtrack_cli.motion.passage.readings.change_priors import (
    ODDS,
    SIZES,
    VESSEL_MPS,
    VESSEL_STD_MPS,
    cost_of_change,
    cost_of_speed,
    speed_prior,
)

TIME = np.linspace(0.0, 600.0, 601)
AT_S, SPEED_MPS = 200.0, 6.0
SPREAD = 1e-6
"""Deviations far below every bound: the posterior is a spike."""


def fitted(kind, sizes, std=SPREAD, speed=SPEED_MPS):
    """Stand for the fit of a change of known size."""
    sizes = np.atleast_1d(np.asarray(sizes, float))
    theta = np.array([[300.0, np.log(30.0), speed, 0.0, 19.0, *sizes]])
    full = np.diag(np.append(np.ones(5), np.full(sizes.size, std**2)))
    change = Change(kind, np.array([AT_S]), np.ones(1)) if kind else None
    return SimpleNamespace(theta=theta, full_covariance=full[None], change=change)


def density(kind, sizes):
    """Return the prior density that a spike of known width has paid for."""
    paid = cost_of_change(fitted(kind, sizes), TIME) - ODDS[kind]
    count = 2 if kind == MANOEUVRE else 1
    return np.exp(-paid) / (2 * np.pi * SPREAD**2) ** (count / 2)


@pytest.mark.parametrize("kind", [STEP, RAMP])
def test_the_prior_of_a_change_of_frequency_integrates_to_one(kind):
    low, high = np.array(SIZES[kind]) / (TIME[-1] - AT_S if kind == RAMP else 1.0)
    inside = quad(lambda x: density(kind, np.exp(x)) * np.exp(x), np.log(low / 1e3),
                  np.log(0.98 * high), limit=400, points=[np.log(low)])[0]  # fmt: skip
    assert 2 * inside == pytest.approx(1.0, abs=0.02)


def test_the_prior_of_a_change_of_velocity_integrates_to_one():
    """Of a vessel that slows down or turns without getting faster: half of all, less
    what two legs of one speed cut off."""
    low, high = np.array(SIZES[MANOEUVRE]) * SPEED_MPS

    def ring(x):
        # away from the leg, so that this leg is the faster one: unit of the size
        return density(MANOEUVRE, [-np.exp(x), 0.0]) * 2 * np.pi * np.exp(2 * x)

    inside = quad(ring, np.log(low / 1e3), np.log(0.98 * high), limit=400, points=[np.log(low)])[0]
    assert inside == pytest.approx(1.0, abs=0.02)


def test_no_vessel_changes_its_velocity_by_more_than_its_speed_allows():
    """A leg of 17 m/s beside one of 3 has the odds of a vessel of 17 m/s; and a step of
    a tenth is another line."""
    straight = speed_prior(fitted(None, []))
    fast = fitted(MANOEUVRE, [14.0, 0.0], std=0.3, speed=3.0)
    slow = fitted(MANOEUVRE, [2.0, 0.0], std=0.3, speed=3.0)
    evidence = [speed_prior(one) - straight - cost_of_change(one, TIME) for one in (slow, fast)]
    assert evidence[0] > evidence[1] + 4.0
    far = cost_of_change(fitted(STEP, 0.1, std=5e-3), TIME)
    near = cost_of_change(fitted(STEP, 0.04, std=5e-3), TIME)
    assert far > near + 30.0


def test_the_speed_of_vessels_has_its_scale_and_gives_way_to_what_is_faster():
    """Half of the density below the median of a log-normal of that mean and deviation;
    among speeds of satellites a tenth more or less is worth less than a neper."""

    def below(fastest):
        return quad(lambda x: np.exp(speed_prior(fitted(None, [], speed=np.exp(x))) + x),
                    np.log(0.26), np.log(fastest), limit=300)[0]  # fmt: skip

    median = VESSEL_MPS / np.sqrt(1 + (VESSEL_STD_MPS / VESSEL_MPS) ** 2)
    assert below(median) / below(1e4) == pytest.approx(0.5, abs=0.02)
    fast, faster = (speed_prior(fitted(None, [], speed=v)) for v in (7000.0, 7700.0))
    assert 0.0 < fast - faster < 1.0


def test_a_speed_costs_what_its_evidence_lacks():
    """The integral of prior times likelihood over all speeds, by quadrature."""

    def prior(speed):
        return np.exp(speed_prior(fitted(None, [], speed=speed)))

    whole = quad(lambda x: prior(np.exp(x)) * np.exp(x), np.log(0.26), np.log(1e6), limit=300)[0]
    for speed, std in ((5.0, 0.3), (30.0, 2.0), (110.0, 8.0)):
        one = fitted(None, [], speed=speed)
        one.covariance = np.full((1, 4, 4), std**2)
        seen = quad(lambda v, at=speed, sd=std: prior(v) * np.exp(-0.5 * ((v - at) / sd) ** 2),
                    speed - 6 * std, speed + 6 * std)[0]  # fmt: skip
        assert cost_of_speed(one) == pytest.approx(-np.log(seen / whole), abs=0.06)
    assert cost_of_speed(one) > 5.0


def test_a_size_that_the_fit_does_not_determine_is_no_evidence():
    one = fitted(MANOEUVRE, [1.0, 1.0])
    one.full_covariance[0, 5, 5] = np.nan
    assert cost_of_change(one, TIME) == np.inf
