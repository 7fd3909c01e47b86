"""Pages show what was heard and found, and no panel without anything to say."""

import re
from dataclasses import replace
from itertools import pairwise

import matplotlib.image
import numpy as np
import pytest
import soundfile
from geographiclib.geodesic import Geodesic
from typer.testing import CliRunner

from tests.support import cells_of, recording_of
from uwtrack_cli.cli.app import app
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.fringes import Fringes
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.spectra import MODULATION, Overview
from uwtrack_cli.data.truth import VesselTrack
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.files.hdf5.product import read_product
from uwtrack_cli.files.tables.json_rows import json_rows
from uwtrack_cli.flow.branches import without_asides
from uwtrack_cli.flow.products import small_containers
from uwtrack_cli.flow.rerun_sources import with_sound
from uwtrack_cli.flow.vessel_names import read_vessels, tracks_past
from uwtrack_cli.plotting.fringe_image import FringeImage, law_of
from uwtrack_cli.plotting.page import pages_of
from uwtrack_cli.plotting.panels import Outlined, lines_part
from uwtrack_cli.plotting.passage import ReportedPassage, cautions, fact_lines
from uwtrack_cli.plotting.picture import (
    FrequencyAxis,
    choose_axis,
    lofargram,
    over_floor,
    overview_levels,
    shades,
)
from uwtrack_cli.plotting.style import CONTACT_COLORS, Clock, contact_color
from uwtrack_cli.plotting.view import Scene, View, to_seconds
from uwtrack_cli.presence.segment import SoundSegment, make_presence

START = "2024-05-01T12:01:30Z"


class Held:
    """Samples that can be read again."""

    def __init__(self, samples):
        self.samples = samples

    def __call__(self, block):
        for begin in range(0, len(self.samples), block):
            yield self.samples[begin : begin + block]

    def segment(self, first, count):
        return self.samples[first : first + count]


def called(*words):
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    return done


@pytest.fixture(scope="session")
def product(timed_run):
    return timed_run


@pytest.fixture(scope="session")
def containers(product):
    with read_product(product) as opened:
        keys = without_asides(opened, list(opened.paths))
        found = [held.container for held in small_containers(opened, keys=keys)]
        return [with_sound(c, [opened]) if isinstance(c, Recording) else c for c in found]


@pytest.fixture(scope="session")
def passage(containers):
    (page,) = [p for p in pages_of(containers) if p.kind == "passage"]
    return page.draw(View())


@pytest.fixture(scope="session")
def day(containers):
    return pages_of(containers)[0].draw(View())


def test_a_page_tells_a_reading_that_is_not_the_usual_one(containers):
    changed = {
        "motion_model": np.array(["manoeuvre"]),
        "motion_model_probability": np.array([0.67]),
    }
    other = [replace(c, **changed) if isinstance(c, Encounters) else c for c in containers]
    (page,) = [p for p in pages_of(other) if p.kind == "passage"]
    texts = [text.get_text() for ax in page.draw(View()).axes for text in ax.texts]
    assert any("manoeuvre, weight 0.67" in text for text in texts)


def panels(figure):
    return [ax for ax in figure.axes if ax.get_label() != "<colorbar>"]


def labelled(figure, text):
    return [ax for ax in panels(figure) if text in ax.get_ylabel()]


def words(figure):
    found = [t.get_text() for sub in figure.subfigs for t in sub.texts]
    for sub in figure.subfigs:
        found += [t.get_text() for inner in sub.subfigs for t in inner.texts]
    return "\n".join(found + [t.get_text() for ax in figure.axes for t in ax.texts])


def curves(ax):
    return [line for line in ax.lines if len(line.get_xdata()) > 50]


def test_a_passage_says_when_how_fast_and_how_near(passage, containers):
    (found,) = [c for c in containers if isinstance(c, Encounters)]
    title = words(passage)
    knots, std = found.speed_mps[0] / 0.514444, found.speed_std_mps[0] / 0.514444
    assert "2024-05-01 12:02:28" in title
    speed = re.search(r"([\d.]+) ± ([\d.]+) kn", title)
    assert float(speed[1]) == pytest.approx(knots, abs=0.05)
    assert float(speed[2]) == pytest.approx(std, rel=0.6)
    near = re.search(r"([\d.]+) ± ([\d.]+) m\b", title)
    assert float(near[1]) == pytest.approx(found.slant_range_m[0], abs=0.6)


