"""What was done to make a product: one step per stage, kept in the file itself.

**Conventions.** A step is stored as one JSON object. Sources are named by their
file name (not their folder) and their digest: SHA-256 of the bytes of a recording
or table, the root digest of a product.
"""

import functools
import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from typing import Any, Self

import numpy as np

from uwtrack_cli import __version__
from uwtrack_cli.data import renamed
from uwtrack_cli.errors import DataError

DIGEST_LENGTH = 64
"""Characters of a SHA-256 digest in hexadecimal."""


@dataclass(frozen=True, kw_only=True)
class Source:
    """A file that a step read: its name and its digest."""

    name: str
    """File name, without its folder."""
    digest: str
    """SHA-256 in hexadecimal: of a file's bytes, or the checksum of a product."""


@dataclass(frozen=True, kw_only=True)
class HistoryStep:
    """One stage as it was run: name, options, versions, and what it read."""

    stage: str
    """Name of the stage."""
    name: str = ""
    """Name of the step, unique in the history; that of its stage if empty."""
    inputs: tuple[str, ...] = ()
    """Names of the steps whose results it read."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Every option with the value that was used."""
    versions: Mapping[str, str] = field(default_factory=dict)
    """Versions of the program and of the libraries that may change a result."""
    sources: tuple[Source, ...] = ()
    """Files that it read."""

    @property
    def step_name(self) -> str:
        """Name of the step, also where the history is of an older program."""
        return self.name or self.stage

    @classmethod
    def now(
        cls,
        stage: str,
        options: Mapping[str, Any],
        sources: Sequence[Source] = (),
        *,
        name: str = "",
        inputs: Sequence[str] = (),
    ) -> Self:
        """Record a stage with the versions of the program that runs it."""
        return cls(
            stage=stage,
            name=name or stage,
            inputs=tuple(inputs),
            options=dict(options),
            versions=program_versions(),
            sources=tuple(sources),
        )

    def to_json(self) -> str:
        """Return the step as one line of JSON."""
        said = {**vars(self), "sources": [vars(source) for source in self.sources]}
        return json.dumps(said, default=_plain, ensure_ascii=False, sort_keys=True)

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Read a step back.

        Raises
        ------
        DataError
            The text is not a step: no JSON object, or a field of the wrong kind.
        """
        try:
            raw = json.loads(text)
            step = cls(
                stage=renamed.STAGES.get(_text(raw["stage"]), _text(raw["stage"])),
                name=_text(raw.get("name", "")),
                inputs=tuple(_text(name) for name in raw.get("inputs", [])),
                options=dict(raw["options"]),
                versions={_text(k): _text(v) for k, v in raw["versions"].items()},
                sources=tuple(
                    Source(name=_text(s["name"]), digest=_text(s["digest"])) for s in raw["sources"]
                ),
            )
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as e:
            raise DataError(
                f"a step of the history is not readable ({type(e).__name__}: {e})."
            ) from e
        return step

    def problems(self) -> list[str]:
        """List what is wrong with the step itself."""
        return [
            f"history: the digest of source {source.name!r} of step {self.stage!r} "
            f"is no SHA-256: {source.digest!r}."
            for source in self.sources
            if not _is_digest(source.digest)
        ]


def program_versions() -> dict[str, str]:
    """Return the versions that may change a result."""
    packages = ("numpy", "scipy", "h5py", "soundfile")
    return {
        "uwtrack": __version__,
        "python": platform.python_version(),
        **{name: _installed_version(name) for name in packages},
    }


@functools.cache
def _installed_version(package: str) -> str:
    """Return a package's version; its metadata take milliseconds to read."""
    return metadata.version(package)


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    return str(value)


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"text expected, got {type(value).__name__}")
    return value


def _is_digest(text: str) -> bool:
    return len(text) == DIGEST_LENGTH and set(text) <= set("0123456789abcdef")
