"""What the program can do is as frozen: a short set here, all with ``-m acceptance``."""

import pytest

from tests.acceptance.comparison import differences
from tests.acceptance.faults import FAULTS, ROOT
from tests.acceptance.parts import PARTS, SHORT
from tests.acceptance.rates import held
from tests.acceptance.running import FROZEN, load, run_all

SHORT_CASES = [(part, name) for part, names in SHORT.items() for name in names]


@pytest.mark.parametrize(("part", "name"), SHORT_CASES, ids=list(map("/".join, SHORT_CASES)))
def test_a_case_is_as_good_as_frozen(part, name):
    case = PARTS[part]()[name]
    ((_, now),) = run_all({(part, name): case}, processes=0)
    frozen = load(FROZEN, part)["cases"]
    assert list(differences({name: frozen[name]}, {name: now})) == []


def test_every_fault_can_be_planted():
    """One whose text has changed is seen by nobody."""
    stale = [
        fault.name
        for fault in FAULTS
        if (ROOT / fault.path).read_text(encoding="utf-8").count(fault.old) != 1
    ]
    assert stale == []


@pytest.mark.acceptance
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("part", PARTS)
def test_a_part_is_as_good_as_frozen(part):
    frozen = load(FROZEN, part)["cases"]
    made = PARTS[part]()
    if not made:
        pytest.skip("UWTRACK_REAL_DATA is not set")
    cases = {(part, name): made[name] for name in frozen if name in made}
    now = {name: one for (_, name), one in run_all(cases, processes=0)}
    red = list(differences(frozen, now))
    assert red + (list(held({part: now}, [part])) if now.keys() == made.keys() else []) == []


def test_what_is_frozen_meets_its_own_limits():
    results = {part: load(FROZEN, part)["cases"] for part in PARTS}
    whole = [part for part, cases in results.items() if cases.keys() >= PARTS[part]().keys()]
    assert list(held(results, whole)) == []
    assert not [
        (part, name)
        for part, cases in results.items()
        for name, one in cases.items()
        if "failed" in one
    ]
