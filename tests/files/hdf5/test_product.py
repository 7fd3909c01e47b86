"""Laws of the codec: write then read is identity, blocks do not matter."""

import time
from dataclasses import replace

import h5py
import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from tests.files.synthetic_containers import synthetic
from uwtrack_cli.data.encounters import Encounters
from uwtrack_cli.data.frames import Frames
from uwtrack_cli.data.lines import Lines
from uwtrack_cli.data.peaks import Families, Peaks
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.data.sensor import Navigation, Sensor
from uwtrack_cli.data.series import Series
from uwtrack_cli.data.spectra import Levels, Spectrogram
from uwtrack_cli.errors import DataError
from uwtrack_cli.files.hdf5.checksum import LINE_BYTES
from uwtrack_cli.files.hdf5.layout import (
    CONTAINERS,
    part_classes,
    safe_name,
    scalar_types,
    scale_name,
)
from uwtrack_cli.files.hdf5.product import (
    HistoryStep,
    ProductWriter,
    Source,
    read_product,
    read_product_bytes,
    verify_product,
    write_product,
)

KINDS = pytest.mark.parametrize("kind", CONTAINERS.values(), ids=list(CONTAINERS))


def round_trip(container, path):
    write_product(path, [container], overwrite=True)
    with read_product(path) as product:
        return product.read(type(container))


@KINDS
@pytest.mark.parametrize("n_rows", [0, 4])
def test_container_reads_back_as_it_was_written(kind, n_rows, tmp_path):
    container = synthetic(kind, n_rows)
    assert round_trip(container, tmp_path / "p.h5").equals(container)


@KINDS
def test_absent_columns_scalars_and_parts_read_back_as_none(kind, tmp_path):
    whole = synthetic(kind, 3, with_optional=False)
    absent = {
        name: None
        for name, f in kind.scalars().items()
        if "None" in str(f.type) and name not in {"id", "sensor"}
    }
    if kind in {Families, Sensor}:
        absent |= dict.fromkeys(part_classes(kind))
    container = replace(whole, **absent)
    assert round_trip(container, tmp_path / "p.h5").equals(container)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "n_rows"),
    [(kind, 3) for kind in CONTAINERS.values()]
    + [(kind, 0) for kind in (Peaks, Families, Lines, Encounters)],
    ids=lambda value: getattr(value, "NAME", value),
)
def test_xarray_opens_every_group_with_named_axes_and_units(kind, n_rows, tmp_path):
    path = tmp_path / "p.h5"
    container = synthetic(kind, n_rows)
    write_product(path, [container], history=[HistoryStep.now("made", {})])
    groups = ["/"]
    with h5py.File(path) as file:
        file.visititems(lambda name, item: groups.append(name) if hasattr(item, "keys") else None)
    own = f"{safe_name('h1')}/{kind.NAME}" if f"h1/{kind.NAME}" in groups else kind.NAME
    assert own in groups
    for group in groups:
        with xr.open_dataset(path, group=group, engine="h5netcdf") as dataset:
            dataset.load()
            for name, variable in dataset.variables.items():
                assert variable.attrs["units"], name
                assert variable.attrs["long_name"], name
                assert not any("phony" in str(dim) for dim in variable.dims)
            for name, spec in kind.columns().items() if group == own else ():
                axes = tuple(scale_name(kind, axis) for axis in spec.axes)
                assert dataset[name].dims == axes
                if spec.dtype.kind != "U":
                    values = getattr(container, name)
                    np.testing.assert_array_equal(dataset[name], values)


@KINDS
def test_every_array_has_a_checksum_and_a_scale_for_every_axis(kind, tmp_path):
    path = tmp_path / "p.h5"
    write_product(path, [synthetic(kind, 2)])
    found = []
    with h5py.File(path) as file:

        def check(name, item):
            if isinstance(item, h5py.Dataset):
                found.append(name)
                assert item.fletcher32, name
                assert item.is_scale or all(len(dim) == 1 for dim in item.dims), name

        file.visititems(check)
    assert len(found) >= len(kind.columns())