def test_a_passage_has_a_strip_per_line_and_no_empty_panel(passage):
    strips = [ax for ax in panels(passage) if any(" Hz" in t.get_text() for t in ax.texts)
              and ax.images]  # fmt: skip
    names = [t.get_text() for ax in strips for t in ax.texts]
    assert names == ["310.00 Hz", "189.00 Hz", "126.00 Hz", "63.00 Hz"]
    for name in ("residual", "level", "bearing", "north (m)"):
        assert len(labelled(passage, name)) == 1
    for ax in panels(passage):
        assert ax.has_data() or ax.texts


def test_the_sound_of_a_strip_lies_on_the_true_doppler_curve(passage):
    """The vessel was simulated at 6 m/s, 250.7 m off, closest 58 s after the start."""
    (strip,) = [ax for ax in panels(passage) if any(t.get_text() == "310.00 Hz" for t in ax.texts)]
    edges_s, edges_hz, level_db = cells_of(strip)
    time_s = 0.5 * (edges_s[1:] + edges_s[:-1])
    offset = 0.5 * (edges_hz[1:] + edges_hz[:-1])
    ridge = offset[np.argmax(level_db, axis=0)]
    emitted = time_s.copy()
    for _ in range(20):
        distance = np.hypot(250.7, 6.0 * (emitted - 58.0))
        emitted = time_s - distance / 1500.0
    rate = 36.0 * (emitted - 58.0) / distance
    expected = 310.0 * (1.0 / (1.0 + rate / 1500.0) - 1.0)
    inner = slice(20, -20)
    np.testing.assert_allclose(ridge[inner], expected[inner], atol=0.08)


def test_a_contact_has_one_colour_on_every_page(passage, day):
    color = contact_color(1)
    (level,) = labelled(passage, "level")
    assert curves(level)[-1].get_color() == color
    badges = [t for ax in panels(day) for t in ax.texts if t.get_text() == "1"]
    assert len(badges) == 1
    from matplotlib.colors import to_hex

    assert to_hex(badges[0].get_bbox_patch().get_facecolor()) == color


def test_a_day_shows_what_was_heard_with_its_passages_numbered(day):
    assert "1 passage" in words(day)
    assert "2024-05-01 12:02:28" in words(day)  # what was found stands above
    assert len([ax for ax in day.axes if ax.get_label() == "<colorbar>"]) == 3
    names = [ax.get_ylabel().partition("\n")[0].split(" (")[0] for ax in panels(day)]
    assert names == ["frequency", "frequency", "", "multiple of", "level 100-1000 Hz", "bearing"]
    bars = panels(day)[2]
    assert len(bars.patches) == 1
    assert [t.get_text() for t in bars.get_yticklabels()] == ["passage 1"]
    assert "UTC 2024-05-01" in panels(day)[-1].get_xlabel()
    assert all(ax.has_data() for ax in panels(day))


def test_lines_are_outlined_unless_left_out(containers, day):
    bare = pages_of(containers)[0].draw(View(has_lines=False))
    assert len(curves(panels(day)[1])) == 2 * 4  # in the part that is enlarged
    assert not any(curves(ax) for ax in panels(bare)[:1])


def test_what_a_fit_leaves_is_marked(containers):
    def drawn(misfit):
        changed = [replace(c, misfit=np.array([misfit])) if isinstance(c, Encounters)
                   else replace(c, reader=None) if isinstance(c, Recording) else c
                   for c in containers]  # fmt: skip
        pages = pages_of(changed)
        return pages[0].draw(View()), pages[1].draw(View())

    for figure in drawn(0.5):
        assert "50 % of the Doppler shift" in words(figure)
    figure = drawn(0.05)[1]
    assert "⚠" not in words(figure)


def test_without_sound_a_strip_shows_what_was_measured(containers):
    silent = [replace(c, reader=None) if isinstance(c, Recording) else c for c in containers]
    figure = pages_of(silent)[1].draw(View())
    (strip,) = [ax for ax in panels(figure) if any(t.get_text() == "63.00 Hz" for t in ax.texts)]
    lines = next(c for c in containers if isinstance(c, Lines))
    (points,) = [c for c in strip.collections if len(c.get_offsets()) > 10]
    own = min(lines.line_id, key=lambda k: abs(np.mean(lines.frequency_hz[lines.line == k]) - 63))
    measured = (lines.line == own) & np.isfinite(lines.measured_frequency_hz)
    assert len(points.get_offsets()) == measured.sum()


