"""The Cramer-Rao bound against a published table; singular cases."""

from dataclasses import replace

import numpy as np
import pytest

from studies.rows import load_reference
from studies.tma_scenarios import TARGETS, make_problem, make_scenario
from uwtrack_cli.constants import KNOT_MPS
from uwtrack_cli.motion.target_motion.model import to_motion
from uwtrack_cli.motion.target_motion.observability import (
    accuracy_probability,
    assess,
    criterion_probability,
    information,
)

REFERENCE = load_reference("tma")
UNITS = {"range_std_m": (0, 1.0), "speed_std_kn": (2, 1.0 / KNOT_MPS),
         "course_std_deg": (3, np.degrees(1.0)), "bearing_std_deg": (1, np.degrees(1.0)),
         "rest_std_hz": (4, 1.0)}  # fmt: skip


def problem_of(name, noise=1.0, rows=1000):
    return make_problem(make_scenario(name), noise=noise).rows(slice(0, rows))


@pytest.mark.parametrize("name", TARGETS)
def test_the_bound_agrees_with_the_published_table(name):
    tolerance = 0.005 if name != "S2" else 0.03
    truth = make_scenario(name).solution()
    for row in (row for row in REFERENCE["bound"] if row["case"] == name):
        found = information(problem_of(name, row["noise"], row["rows"]), truth)
        covariance = found.covariance()
        std = np.sqrt(np.diagonal(covariance))
        for key, (place, unit) in UNITS.items():
            assert std[place] * unit == pytest.approx(row[key], rel=tolerance), row
        assert found.condition == pytest.approx(row["condition"], rel=2 * tolerance)
        chance = accuracy_probability(covariance, 20_000.0)
        assert chance == pytest.approx(row["probability"], abs=0.005)  # drawn there


@pytest.mark.parametrize("row", REFERENCE["criterion"],
                         ids=lambda row: f"{row['case']}-{row['noise']}")  # fmt: skip
def test_the_criterion_is_met_after_the_published_number_of_rows(row):
    name, truth = row["case"], make_scenario(row["case"]).solution()
    slack = 10 if name == "S2" else 5

    def chance(rows):
        found = information(problem_of(name, row["noise"], rows), truth)
        return accuracy_probability(found.covariance(), 20_000.0)

    for wanted, published in zip((0.5, 0.9, 0.99), row["both"], strict=True):
        if published is None:
            assert chance(1000) < wanted
        else:
            assert chance(int(published) - slack) < wanted
            assert chance(min(1000, int(published) + slack)) >= wanted - 1e-3


@pytest.mark.parametrize("kind", ["bearings", "frequencies"])
@pytest.mark.parametrize("name", TARGETS)
def test_one_kind_of_data_has_the_published_condition_or_is_singular(name, kind):
    problem = problem_of(name)
    lost = "frequency_weight" if kind == "bearings" else "bearing_weight"
    part = replace(problem, **{lost: 0.0 * getattr(problem, lost)})
    if kind == "bearings":
        part = replace(part, frequency_weight=part.frequency_weight[:0],
                       frequency_hz=part.frequency_hz[:, :0])  # fmt: skip
    truth = make_scenario(name).solution()
    found = information(part, truth)
    published = REFERENCE["condition"][kind][name]
    if published is None:
        seen = assess(found, to_motion(truth))
        assert np.isinf(found.condition)
        assert found.rank < len(found.bread)
        # opposite courses: scaling changes the speed alone, turning the course
        hidden = [0, 2] if kind == "bearings" else [1, 3]
        assert not seen.observable[hidden].any()
        assert bool(seen.observable[0]) == (kind == "frequencies")
    else:
        assert found.condition == pytest.approx(published, rel=0.03)


def test_several_lines_sharpen_the_range_as_published_and_a_mean_over_them_less():
    for name, published in REFERENCE["several_lines"].items():
        problem, truth = problem_of(name), make_scenario(name).solution()
        share = np.array([650.0, 320.0, 150.0])[:, np.newaxis] / 650.0
        weight = problem.frequency_weight / np.array([[1.0], [0.5], [0.25]])
        three = replace(problem, frequency_hz=problem.frequency_hz * share, frequency_weight=weight)
        mean = replace(three, frequency_weight=weight / np.sqrt(3.0), frequency_share=1.0 / 3.0)
        ours = [
            np.sqrt(information(case, truth).covariance()[0, 0]) for case in (problem, three, mean)
        ]
        # the draw of the rest frequencies' residuals does not enter: 1 % is rounding
        assert ours == pytest.approx(published, rel=0.01)


def test_the_criterion_probability_agrees_with_random_draws():
    rng = np.random.default_rng(5)
    root = rng.standard_normal((3, 3))
    bounds = np.array([1.0, 2.0, 0.7])
    draws = rng.standard_normal((400_000, 3)) @ root.T
    share = np.mean(np.all(np.abs(draws) < bounds, axis=1))
    assert criterion_probability(root @ root.T, bounds) == pytest.approx(
        share, abs=4.0 * np.sqrt(share / 400_000)
    )