@KINDS
def test_axis_never_has_the_name_of_a_column(kind):
    axes = {axis for spec in kind.columns().values() for axis in spec.axes}
    names = {scale_name(kind, axis) for axis in axes}
    assert len(names) == len(axes)
    assert not names & {*kind.columns(), *kind.parts()}
    assert not {"container", "absent"} & {*scalar_types(kind), *kind.parts()}


TEXT = st.text(st.characters(exclude_categories=("Cs",), exclude_characters="\0"), max_size=6)


@pytest.mark.slow
@settings(
    max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data(), n_rows=st.integers(0, 5))
def test_any_values_survive_writing_and_reading(data, n_rows, tmp_path):
    floats = hnp.arrays(np.float64, n_rows)
    series = Series(
        contact=data.draw(hnp.arrays(np.int64, n_rows)),
        time_s=data.draw(floats),
        bearing_deg=data.draw(floats),
        bearing_std_deg=data.draw(floats),
        frequency_hz=data.draw(hnp.arrays(np.float64, (n_rows, 2))),
        frequency_std_hz=data.draw(hnp.arrays(np.float64, (n_rows, 2))),
        level_db=data.draw(floats),
        level_std_db=data.draw(floats),
        start_utc_ns=data.draw(st.none() | st.integers(-(2**63), 2**63 - 1)),
    )
    text = [data.draw(TEXT) for _ in range(n_rows)]
    row = synthetic(Encounters, n_rows)
    texts = replace(row, sensor=np.array(text, dtype=np.str_), reference=data.draw(TEXT))
    sensor = Sensor(
        id=data.draw(TEXT),
        latitude=data.draw(st.none() | st.floats()),
        depth_m=data.draw(st.none() | st.floats()),
    )
    path = tmp_path / "p.h5"
    write_product(path, [series, texts, sensor], overwrite=True)
    with read_product(path) as product:
        assert product.read(Series).equals(series)
        assert product.read(Encounters).equals(texts)
        assert product.read(Sensor).equals(sensor)
        assert product.read(Sensor, sensor.id).equals(sensor)


@pytest.mark.parametrize(
    "sensor",
    ["a/b", "..", ".", "", "lines", "history", "step", "steps", "h 1", "%", "Ærø/海", "a\nb"],
)
def test_any_sensor_id_is_a_group_of_its_own(sensor, tmp_path):
    levels = synthetic(Levels, 3, sensor=sensor)
    other = synthetic(Levels, 3, sensor="h2", seed=2)
    write_product(tmp_path / "p.h5", [levels, other, synthetic(Encounters, 2)])
    with read_product(tmp_path / "p.h5") as product:
        assert product.read(Levels, sensor).equals(levels)
        assert product.containers() == {
            None: ["encounters"],
            sensor: ["frames", "levels"],
            "h2": ["frames", "levels"],
        }
        assert [c.frames.sensor for c in product.read_all(Levels)] == sorted([sensor, "h2"])
        with pytest.raises(DataError, match="several sensors"):
            product.read(Levels)


def test_recording_reads_back_its_facts_without_its_reader(tmp_path):
    recording = Recording(
        sensor=Sensor(id="h1", navigation=synthetic(Navigation, 3)),
        name="pass.wav",
        sample_rate_hz=4000.0,
        n_samples=10,
        n_channels=1,
        start_utc_ns=2**62,
        digest="0" * 64,
        reader=lambda _: iter(()),
    )
    back = round_trip(recording, tmp_path / "p.h5")
    assert back.reader is None
    assert back.equals(replace(recording, reader=None))


