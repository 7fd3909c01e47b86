"""Loss of level with range, under a stated law.

**Conventions.** The law is its loss in dB per decade of range: 20 in free water, 10 in
a layer that keeps all sound, 15 a usual compromise. Levels at the source are at 1 m.
Absorption is left out: at 1 kHz it is below 0.1 dB per km.

**References.** Urick (1983), Principles of Underwater Sound, section 5.2.
"""

import numpy as np


def spreading_loss_db(
    range_m: float, range_std_m: float, spreading_db: float
) -> tuple[float, float]:
    """Return the loss from 1 m to a range, and its deviation, in dB.

    Parameters
    ----------
    range_m
        Slant range in metres.
    range_std_m
        Its standard deviation in metres.
    spreading_db
        Loss per decade of range in dB: the law.

    Examples
    --------
    >>> loss, std = spreading_loss_db(100.0, 1.0, 20.0)
    >>> round(loss, 6), round(std, 4)
    (40.0, 0.0869)
    """
    loss = spreading_db * float(np.log10(range_m))
    return loss, spreading_db / float(np.log(10.0)) * range_std_m / range_m
