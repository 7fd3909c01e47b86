"""What is told of sound without a vessel: one kind of disturbance at a time.

Prints a table in Markdown; its numbers are recordings of each disturbance, seconds of
each and the first seed; disturbances may follow, all and none unless named:
python -m tests.presence.false_presence 2 480 1000 drift rain
"""

import sys
import warnings
from collections import Counter

from uwtrack_cli.data.presence import KINDS, Presence
from uwtrack_cli.flow.engine import run_recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.simulate import simulate_recordings
from uwtrack_cli.simulate.random_passages import DISTURBANCES, draw_scenario

RATE_HZ = 4000.0


def told(kind, seed, duration_s):
    """Count the rows of every kind in one recording with one disturbance."""
    scenario = draw_scenario(
        seed, n_vessels=0, kinds=[kind] if kind else [], sample_rate_hz=RATE_HZ,
        duration_s=duration_s,
    )  # fmt: skip
    (recording,) = simulate_recordings(scenario)
    made = run_recipe(recording, load_recipe("presence"))
    (presence,) = [c for c in made if isinstance(c, Presence)]
    return Counter(presence.kind.tolist()), int((presence.encounter > 0).sum())


def main(runs, duration_s, first_seed, *wanted):
    """Print one row for each disturbance, and one for none unless some are named."""
    warnings.simplefilter("ignore")
    sys.stdout.write(f"| disturbance | {' | '.join(KINDS)} | passages |\n")
    sys.stdout.write("|---" * (len(KINDS) + 2) + "|\n")
    for kind in wanted or ("", *DISTURBANCES):
        total, passed = Counter(), 0
        for seed in range(runs):
            found, encounters = told(kind, first_seed + seed, duration_s)
            total += found
            passed += encounters
        cells = " | ".join(str(total[name]) for name in KINDS)
        sys.stdout.write(f"| {kind or 'none'} | {cells} | {passed} |\n")
        sys.stdout.flush()


if __name__ == "__main__":
    runs, duration_s, first_seed = sys.argv[1:4]
    main(int(runs), float(duration_s), int(first_seed), *sys.argv[4:])
