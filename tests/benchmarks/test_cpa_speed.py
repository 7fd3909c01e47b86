"""CPU time of a joint fit against `scipy.optimize.curve_fit` on the same model.

Both fit eleven unknowns (three of the motion, bearing, level, floor, five rest
frequencies) to the same 4200 values from the same start, to the same optimum within a
deviation. One measurement in fifty is wild, as it is in tracked lines, so the peer needs
a robust loss, too; without one its result would be deviations off. The peer's model is
what a user would write for it: values alone, no partials. On top of the peer's work the
joint fit finds the scale of every row and the long-run variance of coloured noise.
"""

import time

import numpy as np
import pytest

from tests.draws.passage_truth import Scene, received
from uwtrack_cli.acoustics.medium import Medium
from uwtrack_cli.motion.passage.fit.estimator import fit_passage
from uwtrack_cli.motion.passage.model.measurements import PassageData, make_blocks

REST = (63.0, 126.0, 189.0, 310.0, 400.0)
SCENE = Scene(rest_hz=REST)
START = np.array([[303.0, np.log(38.0), 5.5, -2.0]])


def measured(seed=1):
    """600 one-second frames: five lines, a bearing and a level each."""
    rng = np.random.default_rng(seed)
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


def law(seconds, t0, width, speed):
    """Frequency ratio, relative bearing (degrees) and spreading of a passage."""
    slant_s = np.exp(width)
    mach = speed / 1500.0
    gamma = 1 - mach**2
    lag = seconds - t0
    root = np.sqrt(lag**2 + gamma * slant_s**2)
    emitted = (lag - mach * root) / gamma
    flat_s = np.sqrt(slant_s**2 - (19.0 / speed) ** 2)
    near = 2 * np.log(slant_s * gamma / (root - mach * lag))
    return ((1 - mach * lag / root) / gamma, np.rad2deg(np.arctan2(emitted, flat_s)), near)


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
        ratio, angle, near = law(seconds, t0, width, speed)
        return np.concatenate(
            [
                (np.array(rest)[:, None] * ratio).ravel(),
                b0 - angle,
                level + 10 / np.log(10) * np.logaddexp(near, floor),
            ]
        )

    first = [*START[0, :3], 35.0, 8.0, START[0, 3], *REST]
    found, covariance = curve_fit(
        model, None, values, first, sigma, absolute_sigma=True, method="trf",
        loss="soft_l1", x_scale="jac",
    )  # fmt: skip
    assert np.all(np.isfinite(covariance))
    return found


def own_fit(data):
    return fit_passage(make_blocks(data), START, np.array([-1.0]), Medium(1500.0, 19.0))


def cpu_seconds(tasks, repeats=60):
    """Least CPU time of each task, run in turn so that a busy spell meets all alike."""
    least = [np.inf] * len(tasks)
    for _ in range(repeats):
        for k, task in enumerate(tasks):
            begin = time.process_time()
            task()
            least[k] = min(least[k], time.process_time() - begin)
    return least


@pytest.mark.benchmark
def test_a_joint_fit_is_several_times_faster_than_curve_fit():
    data = measured()
    theirs_s, ours_s = cpu_seconds([lambda: peer_fit(data), lambda: own_fit(data)])
    ratio = theirs_s / ours_s
    # 3.7 measured on a quiet machine (4.7 before the horizontal range over speed was
    # the unknown; the aim is 5): the guard tells a regression from noise
    assert ratio >= 2.5, f"curve_fit over joint fit: {ratio:.1f}"


def test_the_joint_fit_agrees_with_the_robust_peer_and_is_no_less_accurate():
    """Errors of both over runs, in the deviations that the bound gives."""
    truth = np.array([300.0, 250.0 / 6.0, 6.0])
    ours, theirs, bounds = [], [], []
    for seed in range(12):
        data = measured(seed)
        own, peer = own_fit(data), peer_fit(data)
        ours.append([own.theta[0, 0], own.range_over_speed_s[0], own.theta[0, 2]])
        theirs.append([peer[0], np.exp(peer[1]), peer[2]])
        bounds.append(np.sqrt(np.diag(own.covariance[0])[:3]))
    assert np.all(np.abs(np.subtract(ours, theirs)) < np.array(bounds))
    assert np.all(np.abs(np.array(ours) - truth) < 4 * np.array(bounds))
    spread = [np.sqrt(((np.array(x) - truth) ** 2).mean(axis=0)) for x in (ours, theirs)]
    assert np.all(spread[0] <= 1.1 * spread[1])
