"""Tell which of two contacts moves, and which is a stationary repeater.

**Method.** A sequential probability ratio test between two pairs of matched filters. A
repeater answers an active sonar with a delay and a Doppler shift: its range and range
rate are false, and only its bearing can be trusted.

**Conventions.** Bearings are compass degrees. More than two contacts are tested in pairs;
the contact that moves takes part in one pair with each of the others, and the error
budget is divided among these.

**References.** Jeong and Hong (1996), as corrected; Wald (1947).
"""

from typing import Literal

import numpy as np

from uwtrack_cli.data.contacts import Contacts
from uwtrack_cli.data.decisions import Decision
from uwtrack_cli.data.sensor import Navigation
from uwtrack_cli.errors import OptionError
from uwtrack_cli.estimation.pairs.sequential_test import wald_thresholds
from uwtrack_cli.stages.pairs.policies import ContactErrors, ContactFilters
from uwtrack_cli.stages.pairs.scans import arrange_contacts, filter_noise
from uwtrack_cli.stages.pairs.verdict import PairVerdict, judge_pair

Verdict = Literal["first moves", "second moves", "undecided"]


def discriminate_contacts(
    contacts: Contacts,
    navigation: Navigation,
    *,
    miss: float = 0.05,
    false_alarm: float = 0.05,
    errors: ContactErrors = ContactErrors(),  # noqa: B008 - frozen
    filters: ContactFilters = ContactFilters(),  # noqa: B008 - frozen
) -> Decision:
    """Tell which of two contacts moves and which is a stationary repeater.

    Two echoes look alike: one is a vessel under way, the other a moored or drifting
    repeater whose range and range rate are false. Scan by scan the evidence is weighed
    until one reading is likely enough, or the scans end undecided.

    Parameters
    ----------
    contacts
        Ranges, bearings and range rates of two or more contacts.
    navigation
        Own ship's positions, covering the times of the contacts.
    miss
        Accepted probability of taking the first contact for the moving one when it is
        the second, in (0, 0.5).
    false_alarm
        Accepted probability of the opposite error, in (0, 0.5).
    errors
        Deviations of the measurements, where the table has none.
    filters
        What the filters assume of moving and drifting contacts.

    Returns
    -------
    Decision
        Verdict, odds over time, consistency and observability of each pair.

    Raises
    ------
    DataError
        Fewer than two contacts share scans, deviations are missing, or own ship's
        navigation does not cover the scans.
    OptionError
        An option is out of range.

    Notes
    -----
    L(k) = L(k-1) + ln p(z(k) | Z, H1) - ln p(z(k) | Z, H0); decide at ln((1 - P_M)/P_F)
    and ln(P_M/(1 - P_F)) (Wald 1947; Jeong and Hong 1996, eqs. 3-4 and 20).
    """
    for name, value in (("miss", miss), ("false_alarm", false_alarm)):
        if not 0.0 < value < 0.5:
            msg = f"{name} must be in (0, 0.5), got {value}."
            raise OptionError(msg)
    noise = filter_noise(filters)
    pairs = arrange_contacts(contacts, navigation, errors)
    n_contacts = np.unique(contacts.contact).size
    share = 1.0 / (n_contacts - 1)
    thresholds = wald_thresholds(miss * share, false_alarm * share)
    verdicts = [judge_pair(pair, noise, thresholds) for pair in pairs]
    per_scan = [v.log_odds.size for v in verdicts]
    return Decision(
        first_contact=np.array([pair.first for pair in pairs]),
        second_contact=np.array([pair.second for pair in pairs]),
        verdict=np.array([v.verdict for v in verdicts]),
        probability=np.array([v.probability for v in verdicts]),
        final_log_odds=np.array([v.final_log_odds for v in verdicts]),
        decision_time_s=np.array([v.decision_time_s for v in verdicts]),
        decision_scan=np.array([v.decision_scan for v in verdicts]),
        expected_scans=np.array([v.expected_scans for v in verdicts]),
        fixed_scans=np.array([v.fixed_scans for v in verdicts]),
        fixed_verdict=np.array([v.fixed_verdict for v in verdicts]),
        consistency=np.stack([v.consistency for v in verdicts]),
        inverse_range_std=np.stack([v.inverse_range_std for v in verdicts]),
        observable=np.stack([v.observable for v in verdicts]),
        reasons=np.array([v.reasons for v in verdicts]),
        scan_pair=np.repeat(np.arange(len(pairs)), per_scan),
        scan_time_s=np.concatenate([v.time_s for v in verdicts]),
        log_odds=np.concatenate([v.log_odds for v in verdicts]),
        log_likelihood=np.concatenate([v.log_likelihood for v in verdicts]),
        lower_threshold=thresholds.lower,
        upper_threshold=thresholds.upper,
        miss_probability=miss * share,
        false_alarm_probability=false_alarm * share,
        moving_contact=_moving([p.first for p in pairs], [p.second for p in pairs],
                               verdicts),
        start_utc_ns=contacts.start_utc_ns,
    )  # fmt: skip


def _moving(first: list[int], second: list[int], verdicts: list[PairVerdict]) -> int:
    """Return the contact that moves against every other, 0 for none."""
    wins: dict[int, int] = {}
    for a, b, found in zip(first, second, verdicts, strict=True):
        winner = {"first moves": a, "second moves": b}.get(found.verdict)
        if winner is not None:
            wins[winner] = wins.get(winner, 0) + 1
    rivals = len({*first, *second}) - 1
    return next((contact for contact, count in wins.items() if count == rivals), 0)
