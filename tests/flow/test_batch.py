from dataclasses import replace

import numpy as np
import pytest
import soundfile

from uwtrack_cli.flow.batch import DONE, Job, finished, run_job
from uwtrack_cli.flow.shipped_recipes import load_recipe


@pytest.fixture
def job(tmp_path):
    sound = np.random.default_rng(1).normal(0, 0.1, 20_000)
    soundfile.write(tmp_path / "a.wav", sound, 1000)
    target = tmp_path / "out" / "a.run.h5"
    return Job((tmp_path / "a.wav",), target, load_recipe("vessel"))


def test_a_placed_product_tells_what_its_lost_process_did_not(job):
    assert finished(job) is None
    told = run_job(job)
    assert told.status == DONE
    assert finished(job) == replace(told, cpu_s=None, message="")


def test_a_product_of_another_recipe_or_a_damaged_one_tells_nothing(job):
    run_job(job)
    assert finished(replace(job, recipe=load_recipe("small-craft"))) is None
    with job.target.open("r+b") as file:
        file.seek(job.target.stat().st_size // 2)
        file.write(b"\xff\x00\xff")
    assert finished(job) is None
