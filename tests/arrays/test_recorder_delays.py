"""Delays between synchronised recorders, from files of their own."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.draws.recorder_delays import bound_s, errors, recorders
from uwtrack_cli.arrays.delays import measure_delays
from uwtrack_cli.arrays.recorders import join_recorders
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.files.audio.recording_file import write_wav
from uwtrack_cli.files.hdf5.product import read_product


@pytest.mark.parametrize("snr_db", [10.0, -3.0])
def test_delays_of_two_recorders_are_within_twice_the_bound(snr_db):
    # Knapp and Carter (1976): no unbiased delay of a window scatters less
    off, std = np.concatenate([errors(seed, snr_db) for seed in (50, 51, 52)], axis=1)
    assert off.size >= 30
    assert 0.9 * bound_s(snr_db) < np.sqrt(np.mean(off**2)) < 2.0 * bound_s(snr_db)
    assert np.mean(np.abs(off) < 1.96 * std) > 0.9


def test_the_clocks_are_told_and_not_part_of_the_deviation():
    pair, delay_s = recorders(60, 10.0, clock_std_s=0.01)
    (found,) = measure_delays(join_recorders(pair), window_s=4.0, band_hz=(200.0, 1000.0))
    np.testing.assert_allclose(found.clock_std_s, 0.01 * np.sqrt(2.0))
    assert (found.delay_std_s < 1e-4).all()
    np.testing.assert_allclose(found.delay_s, delay_s, atol=5e-5)
    assert set(found.channel_a) == {"r1"}
    assert set(found.channel_b) == {"r2"}


def test_clocks_without_a_deviation_are_not_known():
    pair, _ = recorders(60, 10.0)
    pair[0] = replace(pair[0], sensor=replace(pair[0].sensor, clock_std_s=None))
    (found,) = measure_delays(join_recorders(pair), window_s=4.0)
    assert np.isnan(found.clock_std_s).all()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"start_utc_ns": None}, "no start time"),
        ({"sample_rate_hz": 8000.0}, "sample rates of 4000, 8000 Hz"),
        ({"start_utc_ns": 1_800_000_000_000_000_000}, "no time in common"),
    ],
)
def test_recordings_that_cannot_be_compared_are_refused(change, says):
    pair, _ = recorders(61, 10.0)
    pair[1] = replace(pair[1], **change)
    with pytest.raises(DataError, match=says):
        join_recorders(pair)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"id": "r1"}, "different identifiers"),
        ({"east_m": None, "north_m": None}, "need the places of all recorders"),
    ],
)
def test_recorders_need_a_name_and_a_place(change, says):
    pair, _ = recorders(61, 10.0)
    pair[1] = replace(pair[1], sensor=replace(pair[1].sensor, **change))
    with pytest.raises(DataError, match=says):
        join_recorders(pair)


def test_a_window_shorter_than_the_way_of_sound_is_refused():
    pair, _ = recorders(61, 10.0, distance_m=2000.0)
    with pytest.raises(OptionError, match="twice as long"):
        measure_delays(join_recorders(pair), window_s=1.0)


def test_delays_of_several_files_are_made_again_to_the_bit(uwtrack, tmp_path, monkeypatch):
    # the second recorder begins up to half a second later, and not on a sample of the first
    monkeypatch.chdir(tmp_path)
    pair, _ = recorders(62, 10.0)
    for one in pair:
        blocks = iter(one.reader(one.n_samples))
        write_wav(one.name, blocks, one.sample_rate_hz, start_utc_ns=one.start_utc_ns)
        place = f'id = "{one.sensor.id}"\neast_m = {one.sensor.east_m}\nnorth_m = 0.0\n'
        Path(f"{one.sensor.id}.sensor.toml").write_text(f"{place}clock_std_s = 1e-3\n")
    made = uwtrack("delays", "r1.wav", "r2.wav", "--window-s", 4, "-o", "d.delays.h5")
    assert made.exit_code == 0, made.output
    with read_product(Path("d.delays.h5")) as product:
        (step,) = product.history
        assert [source.name for source in step.sources] == ["r1.wav", "r2.wav"]
    for name in ("r1.sensor.toml", "r2.sensor.toml"):  # the result has what they said
        Path(name).unlink()
    again = uwtrack("rerun", "d.delays.h5", "-o", "again.h5")
    assert again.exit_code == 0, again.output
    assert uwtrack("diff", "d.delays.h5", "again.h5").exit_code == 0
    assert "sound: 2 recordings: r1.wav, r2.wav" in uwtrack("info", "d.delays.h5").output
    Path("r2.wav").write_bytes(Path("r1.wav").read_bytes())
    changed = uwtrack("rerun", "d.delays.h5", "-o", "third.h5")
    assert "r2.wav is not the file that the result file was made from" in changed.stderr
