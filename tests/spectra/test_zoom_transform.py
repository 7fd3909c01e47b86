"""The surroundings of a line: a tone lies where it is, and what folds in is faint."""

from dataclasses import replace

import numpy as np

from tests.support import recording_of as held_recording
from tests.support import white_noise
from uwtrack_cli.spectra.zoom_transform import Window, zoom

RATE_HZ = 2000.0


class Held:
    """Samples that can be read again."""

    def __init__(self, samples):
        self.samples = np.asarray(samples, np.float32).reshape(-1, 1)

    def __call__(self, _):
        yield self.samples

    def stretch(self, first, count):
        return self.samples[first : first + count]


def recording_of(samples, rate_hz):
    return replace(held_recording(samples, rate_hz), reader=Held(samples))


def ridge_hz(found):
    return found.offset_hz[np.argmax(found.level_db, axis=1)]


def test_a_swept_tone_lies_where_its_phase_says():
    time_s = np.arange(int(60 * RATE_HZ)) / RATE_HZ
    turns = 300.0 * time_s + 0.5 * 0.02 * (time_s - 30.0) ** 2
    recording = recording_of(np.cos(2 * np.pi * turns), RATE_HZ)
    (found,) = zoom(recording, (0.0, 60.0), [Window(300.0, 2.0, 5.0)])
    inside = (found.time_s > 3.0) & (found.time_s < 57.0)
    expected = 0.02 * (found.time_s - 30.0)
    cell = found.offset_hz[1] - found.offset_hz[0]
    np.testing.assert_allclose(ridge_hz(found)[inside], expected[inside], atol=cell)


def test_what_folds_into_the_band_is_sixty_decibels_down():
    time_s = np.arange(int(30 * RATE_HZ)) / RATE_HZ
    tone = 1e-3 * np.cos(2 * np.pi * 100.0 * time_s)
    (found,) = zoom(recording_of(tone, RATE_HZ), (0.0, 30.0), [Window(100.0, 4.0, 2.0)])
    loud = tone + np.cos(2 * np.pi * 115.0 * time_s)
    loud += np.cos(2 * np.pi * 913.0 * time_s)
    (both,) = zoom(recording_of(loud, RATE_HZ), (0.0, 30.0), [Window(100.0, 4.0, 2.0)])
    cell = found.offset_hz[1] - found.offset_hz[0]
    middle = slice(10, -10)
    assert np.abs(ridge_hz(both)[middle]).max() <= cell


def test_a_stretch_shorter_than_a_frame_has_no_frames():
    recording = recording_of(white_noise(1000, 1), RATE_HZ)
    (found,) = zoom(recording, (0.0, 0.4), [Window(300.0, 5.0, 2.0)])
    assert found.time_s.size == 0
