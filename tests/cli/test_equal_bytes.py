"""The same recordings give the same bytes, whoever makes the products and when."""

import os
import subprocess
import sys
import time

import pytest

from uwtrack_cli.files.hdf5.checksum import LINE_BYTES
from uwtrack_cli.files.hdf5.product import read_product


def test_a_product_made_from_one_that_was_made_again_is_the_same(uwtrack, noise_wav, tmp_path):
    sound = noise_wav.rename(tmp_path / "a.wav")
    made = []
    for _ in range(2):
        for words in (["spectrogram", "a.wav"], ["levels", "a.spectrogram.h5"]):
            done = uwtrack(*words, "--overwrite", "-q")
            assert done.exit_code == 0, done.output
        made.append(sound.with_name("a.levels.h5").read_bytes())
        time.sleep(1.1)
    assert made[0] != made[1]
    assert made[0][:-LINE_BYTES] == made[1][:-LINE_BYTES]
    with read_product(sound.with_name("a.levels.h5")) as product:
        assert any(source.name == "a.spectrogram.h5"
                   for step in product.history for source in step.sources)  # fmt: skip
    assert uwtrack("verify", "a.levels.h5").exit_code == 0


@pytest.mark.parametrize(("given", "used"), [(None, "1"), ("3", "3")])
def test_blas_has_one_thread_unless_the_environment_says_otherwise(given, used):
    program = (
        "import os, sys\n"
        "from uwtrack_cli.cli import main\n"
        "assert 'numpy' not in sys.modules\n"
        "sys.argv = ['uwtrack', '--version']\n"
        "try:\n    main()\n"
        "finally:\n    print(os.environ['OPENBLAS_NUM_THREADS'])\n"
    )
    environment = {k: v for k, v in os.environ.items() if "NUM_THREADS" not in k}
    if given is not None:
        environment["OPENBLAS_NUM_THREADS"] = given
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == used
