"""The likelihood of an image of fringes: what is integrated out, against plain matrices."""

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.stats import multivariate_normal

from uwtrack_cli.motion.evidence.fringe_lines import course_share
from uwtrack_cli.motion.evidence.fringe_panel import ANY_BEND, Panel
from uwtrack_cli.motion.evidence.fringe_template import FringeModel, Hypothesis, Template
from uwtrack_cli.motion.evidence.fringes import likeliest_still

ROWS, CELLS = 9, 24
PASSAGE = Hypothesis(40.0, 20.0, tilt=0.3)


@pytest.fixture
def panel():
    rng = np.random.default_rng(4)
    precision = rng.uniform(50.0, 200.0, CELLS)
    value = rng.standard_normal((ROWS, CELLS)) / np.sqrt(precision)
    return Panel(10.0 * np.arange(ROWS), value, precision, 10.0, 0.05)


def _plain(panel, template=None):
    """Return the log density of what is free of levels, slopes and cells, by matrices."""
    root = np.sqrt(panel.precision)
    place = np.linspace(-1.0, 1.0, CELLS)
    bent = np.linalg.qr(np.polynomial.legendre.legvander(place, 4) * root[:, None])[0]
    rows = np.kron(np.eye(ROWS), bent)
    is_free = np.tile(np.arange(5) < 2, ROWS)
    cells = np.kron(np.ones((ROWS, 1)), np.eye(CELLS))
    own = null_space(np.hstack([rows[:, is_free], cells]).T)
    covariance = np.eye(ROWS * CELLS)
    covariance += panel.bend * rows[:, ~is_free] @ rows[:, ~is_free].T
    if template is not None:
        model = FringeModel(panel, [template])
        # a pattern's parts are linear: each by itself, as the spline shows it
        spline = model._solved([PASSAGE]).splines[0]
        shown = [spline.values(unit) for unit in np.eye(spline.size)]
        parts = np.array([(one * root).ravel() for one in shown])
        covariance += template.variance * parts.T @ parts
        spectrum = (model._spectrum(PASSAGE) * root).reshape(3, -1)
        covariance += spectrum.T @ spectrum
    heard = own.T @ (panel.value * root).ravel()
    return multivariate_normal.logpdf(heard, cov=own.T @ covariance @ own)


@pytest.mark.parametrize("bend", [0.1, 3.0, ANY_BEND])
def test_what_is_integrated_out_is_as_plain_matrices_have_it(panel, bend):
    bent, plain = panel._replace(bend=bend), panel._replace(bend=1.0)
    template = Template(2.0, 0.05)
    nothing = FringeModel(plain, []).log_likelihood([])
    for told, passages in ((None, []), (template, [PASSAGE])):
        model = FringeModel(bent, [told] if told else [])
        more = model.log_likelihood(passages) - nothing
        assert more == pytest.approx(_plain(bent, told) - _plain(plain), abs=1e-5)


def test_a_course_that_follows_noise_gains_nothing():
    rng = np.random.default_rng(5)
    value = 0.1 * rng.standard_normal((80, 120))
    noise = Panel(2.0 * np.arange(80), value, np.full(120, 100.0), 2.0, 0.03)
    still = likeliest_still(noise)
    model = FringeModel(noise, [still.prior])
    gain = model.log_likelihood([still.course]) + still.share
    assert gain - FringeModel(noise, []).log_likelihood([]) < 2.0


def test_a_smooth_course_is_likelier_than_one_that_jumps():
    rng = np.random.default_rng(6)
    time_s = 2.0 * np.arange(60)
    cells = np.arange(120)
    smooth = 0.2 * np.sin(time_s / 30.0)
    shares = []
    for course in (smooth, rng.permutation(smooth)):
        wave = np.sin((cells - course[:, None] / 0.03) / 4.0)
        value = wave + 0.1 * rng.standard_normal(wave.shape)
        panel = Panel(time_s, value, np.full(120, 100.0), 2.0, 0.03)
        even = (time_s, np.ones(60))
        moving = Hypothesis(0.0, 1.0, course=even, swing=(time_s, course))
        shares.append(course_share(panel, moving, Template(1.5, 0.25), 1.0))
    assert shares[0] > shares[1] + 60.0
