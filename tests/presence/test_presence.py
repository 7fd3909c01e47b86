"""What was heard: each kind from drawn sound whose truth is known."""

import json
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tests.flow.made_encounters import encounters_of
from tests.support import DIFAR, OMNI, recording_of, white_noise
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.presence import KINDS, Presence
from uwtrack_cli.data.spectra import Levels
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.hdf5.product import read_product
from uwtrack_cli.flow.engine import run_recipe
from uwtrack_cli.flow.shipped_recipes import load_recipe
from uwtrack_cli.flow.suggestions import suggestions
from uwtrack_cli.presence.level_humps import level_humps
from uwtrack_cli.presence.presence import find_presence, rate_families
from uwtrack_cli.presence.segment import MISSING, SoundSegment, make_presence
from uwtrack_cli.presence.tonal_segments import chance_together
from uwtrack_cli.spectra.levels import measure_levels
from uwtrack_cli.spectra.spectrogram import compute_spectrogram

RATE_HZ = 4000.0
STEADY_S = 120.0


def heard(sound, sensor=OMNI):
    """Presence and encounters of a sound by the recipe that asks for it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # an omni sensor gives no position
        made = run_recipe(recording_of(sound, RATE_HZ, sensor), load_recipe("presence"))
    (presence,) = [c for c in made if isinstance(c, Presence)]
    (encounters,) = [c for c in made if isinstance(c, Encounters)]
    return presence, encounters


def clock(duration_s=STEADY_S):
    return np.arange(round(duration_s * RATE_HZ)) / RATE_HZ


def comb(spacing_hz, teeth, snr_db, time):
    """Tones over white noise of unit density; the ratio is that in 1 Hz."""
    size = np.sqrt(2.0 * 10 ** (snr_db / 10))
    return size * sum(np.cos(2 * np.pi * (k * spacing_hz * time + 0.37 * k * k)) for k in teeth)


def kinds(presence):
    return sorted(presence.kind.tolist())


def row_of(presence, kind):
    (row,) = np.flatnonzero(presence.kind == kind)
    return int(row)


@pytest.fixture(scope="session")
def steady_ship():
    """A ship of 6.25 Hz with blades of 2.5 Hz shaft rate, under way far off."""
    time = clock()
    hiss = white_noise(time.size, 3)
    blades = 1.0 + 0.5 * np.cos(2 * np.pi * 12.5 * time)
    blades += 0.3 * np.cos(2 * np.pi * 6.25 * time + 1.0)
    sound = white_noise(time.size, 2) + hiss * blades
    return heard(sound + comb(6.25, (3, 4, 6, 8, 10, 12, 20), 20.0, time))


def test_a_ship_that_does_not_pass_is_told_with_its_spacing(steady_ship):
    presence, encounters = steady_ship
    assert encounters.n_encounters == 0
    row = row_of(presence, "vessel")
    assert presence.spacing_hz[row] == pytest.approx(6.25, abs=0.01)
    off = presence.spacing_hz[row] - 6.25
    assert abs(off) < 4 * presence.spacing_std_hz[row]
    found = presence.frequency_hz[presence.owned_rows("frequency_segment", row)]
    for tooth in (3, 4, 6, 8, 10, 12, 20):
        assert np.abs(found - 6.25 * tooth).min() < 0.1
    assert presence.probability_of_chance[row] < 1e-3
    assert "no closest approach" in presence.reasons(row)["encounter"]


def test_auto_names_a_shaft_of_thirty_six_turns_a_minute():
    """Twenty teeth 0.6 Hz apart, each 10 dB over the noise in 1 Hz, in white noise."""
    rate_hz, seconds = 500.0, 150
    time_s = np.arange(round(seconds * rate_hz)) / rate_hz
    phase = np.random.default_rng(61).uniform(0.0, 2.0 * np.pi, 20)
    noise = white_noise(time_s.size, 62, rate_hz=rate_hz)
    power = 10.0 * 2.0 * np.var(noise) / rate_hz  # of a tone, ten times that in 1 Hz
    teeth_hz = 0.6 * np.arange(12, 32)
    tones = np.sin(2.0 * np.pi * np.outer(teeth_hz, time_s) + phase[:, None])
    sound = noise + np.sqrt(2.0 * power) * tones.sum(axis=0)
    recording = recording_of(sound.astype(np.float32)[:, None], rate_hz)
    made = run_recipe(recording, load_recipe("auto"))
    (found,) = [one for one in made if isinstance(one, Presence)]
    vessels = np.flatnonzero(found.kind == "vessel")
    assert found.spacing_hz[vessels] == pytest.approx([0.6], abs=0.005)


def test_rates_of_the_same_shaft_join_the_lines_to_one_contact(steady_ship):
    presence, _ = steady_ship
    assert "rates" not in presence.kind
    row = row_of(presence, "vessel")
    rates = presence.rate_hz[presence.owned_rows("rate_segment", row)]
    assert np.abs(rates - 12.5).min() < 0.05


def test_hum_is_hum_and_noise_is_nothing_of_a_vessel():
    time = clock()
    noise = white_noise(time.size, 5)
    exact_hz = 60.0 * (1 + 2e-5)  # odd harmonics are a family of 120 Hz, and mains
    presence, _ = heard(noise + comb(exact_hz, (1, 3, 5, 7, 9, 11), 25.0, time))
    row = row_of(presence, "hum")
    assert presence.n_lines[row] >= 6
    off = presence.spacing_hz[row] - exact_hz
    assert abs(off) < 4 * presence.spacing_std_hz[row] < 0.1
    assert not {"vessel", "rates", "lines", "broadband"} & set(presence.kind)
    quiet, _ = heard(noise)
    assert not {"vessel", "rates", "lines", "broadband"} & set(quiet.kind)


def test_swell_is_no_rate():
    time = clock(240.0)
    level_db = 6.0 * np.sin(2 * np.pi * 0.3 * time)
    presence, _ = heard(white_noise(time.size, 6) * 10 ** (level_db / 20))
    assert "rates" not in presence.kind
    slow = [i for i in range(presence.from_s.size) if presence.reasons(i).get(
        "encounter", "").startswith("slower than 0.5 Hz")]  # fmt: skip
    assert slow
    assert set(presence.kind[slow]) == {"unknown"}


def test_mains_in_the_envelope_are_hum():
    time = clock()
    tremble = np.sqrt(1.0 + 0.6 * np.cos(2 * np.pi * 50.0 * time))
    sound = white_noise(time.size, 7) * tremble
    recipe = load_recipe("presence").with_settings(["demon.rate_hz=[0.2, 60.0]"])
    made = run_recipe(recording_of(sound, RATE_HZ), recipe)
    (presence,) = [c for c in made if isinstance(c, Presence)]
    row = row_of(presence, "hum")
    rates = presence.rate_hz[presence.owned_rows("rate_segment", row)]
    assert rates == pytest.approx([50.0], abs=0.1)


def levels_of(sound):
    """The broadband level."""
    blocks = compute_spectrogram(recording_of(sound, RATE_HZ))
    return Levels.join(list(measure_levels(blocks)))


def humps(sound):
    """What the broadband level alone tells."""
    return level_humps(levels_of(sound))


def test_rain_is_rain_and_a_passing_hump_is_broadband():
    time = clock(480.0)
    share = np.sin(np.pi * np.clip((time - 150) / 180, 0, 1)) ** 2
    spectrum = np.fft.rfft(white_noise(time.size, 9))
    frequency = np.fft.rfftfreq(time.size, 1 / RATE_HZ)
    rain = np.fft.irfft(spectrum * np.minimum(frequency / 500, 1) ** 2, time.size)
    quiet = white_noise(time.size, 10)
    levels = levels_of(quiet + 4 * np.sqrt(share) * rain)
    (wet,) = level_humps(levels)
    assert wet.kind == "rain"
    (low,) = level_humps(replace(levels, band_low_hz=2.0, band_high_hz=50.0))
    assert low.kind in {"unknown", "broadband"}  # nobody hears rain in infrasound
    assert 150 < wet.from_s < wet.to_s < 330
    (passed,) = humps(quiet * np.sqrt(1 + 10 / (1 + ((time - 240) / 20) ** 2)))
    assert passed.kind == "broadband"
    assert passed.from_s < 240 < passed.to_s
    (flat,) = humps(quiet * np.where(np.abs(time - 240) < 40, 3.0, 1.0))
    assert flat.kind == "unknown"
    assert humps(quiet) == []


def test_a_passage_is_a_vessel_with_its_contact(pass_run):
    with read_product(pass_run) as product:
        presence = product.read(Presence)
    row = int(np.flatnonzero(presence.encounter > 0)[0])
    assert presence.kind[row] == "vessel"
    assert presence.encounter[row] == 1
    assert "encounter" not in presence.reasons(row)
    assert presence.from_s[row] < 148.0 < presence.to_s[row]


def test_what_cpa_refuses_is_in_presence_with_its_reason():
    empty = make_presence({}, {}, "full scale")
    assert empty.from_s.size == 0
    time = clock(200.0)
    bent = 300.0 * time + 0.02 * np.cumsum(np.tanh((time - 100) / 2)) / RATE_HZ
    sound = white_noise(time.size, 4)
    sound = sound + np.sqrt(2e3) * np.cos(2 * np.pi * bent)
    presence, encounters = heard(sound)
    told = {
        reason
        for row in range(presence.from_s.size)
        for key, reason in presence.reasons(row).items()
        if key == "encounter"
    }
    assert all(reason in told for *_, reason in encounters.refusals())


def test_every_missing_value_has_its_reason():
    rows = [SoundSegment("unknown", 1.0, 2.0, reason="a test")]
    presence = make_presence({"h1": rows}, {"h1": None}, "full scale")
    assert set(presence.reasons(0)) == {
        "encounter",
        "motion_model",
        "motion_model_probability",
        *(MISSING.keys() - {"motion_model_probability"}),
    }


def test_there_must_be_something_to_work_on():
    with pytest.raises(DataError, match="run 'uwtrack track'"):
        find_presence()


def test_rates_at_random_are_seldom_a_family():
    rng = np.random.default_rng(1)
    found = sum(
        len(
            rate_families(rng.uniform(0.5, 50, 4), np.full(4, 0.01), np.zeros(4), np.full(4, 0.125))
        )
        for _ in range(400)
    )
    assert found <= 0.1 * 400 * 1.5  # the expected number per look is 0.1


def test_shaft_and_blades_are_one_family_with_the_right_shaft():
    rng = np.random.default_rng(2)
    for shaft in (0.9, 2.4, 6.3):
        true = shaft * np.array([1, 4, 8])
        rates = true + 0.004 * rng.standard_normal(3)
        (one,) = rate_families(rates, np.full(3, 0.004), np.array([0.0, 9, 4]), np.full(3, 0.125))
        assert abs(one.shaft_hz - shaft) < 4 * one.shaft_std_hz
        assert one.blade_hz == pytest.approx(4 * shaft, rel=1e-2)


@pytest.fixture
def ran(uwtrack, samples):
    done = uwtrack("run", samples / "propeller.wav", "--recipe", "presence", "-o", "p.run.h5")
    assert done.exit_code == 0, done.output
    return done


def test_what_was_not_looked_for_is_named_where_no_vessel_was_found(uwtrack, samples):
    """Its only marks are blades in the envelope, which `vessel` and `auto` do not read."""
    source = samples / "propeller.wav"
    done = uwtrack("run", source, "--recipe", "vessel", "-o", "v.run.h5")
    words = (
        "no vessel was found shaft and blades in the envelope of the broadband were not "
        "searched: uwtrack run {} --recipe presence"
    )
    assert words.format(source) in " ".join(done.stderr.split())
    # whoever has the product alone is told the same
    for command in ("show v.run.h5", "show v.run.h5 presence"):
        shown = uwtrack(*command.split())
        assert words.format(source.name) in " ".join(shown.stderr.split())
    assert uwtrack("report", "v.run.h5").exit_code == 0
    page = Path("v.html").read_text(encoding="utf-8")
    assert words.format(source.name).replace("found ", "found; ") in page
    # it is not named where it would be refused, nor where it was looked for
    recording = recording_of(np.zeros(round(60 * RATE_HZ)), RATE_HZ)
    slow = replace(recording, sample_rate_hz=50.0)
    done = {"zoom", "trace"}
    envelope = "--recipe presence"
    assert envelope in suggestions(done, [("slow", slow), ("x.wav", recording)])[0]
    assert not any(envelope in text for text in suggestions(done, [("slow", slow)]))
    looked = suggestions(done | {"demon"}, [("x.wav", recording)])
    assert not any(envelope in text for text in looked)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("--recipe vessel", "--recipe auto"),
        ("--recipe auto", "--recipe multi-resolution"),
        ("", "--sound-speed-mps 343"),
    ],
)
def test_every_place_that_finds_nobody_names_what_to_try(uwtrack, words, named):
    """Noise without a sensor file: other frames, weaker lines, another medium."""
    noise = np.random.default_rng(31).normal(size=round(20 * RATE_HZ))
    soundfile.write("noise.wav", noise / 30, int(RATE_HZ))
    done = uwtrack("run", "noise.wav", *words.split(), "-o", "n.run.h5")
    live = uwtrack(
        "run", "-", *words.split(), "-o", "l.run.h5", input=Path("noise.wav").read_bytes()
    )
    shown = uwtrack("show", "n.run.h5")
    assert uwtrack("report", "n.run.h5").exit_code == 0
    for text in (done.stderr, live.stderr, shown.stderr, Path("n.html").read_text()):
        flat = " ".join(text.split())
        assert "uwtrack run" in flat
        assert named in flat


@pytest.mark.slow
def test_a_vessel_without_lines_is_told_by_its_blades(uwtrack, ran):
    said = " ".join(ran.stderr.split())
    assert "no closest approach; shaft and blades of a vessel are detected" in said
    assert "no vessel was found" not in said
    shown = uwtrack("show", "p.run.h5", "presence", "--format", "json")
    (row,) = [r for r in json.loads(shown.stdout) if r["kind"] == "rates"]
    assert row["spacing_hz"] == pytest.approx(2.4, abs=0.02)
    assert row["blade_rate_hz"] == pytest.approx(9.6, abs=0.08)
    assert row["from_utc"] is None
    assert set(row["reasons"]) >= {"encounter", "from_utc", "level_db"}
    # lines that only presence reads do not hide those of the sound
    for words in ("show p.run.h5 lines", "report p.run.h5", "presence p.run.h5 -o q.h5"):
        assert uwtrack(*words.split()).exit_code == 0
    table = uwtrack("show", "p.run.h5", "presence")
    head, *rows = table.stdout.splitlines()
    assert "blade Hz" in head
    assert "rates Hz" in head
    assert "2.4 9.6 19.2" in rows[0]
    envelope = uwtrack("show", "p.run.h5", "overview", "--step", "rates-overview")
    assert envelope.exit_code == 0
    assert uwtrack("show", "p.run.h5", "overview").stdout != envelope.stdout
    assert len(rows) == len(json.loads(shown.stdout))
    assert max(map(len, (head, *rows))) <= 80
    assert f"rates from {row['from_s']:.0f} s: {row['reasons']['encounter']}" in table.stderr
    chosen = uwtrack("show", "p.run.h5", "lines", "--step", "rates", "--format", "json")
    assert json.loads(chosen.stdout)["reference"] == "modulation"


def test_the_commands_one_by_one_tell_the_same(uwtrack, samples):
    for words in (
        ("demon", samples / "propeller.wav", "-o", "p.demon.h5"),
        ("trace", "p.demon.h5", "--false-lines-per-khz-hour", 0.16, "-o", "r.h5"),
        ("presence", "r.h5", "-o", "p.presence.h5"),
    ):
        done = uwtrack(*words)
        assert done.exit_code == 0, done.output
    shown = uwtrack("show", "p.presence.h5", "--format", "json")
    (row,) = json.loads(shown.stdout)
    assert row["kind"] == "rates"
    assert uwtrack("plot", "p.presence.h5", "-o", "p.png").exit_code == 0


def test_the_kinds_are_those_of_the_schema(uwtrack):
    schema = json.loads(uwtrack("show", "--schema", "presence").stdout)
    assert schema["items"]["properties"]["kind"]["enum"] == list(KINDS)


@pytest.mark.slow
def test_a_vector_sensor_gives_the_bearing_of_the_blades():
    time = clock(180.0)
    bearing = np.radians(70.0)
    blades = 1 + 0.6 * np.cos(2 * np.pi * 9.6 * time) + 0.3 * np.cos(2 * np.pi * 2.4 * time)
    vessel = white_noise(time.size, 11) * blades
    noise = white_noise(3 * time.size, 12).reshape(-1, 3) * [1, 0.577, 0.577]
    gains = np.array([1, np.sin(bearing), np.cos(bearing)])
    presence, _ = heard(noise + vessel[:, None] * gains, DIFAR)
    rows = np.flatnonzero(
        [presence.owned_rows("rate_segment", i).size > 1 for i in range(presence.from_s.size)]
    )
    assert rows.size
    assert presence.bearing_deg[rows[0]] == pytest.approx(70.0, abs=6.0)


def test_few_of_many_lines_are_joined_by_chance():
    """Drawn: evidence of pairs is a likelihood ratio, and joins k - 1 of them."""
    rng = np.random.default_rng(12)
    n_lines, n_runs = 8, 20_000
    shift = np.sqrt(2 * 3.0)  # a likelihood ratio that reaches e^3 most often
    ratio = shift * rng.normal(size=(n_runs, n_lines, n_lines)) - shift**2 / 2
    joined = np.triu(ratio > 3.0, 1)
    triples = sum(
        (joined[:, a, b] & joined[:, b, c]).mean()
        for a in range(n_lines) for b in range(a + 1, n_lines)
        for c in range(b + 1, n_lines)
    )  # fmt: skip
    assert 0.0 < triples <= chance_together(3, n_lines)
    assert chance_together(3, 46) == 1.0
    assert chance_together(6, 6) < 1e-3


def test_a_segment_lies_within_the_sound():
    """A passage near the end would be heard for longer than there is sound."""
    levels = levels_of(white_noise(clock(240.0).size, 10))
    passed = {"time_s": 200.0, "arrival_time_s": 200.0, "range_over_speed_s": 40.0,
              "sound_speed_mps": 1500.0}  # fmt: skip
    presence = find_presence(levels=[levels], encounters=[encounters_of(passed)])
    assert presence.kind.tolist() == ["vessel"]
    assert presence.from_s.tolist() == [120.0]
    assert presence.to_s.tolist() == [240.0]