def chain(n_frames=60, n_peaks=300, seed=3):
    """A spectrogram, levels, peaks and families over one time base."""
    rng = np.random.default_rng(seed)
    known = synthetic(Frames, n_frames, first_frame=7)
    known = replace(known, threshold_db=np.ones(n_frames, np.float32))
    noise = np.full_like(known.noise_db, np.nan)
    unknown = replace(known, noise_db=noise, threshold_db=known.threshold_db * np.nan)
    frame = np.sort(rng.integers(7, 7 + n_frames, n_peaks))
    peaks = synthetic(Peaks, n_peaks, frames=known, frame=frame)
    n_births = synthetic(Families, n_peaks).family.size
    births = np.sort(rng.integers(7, 7 + n_frames, n_births))
    frequency = np.arange(5.0)
    density = rng.random((n_frames, 5))
    return {
        Spectrogram: Spectrogram(
            frames=unknown, frequency_hz=frequency, power_density=density, reference="x"
        ),
        Levels: synthetic(Levels, n_frames, frames=unknown),
        Peaks: peaks,
        Families: synthetic(
            Families, n_peaks, peaks=peaks, frame=births, peak_family=np.zeros(n_peaks, np.int64)
        ),
    }


def test_frames_are_stored_once_and_the_noise_found_later_is_kept(tmp_path):
    made = chain()
    path = tmp_path / "p.h5"
    write_product(path, list(made.values()))
    known = made[Peaks].frames
    with read_product(path) as product:
        assert product.read(Frames).equals(known)
        for kind in (Spectrogram, Levels):
            expected = replace(made[kind], frames=known)
            assert product.read(kind).equals(expected)
        assert product.read(Families).equals(made[Families])
        names = []
        product.file.visit(names.append)
        assert sum(name.endswith("/frames") for name in names) == 1
        assert sum(name.endswith("/peaks") for name in names) == 1
    assert verify_product(path) == []


def test_part_that_differs_stays_with_its_owner(tmp_path):
    made = chain()
    shifted = replace(made[Peaks].frames, time_s=made[Peaks].frames.time_s + 1.0)
    levels = replace(made[Levels], frames=shifted)
    write_product(tmp_path / "p.h5", [made[Peaks], levels])
    with read_product(tmp_path / "p.h5") as product:
        assert product.read(Peaks).equals(made[Peaks])
        assert product.read(Levels).equals(levels)
        assert product.containers() == {"h1": ["frames", "levels", "peaks"]}


@pytest.mark.parametrize("kind", [Spectrogram, Levels, Peaks, Families])
@pytest.mark.parametrize("block_rows", [1, 59, 1000])
def test_blocks_joined_are_the_whole(kind, block_rows, tmp_path):
    made = chain()[kind]
    write_product(tmp_path / "p.h5", [made])
    with read_product(tmp_path / "p.h5") as product:
        blocks = list(product.stream(kind, None, block_rows))
        whole = product.read(kind)
    assert kind.join(blocks).equals(whole)
    assert whole.equals(made)
    first = 7
    for block in blocks:
        frames = block.peaks.frames if kind is Families else block.frames
        assert frames.first_frame == first
        first += frames.n_frames
        if kind is Peaks:
            assert set(block.frame) <= set(range(frames.first_frame, first))
    with ProductWriter(tmp_path / "q.h5") as writer:
        for block in blocks:
            writer.append(block)
    with read_product(tmp_path / "q.h5") as product:
        assert product.read(kind).equals(made)


def test_stored_blocks_are_what_join_makes_of_them(tmp_path):
    lines = synthetic(Lines, 6)
    nothing = slice(0, 0)
    blocks = [
        replace(lines.take("line", nothing), frames=replace(lines.frames, first_frame=2)),
        replace(lines, reference="y"),
        lines.take("frame", nothing).take("point", nothing).take("line", nothing),
    ]
    with ProductWriter(tmp_path / "p.h5") as writer:
        for block in blocks:
            writer.append(block)
    with read_product(tmp_path / "p.h5") as product:
        assert product.read(Lines).equals(Lines.join(blocks))


