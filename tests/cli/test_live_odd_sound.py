"""Live sound with silence, gaps, clipping and changes of level gives the file's product."""

import io

import numpy as np
import pytest
import soundfile

from tests.draws.brief_passages import in_memory
from uwtrack_cli.simulate import make_scenario

RATE_HZ, LENGTH_S = 1000.0, 150.0
ODDITIES = ("silence", "stuck", "gap", "clipping", "level")


def passage(rng):
    """Sound of a vessel that passes, in full-scale units."""
    scenario = make_scenario({
        "seed": int(rng.integers(1 << 30)), "duration_s": LENGTH_S,
        "sample_rate_hz": RATE_HZ,
        "sensor": [{"id": "h1", "kind": "omni", "depth_m": 20.0, "full_scale_db": 155.0,
                    "east_m": 0.0, "north_m": 0.0}],
        "vessel": [{
            "name": "v1",
            "closest_approach": {
                "time_s": rng.uniform(60, 90), "horizontal_range_m": rng.uniform(60, 120),
                "speed_mps": rng.uniform(5, 9), "course_deg": 30.0, "side": "port",
            },
            "line": [{"fundamental_hz": rng.uniform(30, 45), "harmonics": 4,
                      "step_db": -1.0, "cn0_db_hz": 38.0}],
            "broadband": {"band_hz": [80.0, 450.0], "snr_db": 6.0},
        }],
        "noise": {"density_db": 70.0, "slope_db_per_decade": -17.0},
    })  # fmt: skip
    return np.concatenate(list(in_memory(scenario).reader(1 << 16)))


def drawn(seed):
    """Sound of a passage with a long silence, in which one to three more things go wrong."""
    rng = np.random.default_rng(seed)
    sound = passage(rng)
    odd = [("silence", 8.0), *((k, 0.2) for k in rng.choice(ODDITIES, rng.integers(1, 4)))]
    for kind, least_s in odd:
        length = int(RATE_HZ * np.exp(rng.uniform(np.log(least_s), np.log(20.0))))
        first = int(rng.integers(sound.shape[0] - length))
        part = sound[first : first + length]
        if kind == "silence":
            part[:] = 0.0
        elif kind == "stuck":
            part[:] = part[0]
        elif kind == "gap":
            part[:] = np.nan
        elif kind == "clipping":
            top = np.nanquantile(np.abs(part), 0.9)
            part[:] = np.clip(part / max(top, 1e-9), -1.0, 1.0)
        else:
            sound[first:] *= 10.0 ** rng.uniform(-1.0, 0.5)
    return sound


@pytest.mark.slow
@pytest.mark.parametrize(
    "seed", [*range(900, 903), *(pytest.param(k, marks=pytest.mark.long) for k in range(903, 920))]
)
def test_drawn_sound_through_a_pipe_gives_the_product_of_its_file(uwtrack, seed, tmp_path):
    memory = io.BytesIO()
    soundfile.write(memory, drawn(seed), int(RATE_HZ), "FLOAT", format="WAV")
    (tmp_path / "a.wav").write_bytes(memory.getvalue())
    assert uwtrack("run", "a.wav", "-q").exit_code == 0
    words = ("run", "-", "-o", "live.h5", "-q")
    assert uwtrack(*words, input=memory.getvalue()).exit_code == 0
    done = uwtrack("diff", "a.run.h5", "live.h5")
    assert done.exit_code == 0, done.stdout