def test_a_table_has_a_page_of_its_measurements(uwtrack, tmp_path):
    """What was measured lies on the fit within its deviations: chi-square."""
    rng = np.random.default_rng(3)
    time_s = np.arange(0.0, 300.0, 2.0)
    lag = time_s - 150.0
    frequency = 100.0 * (1.0 - 5.0 / 1500.0 * lag / np.hypot(lag, 40.0))
    frequency += rng.normal(0.0, 0.01, time_s.size)
    rows = [f"{t},{f:.5f},0.01" for t, f in zip(time_s, frequency, strict=True)]
    table = tmp_path / "s.csv"
    table.write_text("\n".join(["time_s,frequency_hz,frequency_std_hz", *rows]))
    assert uwtrack("cpa", table, "-o", "s.h5", "-q").exit_code == 0
    with read_product(tmp_path / "s.h5") as opened:
        found = [held.container for held in small_containers(opened)]
    (page,) = pages_of(found)
    figure = page.draw(View())
    (strip,) = [ax for ax in panels(figure) if "Doppler" in ax.get_ylabel()]
    points = strip.collections[0].get_offsets()
    assert len(points) == time_s.size
    (curve,) = curves(strip)
    left = points[:, 1] - np.interp(points[:, 0], *curve.get_data())
    assert np.sum((left / 0.01) ** 2) == pytest.approx(150, abs=4 * np.sqrt(300))
    assert len(labelled(figure, "residual")) == 1


def test_a_passage_without_course_has_no_map(containers):
    blind = [replace(c, course_deg=np.array([np.nan]), side=np.array([""]))
             if isinstance(c, Encounters) else c for c in containers]  # fmt: skip
    blind = [replace(c, reader=None) if isinstance(c, Recording) else c for c in blind]
    figure = pages_of(blind)[1].draw(View())
    (ax,) = labelled(figure, "north")  # a circle of the range, and no way
    found = next(c for c in blind if isinstance(c, Encounters))
    (circle,) = [line for line in ax.lines if len(line.get_xdata()) > 100]
    radius = np.hypot(*circle.get_data())
    np.testing.assert_allclose(radius, found.horizontal_range_m[0])
    assert ax.get_title() == "direction not known"
    assert "course" not in words(figure)


def test_the_map_shows_the_track_of_ais(containers):
    time_s = np.linspace(0.0, 120.0, 13)
    track = VesselTrack(
        vessel="FERRY", time_s=time_s, first=6.0 * (time_s - 58.0),
        second=np.full(13, -250.0), speed_mps=np.full(13, 6.0),
        course_deg=np.full(13, 90.0),
    )  # fmt: skip
    silent = [replace(c, reader=None) if isinstance(c, Recording) else c for c in containers]
    (ax,) = labelled(pages_of(silent, [track])[1].draw(View()), "north")
    assert "AIS FERRY" in [t.get_text() for t in ax.texts]
    (drawn,) = [line for line in ax.lines if len(line.get_xdata()) == 13]
    np.testing.assert_allclose(drawn.get_xdata(), track.first)


def test_tracks_of_ais_are_metres_from_the_sensor(tmp_path, product):
    """Distances on the map are those of the geodesic."""
    places = [Geodesic.WGS84.Direct(35.0, 128.5, azimuth, 300.0) for azimuth in (10.0, 90.0, 200.0)]
    rows = [f"2024-05-01 12:0{2 + k}:30.000,235070762,{g['lat2']},{g['lon2']},90,10"
            for k, g in enumerate(places)]  # fmt: skip
    head = "Time,MMSI,Latitude_degrees,Longitude_degrees,COG_degrees,SOG_knots"
    table = tmp_path / "ais.csv"
    table.write_text("\n".join([head, *rows]) + "\n")
    with read_product(product) as opened:
        (recording,) = opened.read_all(Recording)
    sensor = recording.sensor
    (track,) = tracks_past(read_vessels(table), sensor, recording)
    np.testing.assert_allclose(track.time_s, [60.0, 120.0, 180.0], atol=1e-3)
    np.testing.assert_allclose(np.hypot(track.first, track.second), 300.0, atol=0.02)
    azimuth = np.degrees(np.arctan2(track.first, track.second)) % 360.0
    np.testing.assert_allclose(azimuth, [10.0, 90.0, 200.0], atol=0.01)
    with pytest.raises(DataError, match="not known"):
        tracks_past(read_vessels(table), sensor, None)


