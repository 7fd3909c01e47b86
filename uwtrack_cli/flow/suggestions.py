"""Which command to try next, told where a run found no vessel."""

from collections.abc import Collection, Iterator, Sequence

from uwtrack_cli.constants import SOUND_SPEED_WATER_MPS
from uwtrack_cli.data.encounters import TOO_FAST, Encounters
from uwtrack_cli.data.recording import Recording
from uwtrack_cli.files.text_escaping import shell_word
from uwtrack_cli.flow.catalogue import find_stage

AIR = ("--sound-speed-mps 343", "air")
"""Option of sound in air, and the name of the product that it makes."""


def suggestions(
    stages: Collection[str],
    recordings: Sequence[tuple[str, Recording]],
    passages: Sequence[Encounters] = (),
) -> tuple[str, ...]:
    """Say which commands look for what no stage has looked for, likeliest first.

    Parameters
    ----------
    stages
        Names of the stages that were run.
    recordings
        What they were run over, each with the name by which a command finds it.
    passages
        Closest approaches that were found, with the candidates that were refused.

    Returns
    -------
    tuple[str, ...]
        A sentence with its command each; empty where everything was looked for.
    """
    return tuple(_suggested(stages, recordings, passages))


def _suggested(
    stages: Collection[str],
    recordings: Sequence[tuple[str, Recording]],
    passages: Sequence[Encounters],
) -> Iterator[str]:
    falls = any(one.refused_as(TOO_FAST) for one in passages)
    # whoever tells a depth knows that the sensor is in water
    in_air = [
        name
        for name, one in recordings
        if one.sensor.sound_speed_mps == SOUND_SPEED_WATER_MPS
        and (falls or one.sensor.depth_m is None)
    ]
    if falls and in_air:
        yield _suggestion("lines fall as in air", in_air[0], *AIR)
    broad = [name for name, one in recordings if _has_envelope(one)]
    if "demon" not in stages and broad:
        yield _suggestion(
            "shaft and blades in the envelope of the broadband were not searched",
            broad[0], "--recipe presence", "presence",
        )  # fmt: skip
    if not recordings:
        return
    first = recordings[0][0]
    if "zoom" not in stages:
        yield _suggestion("frames of other lengths were not used", first, "--recipe auto", "auto")
    elif "trace" not in stages:
        yield _suggestion(
            "steady lines below the noise of a frame were not searched",
            first, "--recipe multi-resolution", "multi-resolution",
        )  # fmt: skip
    if in_air and not falls:
        yield _suggestion("if the sound was recorded in air", in_air[0], *AIR)


def _suggestion(what: str, name: str, options: str, product: str) -> str:
    return f"{what}: uwtrack run {shell_word(name)} {options} -o {product}.run.h5"


def _has_envelope(recording: Recording) -> bool:
    """Tell whether a recording is long and broad enough for its envelope."""
    stage = find_stage("demon")
    used = stage.resolve(recording, stage.defaults)
    return used["band_hz"] is not None and used["window_s"] is not None
