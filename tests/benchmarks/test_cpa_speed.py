"""CPU time of a joint fit against `scipy.optimize.curve_fit` on the same model.

One measurement in fifty is wild, as it is in tracked lines, so the peer needs a robust
loss, too; without one its result would be many deviations off.
"""

import time

import numpy as np
import pytest

from tests.estimation.passage_truth import Scene, received
from uwtrack_cli.estimation.passage_data import PassageData, make_blocks
from uwtrack_cli.estimation.passage_fit import fit_passage
from uwtrack_cli.estimation.passage_normal import Medium
from uwtrack_cli.physics.passage import passage_law

REST = (63.0, 126.0, 189.0, 310.0, 400.0)
SCENE = Scene(rest_hz=REST)
START = np.array([[303.0, np.log(38.0), 5.5, -2.0]])


def measured():
    """600 one-second frames: five lines, a bearing and a level each."""
    rng = np.random.default_rng(1)
    seconds = np.arange(0.5, 600.0)
    motion = np.array([SCENE.closest_s, 250.0 / 6.0, 6.0])
    ratio, angle, distance = received(SCENE, seconds, motion)
    far = distance / 250.0
    sigma = np.tile(0.01 * far, (5, 1))
    frequency = np.array(REST)[:, None] * ratio + sigma * rng.normal(size=(5, 600))
    wild = rng.random((5, 600)) < 0.02
    frequency = np.where(wild, frequency + rng.uniform(-1, 1, (5, 600)), frequency)
    bearing = 40.0 - np.rad2deg(angle) + 3 * far * rng.normal(size=600)
    level = 10 * np.log10(10 / far**2 + 1) + rng.normal(size=600)
    return PassageData(
        seconds, frequency, sigma, bearing[None] % 360, (3 * far)[None], level[None],
        np.ones((1, 600)),
    )  # fmt: skip


def peer_fit(data):
    """The same unknowns by curve_fit: what a user would write."""
    from scipy.optimize import curve_fit

    seconds = data.time_s
    sigma = np.concatenate(
        [data.frequency_std_hz.ravel(), data.bearing_std_deg[0], data.level_std_db[0]]
    )
    bearing = (data.bearing_deg[0] - 40 + 180) % 360 - 180 + 40
    values = np.concatenate([data.frequency_hz.ravel(), bearing, data.level_db[0]])

    def model(_, t0, width, speed, b0, level, floor, *rest):
        law = passage_law(seconds, np.array([t0, width, speed]), 1500.0, 19.0)
        return np.concatenate(
            [
                (np.array(rest)[:, None] * (1 + law.shift)).ravel(),
                b0 - np.rad2deg(law.angle),
                level + 10 / np.log(10) * np.logaddexp(law.spread, floor),
            ]
        )

    first = [*START[0, :3], 35.0, 8.0, START[0, 3], *REST]
    found, _ = curve_fit(
        model, None, values, first, sigma, absolute_sigma=True, method="trf",
        loss="soft_l1", x_scale="jac",
    )  # fmt: skip
    return found


def own_fit(data):
    return fit_passage(make_blocks(data), START, np.array([-1.0]), Medium(1500.0, 19.0))


def cpu_seconds(task, repeats=7):
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        task()
        times.append(time.process_time() - begin)
    return min(times)


@pytest.mark.benchmark
def test_a_joint_fit_is_several_times_faster_than_curve_fit():
    data = measured()
    peer, own = peer_fit(data), own_fit(data)
    deviation = np.sqrt(np.diag(own.covariance[0])[:3])
    ours = np.array([own.theta[0, 0], own.range_over_speed_s[0], own.theta[0, 2]])
    theirs = np.array([peer[0], np.exp(peer[1]), peer[2]])
    assert np.all(np.abs(ours - theirs) < deviation)
    truth = np.array([300.0, 250.0 / 6.0, 6.0])
    assert np.all(np.abs(ours - truth) < 4 * deviation)
    ratio = cpu_seconds(lambda: peer_fit(data)) / cpu_seconds(lambda: own_fit(data))
    assert ratio >= 2.5, f"curve_fit over joint fit: {ratio:.1f}"