def test_the_band_of_a_fit_is_its_first_order_deviation(containers):
    """A change of one parameter by its deviation moves the curve as the band says."""
    (found,) = [c for c in containers if isinstance(c, Encounters)]
    only = np.zeros((1, 4, 4))
    only[0, 2, 2] = found.speed_std_mps[0] ** 2
    grid = np.linspace(0.0, 120.0, 50)
    fit = ReportedPassage(replace(found, covariance=only), 0)
    value, std = fit.shift(grid)
    step = float(found.speed_std_mps[0])
    faster = replace(found, slant_range_m=found.slant_range_m + step * found.range_over_speed_s)
    moved, _ = ReportedPassage(faster, 0).shift(grid)
    np.testing.assert_allclose(std, np.abs(moved - value), rtol=0.02, atol=1e-9)


def overview(level_db, frequency_hz):
    floor, ceiling = float(level_db.min()) - 1.0, float(level_db.max())
    shade = np.round((level_db - floor) / (ceiling - floor) * 255).astype(np.uint8)
    return Overview(
        time_s=np.arange(len(level_db)) + 0.5, frequency_hz=frequency_hz,
        shade=shade, floor_db=floor, ceiling_db=ceiling, reference="1 uPa", sensor="h1",
    )  # fmt: skip


def test_noise_is_calm_and_a_steady_line_stays():
    rng = np.random.default_rng(5)
    frequency = np.arange(10.0, 500.0)
    slope = -20.0 * np.log10(frequency / 10.0)
    level = slope + rng.normal(0.0, 1.5, (200, frequency.size))
    level[:, 120] += 15.0
    found = over_floor(overview_levels(overview(level, frequency)))
    others = np.delete(found, slice(117, 124), axis=1)
    assert np.abs(np.median(others, axis=0)).max() < 2.5
    assert np.median(found[:, 120]) == pytest.approx(15.5, abs=2.0)
    dark, bright = shades(found)
    assert np.mean(others > dark) < 0.32  # what exceeds half a deviation
    assert np.median(found[:, 120]) > dark + 0.6 * (bright - dark)


def test_gaps_are_no_levels():
    level = np.zeros((6, 40)) + np.arange(40)
    picture = overview(level, np.arange(40.0))
    shade = picture.shade.copy()
    shade[2] = 0
    found = over_floor(overview_levels(replace(picture, shade=shade)))
    assert np.isnan(found[2]).all()
    assert np.isfinite(found[[0, 1, 3]]).all()


def test_the_tail_of_a_recording_is_no_gap(tmp_path):
    """Frames of 8 s, every 4 s, end 3 s before the sound of 67 s does."""
    path = tmp_path / "a.wav"
    sound = 0.1 * np.random.default_rng(4).standard_normal(67_000)
    soundfile.write(path, sound, 1000)
    made = tmp_path / "a.spectrogram.h5"
    called("spectrogram", path, "--window-s", "8", "-o", made)
    called("plot", made, "-o", tmp_path / "a.png")
    pixels = np.round(255 * matplotlib.image.imread(tmp_path / "a.png")[..., :3])
    assert not (pixels == [0xD9, 0xD9, 0xD9]).all(axis=-1).sum(axis=0).max() > 50


@pytest.mark.parametrize("name", ["time_s", "frequency_hz"])
def test_an_axis_that_holds_no_numbers_is_refused(name):
    picture = overview(np.arange(12.0).reshape(4, 3), np.arange(3.0))
    broken = getattr(picture, name).copy()
    broken[1] = np.nan
    picture = replace(picture, **{name: broken})
    with pytest.raises(DataError, match=f"{name} of the overview holds values"):
        pages_of([picture])[0].draw(View())


def test_the_axis_follows_from_the_band_and_lines_are_enlarged():
    """A band beyond a factor of 20 is logarithmic; its lines have a linear part."""
    axis = choose_axis((0.0, 8000.0), View())
    assert (axis.low_hz, axis.high_hz, axis.is_log) == (10.0, 8000.0, True)
    assert not choose_axis((0.0, 8000.0), View(is_log=False)).is_log
    assert not choose_axis((0.0, 8000.0), View(band_hz=(50.0, 350.0))).is_log
    edges = FrequencyAxis(10.0, 1000.0, is_log=True, rows=2).edges_hz()
    np.testing.assert_allclose(edges, [10.0, 100.0, 1000.0])
    lines = [Outlined(np.arange(2.0), np.full(2, f), 0) for f in (40.0, 80.0, 120.0)]
    part = lines_part(lines, axis)
    assert part.low_hz < 40.0
    assert 120.0 < part.high_hz < 200.0
    assert not part.is_log
    wide = [*lines, Outlined(np.arange(2.0), np.full(2, 5000.0), 0)]
    assert lines_part(wide, axis) is None


