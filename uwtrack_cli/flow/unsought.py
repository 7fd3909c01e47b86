"""What a run did not look for, told where it found no vessel."""

from collections.abc import Collection, Sequence

from uwtrack_cli.data.recording import Recording
from uwtrack_cli.files.text_escaping import shell_word
from uwtrack_cli.flow.catalogue import find_stage

DEMON = "demon"
"""The stage that hears a shaft whose lines are not above the noise."""


def unsought(
    stages: Collection[str], recordings: Sequence[tuple[str, Recording]]
) -> str:
    """Say which command looks for what no stage has looked for: a shaft without lines.

    Parameters
    ----------
    stages
        Names of the stages that were run.
    recordings
        What they were run over, each with the name by which a command finds it.

    Returns
    -------
    str
        Empty where it was looked for, or no recording is long and broad enough for it.
    """
    if DEMON in stages:
        return ""
    stage = find_stage(DEMON)
    for name, recording in recordings:
        used = stage.resolve(recording, stage.defaults)
        if used["band_hz"] is not None and used["window_s"] is not None:
            return (
                f"shaft and blades in the envelope of the broadband were not looked for: "
                f"uwtrack run {shell_word(name)} --recipe presence -o presence.run.h5 "
                f"does that"
            )
    return ""