def test_large_stream_is_written_in_steps_without_a_changed_bit(tmp_path, monkeypatch):
    monkeypatch.setattr("uwtrack_cli.files.hdf5.appendable_group.PENDING_BYTES", 1000)
    peaks = chain()[Peaks]
    with ProductWriter(tmp_path / "p.h5") as writer:
        for start in range(7, 67, 4):
            rows = (peaks.frame >= start) & (peaks.frame < start + 4)
            part = peaks.frames.take("frame", slice(start - 7, start - 3))
            writer.append(
                replace(peaks.take("peak", rows), frames=replace(part, first_frame=start))
            )
    with read_product(tmp_path / "p.h5") as product:
        assert product.read(Peaks).equals(peaks)
    assert verify_product(tmp_path / "p.h5") == []


def test_blocks_that_do_not_fit_together_are_refused(tmp_path):
    made = chain()[Spectrogram]
    wider = replace(made, frequency_hz=np.arange(6.0), power_density=np.zeros((60, 6), np.float32))

    def write():
        with ProductWriter(tmp_path / "p.h5") as writer:
            writer.append(made)
            writer.append(wider)

    with pytest.raises(DataError, match="shape"):
        write()
    assert list(tmp_path.iterdir()) == []


def test_two_containers_of_one_sensor_and_kind_are_refused(tmp_path):
    levels = chain()[Levels]
    with pytest.raises(DataError, match="one container 'levels' of sensor 'h1'"):
        write_product(tmp_path / "p.h5", [levels, levels])
    assert list(tmp_path.iterdir()) == []


def test_peaks_out_of_the_order_of_frames_cannot_be_streamed(tmp_path):
    peaks = chain()[Peaks]
    write_product(tmp_path / "p.h5", [replace(peaks, frame=peaks.frame[::-1])])
    with (
        read_product(tmp_path / "p.h5") as product,
        pytest.raises(DataError, match="order of the frames"),
    ):
        list(product.stream(Peaks, None, 10))


def test_product_in_memory_is_the_product_in_a_file(tmp_path):
    made = list(chain().values())
    steps = [HistoryStep.now("peaks", {"x": 1.5})]
    write_product(tmp_path / "p.h5", made, history=steps)
    content = (tmp_path / "p.h5").read_bytes()
    with read_product_bytes(content) as memory, read_product(tmp_path / "p.h5") as file:
        assert memory.history == file.history == steps
        assert memory.digest == file.digest
        assert memory.read(Families).equals(file.read(Families))


def test_history_carries_options_versions_and_digests(tmp_path):
    source = Source(name="pass.wav", digest="ab" * 32)
    step = HistoryStep.now("levels", {"band_hz": [20.0, np.float64(1500)]}, [source])
    write_product(tmp_path / "p.h5", [synthetic(Levels, 2)], history=[step, step])
    with read_product(tmp_path / "p.h5") as product:
        first, second = product.history
    assert first == second
    assert first.options == {"band_hz": [20.0, 1500.0]}
    assert first.sources == (source,)
    assert {"uwtrack", "python", "numpy", "h5py"} <= set(first.versions)


def test_same_contents_are_the_same_bytes_whenever_they_are_written(tmp_path):
    made = [*chain().values(), synthetic(Encounters, 2)]
    other = [*made[:-1], replace(made[-1], reference="y")]
    digests, contents = [], []
    for i, containers in enumerate((made, made, other)):
        write_product(tmp_path / f"{i}.h5", containers)
        contents.append((tmp_path / f"{i}.h5").read_bytes())
        with read_product(tmp_path / f"{i}.h5") as product:
            digests.append(product.digest)
        time.sleep(1.1 if i == 0 else 0.0)
    assert contents[0] != contents[1]
    assert contents[0][:-LINE_BYTES] == contents[1][:-LINE_BYTES]
    assert digests[0] == digests[1] != digests[2]