def test_fragments_are_drawn_on_request_alone(containers):
    (lines,) = [c for c in containers if isinstance(c, Lines)]
    few = np.flatnonzero(lines.line == lines.line_id[0])[:4]
    rest = np.flatnonzero(lines.line != lines.line_id[0])
    cut = lines.take("point", np.sort(np.concatenate([few, rest])))
    changed = [cut if isinstance(c, Lines) else c for c in containers]

    def drawn(**how):
        figure = pages_of(changed)[0].draw(View(**how))
        return sum(len(line.get_xdata()) > 1 and line.get_linewidth() == 0.7
                   for ax in panels(figure)[:2] for line in ax.lines)  # fmt: skip

    assert drawn() == 2 * 3
    assert drawn(has_lines=True) == 2 * 4


def test_passages_are_numbered_by_time_whatever_their_contacts(containers):
    (found,) = [c for c in containers if isinstance(c, Encounters)]
    (lines,) = [c for c in containers if isinstance(c, Lines)]
    other = replace(found, contact=np.array([15]))
    contact = np.where(lines.line_contact == 1, 15, lines.line_contact)
    changed = [other if c is found else replace(lines, line_contact=contact)
               if c is lines else c for c in containers]  # fmt: skip
    page, passage = pages_of(changed)
    assert (passage.contact, passage.number) == (15, 1)
    figure = page.draw(View())
    badges = [t.get_text() for ax in panels(figure) for t in ax.texts if t.get_bbox_patch()]
    assert badges == ["1"]
    assert "passage 1" in words(passage.draw(View()))


@pytest.mark.parametrize(
    ("text", "expected"),
    [("30", 30.0), ("12:05", 300.0), ("11:59:59", 86_399.0), ("2024-05-01T12:00:30Z", 30.0)],
)
def test_times_are_read(text, expected):
    noon = 1_714_564_800 * 10**9
    assert to_seconds(text, Clock(noon)) == pytest.approx(expected)


@pytest.mark.parametrize("text", ["soon", "25:00", "nan", "12:61"])
def test_what_is_no_time_is_refused(text):
    with pytest.raises(OptionError, match="no time"):
        to_seconds(text, Clock(0))


def test_ticks_lie_at_whole_minutes_of_utc():
    from matplotlib.figure import Figure

    ax = Figure().subplots()
    Clock(1_714_564_800 * 10**9 + 17 * 10**9).set_axis(ax, (0.0, 300.0), 6)
    texts = [t.get_text() for t in ax.get_xticklabels()]
    assert texts == ["12:01", "12:02", "12:03", "12:04", "12:05"]
    np.testing.assert_allclose(ax.get_xticks(), [43.0, 103.0, 163.0, 223.0, 283.0])


MACHADO = {
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
                   [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
                     [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
                   [0.004733, 0.691367, 0.303900]],
}  # fmt: skip
"""What readers without one kind of cone see: Machado, Oliveira & Fernandes (2009), IEEE
Trans. Vis. Comput. Graph. 15, 1291, table 1, severity 1.0; linear RGB."""


def lab(linear):
    xyz = linear @ np.array([
        [0.4124, 0.2126, 0.0193], [0.3576, 0.7152, 0.1192], [0.1805, 0.0722, 0.9505]
    ]) / [0.9505, 1.0, 1.089]  # fmt: skip
    f = np.cbrt(np.maximum(xyz, 0.0089))
    return np.stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], 1)


@pytest.mark.parametrize("kind", MACHADO)
def test_contacts_differ_for_colour_blind_readers(kind):
    """A difference of 2.3 is just noticeable (Mahy 1994); four times that is asked."""
    from matplotlib.colors import to_rgb

    rgb = np.array([to_rgb(color) for color in CONTACT_COLORS])
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    seen = lab(np.clip(linear @ np.array(MACHADO[kind]).T, 0.0, 1.0))
    apart = np.linalg.norm(seen[:, None] - seen, axis=-1)
    assert apart[~np.eye(len(seen), dtype=bool)].min() > 4 * 2.3


