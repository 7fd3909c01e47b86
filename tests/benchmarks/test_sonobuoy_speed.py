"""Speed of the demultiplexer of sonobuoys, as a ratio of CPU time in one process."""

import numpy as np
import pytest

from tests.benchmarks.test_chain_speed import cpu_s
from tests.draws.buoys import held, scene
from uwtrack_cli.flow.sonobuoy import demultiplex

pytestmark = pytest.mark.benchmark


def bare_transforms(audio, rate):
    """Transform what each second is made of, and four bands of it back."""
    for start in range(0, audio.size - 3 * rate, rate):
        spectrum = np.fft.rfft(audio[start : start + 3 * rate])
        for first in (0, 9000, 18_000, 27_000):
            np.fft.ifft(spectrum[first : first + 18_000])


def test_a_second_of_audio_costs_little_more_than_its_transforms(capsys):
    audio = held(scene(1, 60.0, {"radio_snr_db": 20.0}))

    def ours():
        for _ in demultiplex(audio).reader(6000):
            pass

    samples = audio.reader.samples[:, 0].astype(float)
    ratio = cpu_s(ours) / cpu_s(lambda: bare_transforms(samples, 48_000))
    with capsys.disabled():
        print(f"\ndemultiplexer: {ratio:.2f} times its bare transforms")
    assert ratio < 4.0
