"""Where live sound holds something that a look could find: more than in noise alone."""

import numpy as np
import pytest

from tests.lines.line_scenes import line_peaks, some_frames
from tests.support import recording_of, white_noise
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.data.transients import LEVEL, Transients
from uwtrack_cli.flow.live_activity import ALWAYS, HeardSpan, ToldPassage, is_worth_a_look, spans_of
from uwtrack_cli.lines.track import track_lines
from uwtrack_cli.presence.level_humps import level_humps
from uwtrack_cli.spectra.levels import measure_levels
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

RATE = 500
BAND = {"band_hz": (100.0, 240.0)}


def levels_of(sound):
    recording = recording_of(sound, RATE)
    return Levels.join(list(measure_levels(compute_spectrogram(recording), **BAND)))


def passing(seed, width_s, peak, duration_s=400.0):
    """Noise whose power has 1 / (1 + x^2) of a passage added in the middle."""
    time_s = np.arange(round(duration_s * RATE)) / RATE
    x = (time_s - 0.5 * duration_s) / width_s
    noise = white_noise(time_s.size, seed, rate_hz=RATE)
    return noise * np.sqrt(1.0 + peak / (1.0 + x**2))


def test_noise_alone_gives_few_spans():
    """400 s at a time of half an hour: most have none."""
    empty = [not spans_of([levels_of(passing(seed, 1.0, 0.0))]) for seed in range(5)]
    assert sum(empty) >= 3


@pytest.mark.parametrize(("width_s", "weak"), [(5.0, 0.8), (15.0, 0.3), (30.0, 0.3)])
def test_a_passage_of_the_level_is_a_span_long_before_it_is_told(width_s, weak):
    """At 2 over the noise presence tells a rise; at 0.3 nothing does, and it counts."""
    for peak, is_told in ((2.0, True), (weak, False)):
        levels = levels_of(passing(3, width_s, peak))
        assert bool(level_humps(levels)) == is_told
        spans = spans_of([levels])
        assert any(span.begin_s < 200.0 < span.end_s for span in spans)


@pytest.mark.parametrize("peak", [2.0, 10.0])
def test_a_loud_passage_is_no_longer_span_than_it_is_heard(peak):
    """At 12 d/v it keeps 0.7 % of its peak; a run of minutes is high for that alone."""
    spans = spans_of([levels_of(passing(3, 4.0, peak))])
    (span,) = [one for one in spans if one.begin_s < 200.0 < one.end_s]
    assert 152.0 < span.begin_s < 197.0
    assert 203.0 < span.end_s < 248.0


def test_a_passage_within_a_longer_rise_does_not_hide_it():
    time_s = np.arange(400 * RATE) / RATE
    slow = np.sqrt(1.0 + 0.5 / (1.0 + ((time_s - 200.0) / 60.0) ** 2))
    spans = spans_of([levels_of(slow * passing(3, 2.0, 20.0))])
    assert max(span.end_s - span.begin_s for span in spans) > 60.0


def test_levels_with_bearings_count_throughout():
    levels = levels_of(passing(1, 1.0, 0.0))
    turned = np.zeros_like(levels.excess_db)
    known = levels.take("frame", slice(None))
    object.__setattr__(known, "bearing_deg", turned)
    assert spans_of([known]) == [ALWAYS]
    assert spans_of([levels.frames]) == [ALWAYS]


def test_lines_of_a_contact_count_throughout_and_hum_as_it_begins():
    n = 400
    time_s = some_frames(n).time_s
    bend = 1.0 - 0.004 * np.tanh((time_s - 100.0) / 20.0)
    frequency = np.stack([63.0 * bend, 126.0 * bend, np.full(n, 50.0)], axis=1)
    lines = Lines.join(list(track_lines(iter([line_peaks(frequency)]))))
    spans = {round(s.frequency_hz): s for s in spans_of([lines])}
    assert spans[63].end_s - spans[63].begin_s > 150.0
    assert spans[50].end_s == spans[50].begin_s


def test_a_rise_of_seconds_is_a_span():
    rises = Transients(
        time_s=np.array([30.0]), half_length_s=np.array([0.5]),
        kind=np.array([LEVEL]), spreads=np.array([9.0]), least_spreads=7.0, sensor="h1",
    )  # fmt: skip
    assert spans_of([rises]) == [HeardSpan(29.5, 30.5)]


def worth(*spans, now_s=400.0, last_s=-np.inf, segment_s=160.0, shorter_s=0.0, told=()):
    return is_worth_a_look(spans, now_s, last_s, segment_s, shorter_s, told)


def test_a_look_needs_something_new():
    assert not worth()
    assert worth(ALWAYS, last_s=399.0)
    assert worth(HeardSpan(300.0, 305.0), last_s=320.0)
    assert not worth(HeardSpan(300.0, 305.0), last_s=340.0)


def test_a_longer_segment_is_for_what_a_shorter_one_does_not_hold():
    long = {"segment_s": 400.0, "shorter_s": 160.0}
    assert worth(HeardSpan(200.0, 399.0), **long)
    assert not worth(HeardSpan(300.0, 399.0), **long)
    assert not worth(HeardSpan(200.0, 205.0), **long)


def test_what_was_told_is_looked_at_once_in_its_width():
    told = [ToldPassage(200.0, 360.0, (63.0, 126.0), 30.0)]
    own, other = HeardSpan(210.0, 399.0, 63.2), HeardSpan(210.0, 399.0, 91.0)
    assert not worth(own, HeardSpan(210.0, 390.0), told=told, last_s=380.0)
    assert worth(own, told=told, last_s=365.0)
    assert worth(other, told=told, last_s=380.0)
    assert worth(HeardSpan(370.0, 399.0, 63.2), told=told, last_s=380.0)
    assert worth(ALWAYS, told=told, last_s=380.0)


def test_a_passage_is_looked_at_by_what_holds_it_until_it_is_final():
    def told(looked_s, is_final=False):
        return ToldPassage(100.0, 420.0, (63.0,), 20.0, 240.0, looked_s, is_final)

    own, over = HeardSpan(210.0, 399.0, 63.2), HeardSpan(210.0, 440.0, 63.2)
    assert worth(own, told=[told(380.0)])
    assert not worth(own, told=[told(381.0)])  # by whatever segment
    assert not worth(own, told=[told(0.0)], now_s=401.0)  # from 241 s on
    assert worth(own, told=[told(0.0)], now_s=401.0, segment_s=400.0)
    assert not worth(own, told=[told(0.0, is_final=True)])
    assert worth(over, told=[told(381.0, is_final=True)])  # it goes on
    assert not worth(over, told=[told(381.0)], last_s=385.0)