@pytest.mark.slow
def test_a_document_has_every_page_and_a_passage_a_name_of_its_own(product, tmp_path):
    called("plot", product, "-o", tmp_path / "a.pdf")
    assert len(re.findall(rb"/Type /Page\b", (tmp_path / "a.pdf").read_bytes())) == 2
    done = called("plot", product, "--contact", "1", "--overwrite")
    assert "timed.contact-1.png" in done.stderr
    done = called("plot", product, "--passage", "1", "--overwrite")
    assert "timed.passage-1.png" in done.stderr
    assert product.with_name("timed.contact-1.png").read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        (["--contact", "7"], 1, "contacts with one: 1"),
        (["--passage", "7"], 1, "passages with one: 1"),
        (["--demon", "--passage", "1"], 2, "leave --passage and --contact out"),
        (["--within-m", "500"], 2, "give it with --ais"),
        (["--size", "1", "4"], 2, "--size"),
        (["--sensor", "x", "--contact", "1"], 1, "sensors with one: h1"),
        (["--from", "13:00"], 1, "nothing was recorded"),
        (["--from", "60", "--to", "50"], 2, "not after its begin"),
        (["--from", "later"], 2, "is no time"),
        (["--band-hz", "200", "100"], 2, "must be increasing"),
        (["--band-hz", "3000", "4000"], 1, "nothing of 3000 to 4000 Hz"),
        (["-o", "a.gif"], 2, "written as .png, .pdf, .svg"),
        (["-o", "-"], 2, "name it with -o"),
    ],
)
def test_what_cannot_be_drawn_is_said(uwtrack, product, options, code, said, tmp_path):
    more = [] if "-o" in options else ["-o", "a.png"]
    done = uwtrack("plot", product, *options, *more)
    assert (done.exit_code, "Traceback" in done.output) == (code, False), done.output
    assert said in " ".join(done.stderr.split())
    assert not list(tmp_path.glob("a.*"))


