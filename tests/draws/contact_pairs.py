"""Contacts of a moving source and of the repeater that it leaves behind.

`python -m tests.draws.contact_pairs PAIRS SEED` prints the table of error rates of
`discriminate`, PAIRS pairs in each row, and how often two vessels are named.
"""

import sys
from collections import Counter
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.stats import beta

from studies.repeater import RepeaterScene, simulate_repeater
from uwtrack_cli.data.scans import Contacts
from uwtrack_cli.data.sensor import Navigation
from uwtrack_cli.discrimination.contact_filters import Observation
from uwtrack_cli.discrimination.discriminate import discriminate_contacts
from uwtrack_cli.discrimination.options import ContactFilters
from uwtrack_cli.discrimination.pair_test import (
    consistency,
    first_crossing,
    follow,
    run_pair,
    wald_thresholds,
)

SCENE = RepeaterScene(aspect_deg=140.0, turns=True)

BEARING_STD_DEG = {"plain": 2.0, "weak": 6.0}
ERRORS = (0.05, 0.01)
MOTIONS = ("as assumed", "straight or turning")
"""Accelerations as the filters assume them; none, or in half of the pairs a turn of 45
degrees in 1.2 s, of own ship 22.5 degrees, as the repeater separates."""


def contact_pair(scene=SCENE, seed=1, source=1, repeater=2):
    """Return contacts of one simulated run and own ship's navigation."""
    drawn = simulate_repeater(np.random.default_rng(seed), scene, 1)
    n = drawn.time_s.size
    table = np.concatenate([drawn.source[:, 0], drawn.repeater[:, 0]])
    number = np.repeat([source, repeater], n)
    time_s = np.tile(drawn.time_s, 2)
    keep = np.isfinite(table[:, 0])
    order = np.argsort(time_s[keep], kind="stable")
    table, number, time_s = (v[keep][order] for v in (table, number, time_s))
    contacts = Contacts(
        contact=number, time_s=time_s, range_m=table[:, 0], bearing_deg=table[:, 1],
        range_rate_mps=table[:, 2], range_std_m=np.full(time_s.size, scene.range_std_m),
        bearing_std_deg=np.full(time_s.size, scene.bearing_std_deg),
        range_rate_std_mps=np.full(time_s.size, scene.range_rate_std_mps),
    )  # fmt: skip
    clock, own = drawn.navigation_time_s, drawn.own_ship_m
    navigation = Navigation(
        time_s=clock, east_m=own[:, 0], north_m=own[:, 1], heading_deg=np.full(clock.size, np.nan)
    )
    return contacts, navigation


class Rates(NamedTuple):
    """What became of many pairs at one accepted error."""

    error: float
    wrong: int
    right: int
    neither: int
    scans: float


def drawn_scene(rng, motion, bearing_std_deg):
    """Return a scene of random aspect and range, whose motion is one of `MOTIONS`.

    The observer steers a constant bearing: where nobody turns the source keeps it.
    """
    assumed = motion == "as assumed"
    return RepeaterScene(
        aspect_deg=rng.uniform(20.0, 150.0), range_m=rng.uniform(1200.0, 2500.0),
        turns=not assumed and bool(rng.random() < 0.5),
        bearing_std_deg=bearing_std_deg,
        acceleration_mps2=ContactFilters().acceleration_std_mps2 if assumed else 0.0,
    )  # fmt: skip


