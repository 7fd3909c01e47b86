"""What comes with the program: recipes and sample recordings.

**Method.** A checkout has the samples as they were made. An installed package has all of
them but the sound, which takes megabytes and is made again of its scenario when it is
copied (see `sample_recordings`): to within one quantisation step, and to the bit where the
mathematical library is the same.
"""

import re
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import uwtrack_cli
from uwtrack_cli.data import renamed
from uwtrack_cli.data.options import nearest
from uwtrack_cli.data.sensor import Sensor
from uwtrack_cli.errors import DataError, OptionError
from uwtrack_cli.files.atomic import atomic_target, check_target
from uwtrack_cli.files.input_ledger import as_input
from uwtrack_cli.files.tables.toml_tables import MAX_BYTES
from uwtrack_cli.flow.recipe import Recipe

FOLDERS = ("pipelines", "sample_data")
"""Folders that come with the program."""

SOUND, SENSOR, SCENARIO = ".wav", ".sensor.toml", ".scenario.toml"
"""Endings of a sample recording and of what lies beside it."""

DEFAULT_RECIPE = "auto"
"""Recipe of recordings by single sensors."""

ARRAY_RECIPE = "towed-array"
"""Recipe of recordings by line arrays."""

SPATIAL_ARRAY_RECIPE = "small-array"
"""Recipe of recordings by arrays that are no line."""


def shipped_folder(name: str) -> Path:
    """Return a folder that comes with the program.

    An installed package carries it inside; in a checkout it lies beside the package.

    ``name``: ``pipelines`` or ``sample_data``.

    Raises
    ------
    DataError
        The installation lacks the folder.
    """
    if name not in FOLDERS:
        raise DataError(f"there is no shipped folder {name!r}; there are {', '.join(FOLDERS)}.")
    package = Path(uwtrack_cli.__file__).resolve().parent
    for folder in (package / "_shipped" / name, package.parent / name):
        if folder.is_dir():
            return folder
    raise DataError(f"this installation of uwtrack lacks its folder {name}; install it again.")


def usual_recipe(sensors: Sequence[Sensor | None]) -> str:
    """Return the recipe for the kind of sensor that made the recordings.

    ``sensors``: the sensor of each recording, None where nothing is known.

    Raises
    ------
    OptionError
        Some were made by arrays of a kind and others were not.
    """
    recipes = {_recipe_for(sensor) for sensor in sensors}
    if len(recipes) > 1:
        raise OptionError(
            f"the recordings are of sensors of several kinds, whose recipes are "
            f"{' and '.join(sorted(recipes))}: run them apart."
        )
    return recipes.pop() if recipes else DEFAULT_RECIPE


def _recipe_for(sensor: Sensor | None) -> str:
    if sensor is None or not sensor.is_array:
        return DEFAULT_RECIPE
    return ARRAY_RECIPE if sensor.element_along_m else SPATIAL_ARRAY_RECIPE


def shipped_recipes() -> list[str]:
    """Return the names of the shipped recipes."""
    return sorted(path.stem for path in shipped_folder("pipelines").glob("*.toml"))


def load_recipe(name: Path | str) -> Recipe:
    """Return a shipped recipe by its name, or one from a TOML file.

    Raises
    ------
    OptionError
        There is neither such a recipe nor such a file, or it is not valid.
    """
    path = Path(name)
    if path.suffix != ".toml":
        known = renamed.STAGES.get(str(name), str(name))
        path = shipped_folder("pipelines") / f"{known}.toml"
    try:
        if path.stat().st_size > MAX_BYTES:
            raise OptionError(f"{path} is larger than {MAX_BYTES} bytes; that is no recipe.")
        text = as_input(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        names = shipped_recipes()
        raise OptionError(
            f"there is no recipe {str(name)!r}.{nearest(str(name), names)} Shipped are "
            f"{', '.join(names)}; or give a TOML file."
        ) from error
    return Recipe.from_toml(path.stem, text)


def sample_names() -> list[str]:
    """Return the names of the sample recordings and tables."""
    names = [path.name for path in shipped_folder("sample_data").iterdir()]
    return sorted(
        name.removesuffix(ending)
        for name in names
        for ending in (SENSOR, ".csv")
        if name.endswith(ending)
    )


def sample_texts() -> dict[str, str]:
    """Return what each sample holds in a few words, by its name.

    The words are those of the tables in the samples' own README, up to the first colon
    or semicolon.
    """
    told: dict[str, str] = {}
    readme = shipped_folder("sample_data") / "README.md"
    for line in as_input(readme).read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("| ").split("|")]
        if line.startswith("| `"):
            for name in cells[0].split(","):
                text = re.split("[:;]", cells[1], maxsplit=1)[0].replace("`", "")
                told[Path(name.strip(" `")).stem] = text
    return {name: told.get(name, "") for name in sample_names()}


def copy_sample(name: str, folder: Path | str, *, overwrite: bool = False) -> list[Path]:
    """Copy a sample recording with all that lies beside it.

    Parameters
    ----------
    name
        Name of a sample, or the start of the names of several (``two-sensors``).
    folder
        Where to copy to; made if it does not exist.
    overwrite
        Whether existing files may be replaced.

    Raises
    ------
    OptionError
        There is no such sample.
    OutputError
        A file exists already, or the folder cannot be written.
    """
    folder = Path(folder)
    source = shipped_folder("sample_data")
    found = sorted(
        path for path in source.iterdir() if path.name.startswith((f"{name}.", f"{name}-"))
    )
    names = sample_names()
    if not any(name == n or n.startswith(f"{name}-") for n in names):
        raise OptionError(
            f"there is no sample {name!r}.{nearest(name, names)} There are {', '.join(names)}."
        )
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="uwtrack-") as scratch:
        here = {path.name: path for path in found}
        here = dict(sorted((_missing_sound(here, Path(scratch)) | here).items()))
        for path in here.values():  # all or none
            check_target(folder / as_input(path).name, overwrite=overwrite)
        for file_name, path in here.items():
            target = folder / file_name
            with atomic_target(target, overwrite=overwrite) as temporary:
                temporary.write_bytes(as_input(path).read_bytes())
    return [folder / file_name for file_name in here]


def _missing_sound(found: Mapping[str, Path], scratch: Path) -> dict[str, Path]:
    """Make the recordings that lie beside no sensor file, and return them by name.

    ``found``: files of samples by name. ``scratch``: folder to make them in.
    """
    from uwtrack_cli.flow.sample_recordings import read_scenario, write_simulation

    wanted = {name.removesuffix(SENSOR) + SOUND for name in found if name.endswith(SENSOR)}
    missing = wanted - found.keys()
    for scenario in shipped_folder("sample_data").glob(f"*{SCENARIO}") if missing else ():
        own = scenario.name.removesuffix(SCENARIO)
        if any(name.startswith((f"{own}.", f"{own}-")) for name in missing):
            write_simulation(read_scenario(scenario), scratch / f"{own}{SOUND}")
    return {name: scratch / name for name in sorted(missing)}