def test_a_lofargram_of_the_sound_fits_its_length():
    """Some 800 columns, each octave with a window that holds ten periods, lines kept."""
    rng, rate = np.random.default_rng(8), 2000.0
    time_s = np.arange(round(20 * rate)) / rate
    samples = rng.standard_normal((time_s.size, 1)) + 0.6 * np.sin(
        2 * np.pi * np.multiply.outer(time_s, [15.0, 400.0])
    ).sum(axis=1, keepdims=True)
    samples = samples.astype(np.float32)
    recording = replace(recording_of(samples, rate), reader=Held(samples))
    axis = FrequencyAxis(10.0, 1000.0, is_log=True)
    found = lofargram(recording, axis, (4.0, 20.0))
    assert 700 < found.level_db.shape[0] < 900
    assert found.edges_s[0] == 4.0
    assert found.edges_s[-1] == pytest.approx(20.0)
    edges = found.axis.edges_hz()
    middle = np.median(found.level_db, axis=0)
    for frequency in (15.0, 400.0):
        row = int(np.searchsorted(edges, frequency)) - 1
        assert middle[row] > 6.0
    near_hz = edges[1:][middle > 0.5 * middle[: edges.size // 2].max()]
    low = near_hz[near_hz < 40.0]
    assert np.ptp(low) < 4.0  # 1.5 Hz wide, where a window of 0.16 s had 9 Hz


@pytest.mark.slow
def test_short_and_empty_products_have_pages(containers):
    none = [c.take("encounter", slice(0)) if isinstance(c, Encounters) else c for c in containers]
    assert len(pages_of(none)) == 1
    (picture,) = [c for c in containers if isinstance(c, Overview)]
    lines = next(c for c in containers if isinstance(c, Lines))
    one = picture.take("row", slice(0, 1))
    for held in ([one], [lines], [one, lines], [lines.take("point", slice(1)), picture],
                 [c for c in none if not isinstance(c, Overview)]):  # fmt: skip
        figure = pages_of(held)[0].draw(View())
        assert all(ax.has_data() for ax in panels(figure))
    with pytest.raises(DataError, match="nothing to draw"):
        pages_of([c for c in containers if c.NAME == "sensor"])


@pytest.mark.parametrize("value", [np.nan, np.inf, 0.0, -1.0])
def test_numbers_that_no_run_makes_end_in_no_traceback(containers, value):
    def changed(c):
        if isinstance(c, Encounters):
            return replace(c, rest_frequency_hz=np.full(c.rest_frequency_hz.size, value))
        if isinstance(c, Overview) and np.isfinite(value):
            return replace(c, frequency_hz=np.full(c.frequency_hz.size, value))
        return replace(c, reader=None) if isinstance(c, Recording) else c

    for page in pages_of([changed(c) for c in containers]):
        assert page.draw(View()).axes


def test_a_page_draws_what_a_fit_says_of_a_part_alone(containers, monkeypatch):
    whole = ReportedPassage._law

    def part(self, time_s, width_s):
        law = whole(self, time_s, width_s)
        rows = law.rows.copy()
        rows[..., time_s > 60.0] = np.nan
        return replace(law, rows=rows)

    monkeypatch.setattr(ReportedPassage, "_law", part)
    silent = [replace(c, reader=None) if isinstance(c, Recording) else c for c in containers]
    figure = pages_of(silent)[1].draw(View())
    for name in ("residual", "level", "bearing"):
        assert np.isfinite(labelled(figure, name)[0].get_ylim()).all()


def test_a_scene_without_times_draws_nothing():
    assert Scene([]).times_s is None


def test_rates_lie_on_the_spectrum_of_their_envelope():
    """The sound's picture stays the page's; without one the envelope's is, and says so."""
    rng = np.random.default_rng(8)
    sound = overview(rng.normal(60, 1, (60, 100)), 10.0 * np.arange(1, 101))
    rates_hz = np.arange(1, 401) / 16
    spectrum = rng.normal(-40, 1, (60, rates_hz.size))
    spectrum[:, np.isin(rates_hz, (2.5, 7.5, 10.0))] = -20.0
    envelope = replace(overview(spectrum, rates_hz), reference=MODULATION)
    heard = make_presence(
        {"h1": [SoundSegment("rates", 4.0, 56.0, rates_hz=[2.5, 7.5, 10.0])]}, {}, "1 uPa"
    )
    (page,) = pages_of([sound, envelope, heard])
    figure = page.draw(View())
    (_, *_) = labelled(figure, "frequency (Hz)")
    (strip,) = labelled(figure, "modulation")
    assert len(strip.images) == 1
    assert [text.get_text() for text in strip.texts] == ["2.50", "7.50", "10.00"]
    assert strip.get_ylim() == (0.0, 12.5)
    assert {len(line.get_xdata()) for line in strip.lines} == {2}
    figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in strip.texts]
    assert not any(a.overlaps(b) for a, b in pairwise(boxes))
    (alone,) = pages_of([envelope])
    assert labelled(alone.draw(View()), "modulation rate (Hz)")
    assert not labelled(alone.draw(View()), "frequency (Hz)")


@pytest.mark.slow
@pytest.mark.parametrize("form", ["png", "svg", "pdf"])
def test_a_page_is_the_same_file_again_and_says_what_it_shows(product, tmp_path, form):
    made = []
    for name in ("a", "b"):
        path = tmp_path / f"{name}.{form}"
        called("plot", product, "--passage", "1", "-o", path)
        made.append(path.read_bytes())
    assert made[0] == made[1]
    if form != "pdf":
        assert b"2024-05-01 12:02:28" in made[0]
        assert b"Panels: Doppler shift" in made[0]


def test_one_unit_of_speed_is_on_a_page(containers):
    for units, other in (("kn", "m/s\n"), ("m/s", " kn")):
        for page in pages_of(containers):
            text = words(page.draw(View(units=units)))
            assert f" {units}" in text
            assert other not in text.replace("1500 m/s", "")


def test_a_paper_column_has_panels_that_keep_apart(containers):
    figure = pages_of(containers)[1].draw(View(width_in=3.4, height_in=5.0))
    figure.draw_without_rendering()
    assert tuple(figure.get_size_inches()) == (3.4, 5.0)
    boxes = [ax.get_tightbbox() for ax in panels(figure)]
    assert len(boxes) >= 3
    for one, other in pairwise(boxes):
        assert min(one.y1, other.y1) - max(one.y0, other.y0) < 5.0  # pixels of 100 an inch
    assert all(box.x0 > -1.0 and box.x1 < 341.0 for box in boxes)


def test_a_doubtful_passage_says_its_probability(containers):
    row = dict(json_rows(next(c for c in containers if isinstance(c, Encounters)))[0])
    row |= {"probability": 0.62, "alternative": "level-hump", "misfit": 0.3}
    assert cautions(row) == [
        "uncertain: it passes with a probability of 0.62, else level hump",
        "the lines leave the fit by 30 % of the Doppler shift beyond their noise",
    ]
    facts = dict(fact_lines(row, "kn"))
    assert facts["probability"] == "0.62 that it passes"
    assert not {"evidence", "misfit"} & set(facts)


def test_a_page_says_why_its_picture_is_coarse(containers):
    """A product away from its recording has the overview alone, to a lower band."""
    away = [replace(c, reader=None) if isinstance(c, Recording) else c for c in containers]
    reason = "drawn from the overview: pass.wav is not beside the product"
    assert reason in words(pages_of(away)[0].draw(View()))
    assert "overview" not in words(pages_of(containers)[0].draw(View()))


def test_a_comb_is_drawn_by_its_multiples():
    """Teeth of a family lie at whole numbers, whatever its fundamental."""
    rng = np.random.default_rng(9)
    frequency = np.arange(1.0, 401.0)
    level = rng.normal(60, 1, (60, 400))
    level[:, (frequency % 25) == 0] += 20.0
    heard = make_presence({"h1": [SoundSegment("vessel", 4.0, 56.0, spacing_hz=25.0)]}, {}, "1 uPa")
    heard = replace(heard, n_lines=np.array([3]))
    (page,) = pages_of([overview(level, frequency), heard])
    (panel,) = labelled(page.draw(View()), "multiple of")
    _, edges, level_db = cells_of(panel)
    rows = np.median(level_db.filled(np.nan), axis=1)
    top = 0.5 * (edges[1:] + edges[:-1])[rows > 10.0]
    assert np.abs(top / 25.0 - np.round(top / 25.0)).max() < 0.05
    assert [t.get_text() for t in panel.get_yticklabels()] == ["1", "2", "3", "4", "5", "6"]


def test_a_demon_page_marks_shaft_and_blades():
    rng = np.random.default_rng(8)
    rates_hz = np.arange(1, 401) / 16
    spectrum = rng.normal(-40, 1, (60, rates_hz.size))
    spectrum[:, np.isin(rates_hz, (2.5, 10.0))] = -20.0
    envelope = replace(overview(spectrum, rates_hz), reference=MODULATION)
    segment = SoundSegment("rates", 4.0, 56.0, spacing_hz=2.5, blade_rate_hz=10.0,
                      rates_hz=[2.5, 10.0])  # fmt: skip
    heard = make_presence({"h1": [segment]}, {}, "1 uPa")
    (page,) = pages_of([envelope, heard], is_demon=True)
    figure = page.draw(View())
    assert "shaft 2.50 Hz (150 rpm), blades 10.00 Hz (4 to a shaft)" in words(figure)
    ax = figure.axes[0]
    (curve,) = curves(ax)
    peaks = curve.get_xdata()[curve.get_ydata() > 10.0]
    np.testing.assert_allclose(peaks, [2.5, 10.0])
    marks = {t.get_text(): t.get_position()[0] for t in ax.texts}
    assert marks == {"shaft": 2.5, "blades": 10.0}


def test_fringes_are_drawn_where_they_move_as_the_passage_says():
    """A mirror's pattern depends on frequency over range alone; noise has none."""
    rng = np.random.default_rng(4)
    time_s, frequency = np.arange(0.0, 300.0, 2.0), np.geomspace(200.0, 3000.0, 250)
    far = np.hypot(1.0, (time_s - 150.0) / 60.0)
    bands = 4.0 * np.cos(2.0 * np.pi * np.multiply.outer(1.0 / far, frequency) / 400.0)
    noise = rng.normal(0.0, 3.0, bands.shape)

    def image(height_db):
        shade = np.round(128 + height_db / 0.25).clip(1, 255).astype(np.uint8)
        flat = np.zeros(time_s.size, np.float32)
        held = Fringes(
            time_s=time_s, frequency_hz=frequency, shade=shade, level_db=flat,
            slope_db=flat, average_s=2.0, bin_hz=1.0, reference="full scale", sensor="h1",
        )  # fmt: skip
        return FringeImage.of(held, (0.0, 300.0))

    law = law_of(150.0, 60.0, 0.004)
    assert image(bands + noise).moves_as(law)
    assert not image(noise).moves_as(law)
    assert not image(bands[75] + noise).moves_as(law)  # it stays
    assert not image(bands + noise).moves_as(law_of(30.0, 60.0, 0.004))