def error_rates(seed, pairs, motion, data, *, has_history):
    """Run many pairs, each of its own scene, at both accepted errors."""
    rng, filters = np.random.default_rng(seed), ContactFilters()
    scenes = [drawn_scene(rng, motion, BEARING_STD_DEG[data]) for _ in range(pairs)]
    runs = [simulate_repeater(rng, scene, 1) for scene in scenes]
    clock, times_s = runs[0].navigation_time_s, runs[0].time_s
    at = np.searchsorted(clock, times_s - 1e-6)
    own = np.stack([run.own_ship_m for run in runs], axis=1)
    rate = np.gradient(own, clock, axis=0)
    one = scenes[0]
    variance = (
        np.array([one.range_std_m, np.deg2rad(one.bearing_std_deg), one.range_rate_std_mps]) ** 2
    )

    def observations(name):
        measured = np.concatenate([getattr(run, name) for run in runs], axis=1)
        measured[..., 1] = np.deg2rad(90.0 - measured[..., 1])
        return [Observation(measured[k], variance, own[i], rate[i]) for k, i in enumerate(at)]

    source, repeater = observations("source"), observations("repeater")
    split = int(np.flatnonzero(np.isfinite(runs[0].repeater[:, 0, 0]))[0])
    history = follow(source[:split], times_s[:split], filters) if has_history else None
    found = run_pair(source[split:], repeater[split:], times_s[split:], filters, history=history)
    fits = consistency(found.distance2, found.degrees)
    rates = []
    for error in ERRORS:
        scan, decision = first_crossing(found.log_odds, wald_thresholds(error, error))
        rejected = fits[:4].reshape(2, 2, -1).min(axis=1) < 0.1 * error
        rates.append(Rates(
            error, int((decision > 0).sum()), int((decision < 0).sum()),
            int(rejected.all(axis=0).sum()), float(scan[decision < 0].mean() + 2.0),
        ))  # fmt: skip
    return rates


def two_vessels(seed, pairs, *, has_history):
    """Count the verdicts on pairs of vessels at an accepted error of 1 %."""
    verdicts = Counter()
    for number in range(seed, seed + pairs):
        rng = np.random.default_rng(number)
        scene = RepeaterScene(
            aspect_deg=rng.uniform(20.0, 80.0), range_m=rng.uniform(500.0, 800.0),
            interval_s=1.0, turns=bool(rng.random() < 0.5),
            vessel_course_deg=rng.uniform(0.0, 360.0),
        )  # fmt: skip
        contacts, navigation = contact_pair(scene, seed=number)
        if not has_history:
            late = np.flatnonzero(contacts.time_s > 59.9)
            contacts = contacts.take("row", late)
        found = discriminate_contacts(contacts, navigation, miss=0.01, false_alarm=0.01)
        verdicts[str(found.verdict[0])] += 1
    return verdicts


def _limits(count, total):
    """Return the exact 95 % limits of a share in per cent (Clopper and Pearson)."""
    low = beta.ppf(0.025, count, total - count + 1) if count else 0.0
    high = beta.ppf(0.975, count + 1, total - count) if count < total else 1.0
    return f"{100 * low:.2f} to {100 * high:.2f}"


def _tables(pairs, seed):
    yield ("| motion | earlier contact | bearings | accepted | wrong (95 % limits) | right |"
           " undecided | scans when right | neither fits |")  # fmt: skip
    yield "|---" * 9 + "|"
    rows = product(MOTIONS, (True, False), BEARING_STD_DEG)
    for number, (motion, has_history, data) in enumerate(rows):
        found = error_rates(seed + number, pairs, motion, data, has_history=has_history)
        for row in found:
            undecided = pairs - row.wrong - row.right
            counts = (row.wrong, row.right, undecided, row.neither)
            wrong, right, still, neither = (f"{100 * n / pairs:.1f} %" for n in counts)
            yield (f"| {motion} | {'yes' if has_history else 'no'} | {data} |"
                   f" {100 * row.error:g} % | {wrong} ({_limits(row.wrong, pairs)}) |"
                   f" {right} | {still} | {row.scans:.1f} | {neither} |")  # fmt: skip
    for has_history in (True, False):
        named = two_vessels(seed, 200, has_history=has_history)
        yield f"two vessels, earlier contact {has_history}: {dict(named)}"


if __name__ == "__main__":
    for line in _tables(int(sys.argv[1]), int(sys.argv[2])):
        sys.stdout.write(line + "\n")
