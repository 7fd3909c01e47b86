"""Contacts of a moving source and of the repeater that it leaves behind."""

import numpy as np

from uwtrack_cli.data.contacts import Contacts
from uwtrack_cli.data.sensor import Navigation
from uwtrack_cli.simulate.repeater import RepeaterScene, simulate_repeater

SCENE = RepeaterScene(aspect_deg=140.0, turns=True)


def contact_pair(scene=SCENE, seed=1, source=1, repeater=2):
    """Return contacts of one simulated run and own ship's navigation."""
    drawn = simulate_repeater(np.random.default_rng(seed), scene, 1)
    n = drawn.time_s.size
    table = np.concatenate([drawn.source[:, 0], drawn.repeater[:, 0]])
    number = np.repeat([source, repeater], n)
    time_s = np.tile(drawn.time_s, 2)
    keep = np.isfinite(table[:, 0])
    order = np.argsort(time_s[keep], kind="stable")
    table, number, time_s = (v[keep][order] for v in (table, number, time_s))
    contacts = Contacts(
        contact=number, time_s=time_s, range_m=table[:, 0], bearing_deg=table[:, 1],
        range_rate_mps=table[:, 2], range_std_m=np.full(time_s.size, scene.range_std_m),
        bearing_std_deg=np.full(time_s.size, scene.bearing_std_deg),
        range_rate_std_mps=np.full(time_s.size, scene.range_rate_std_mps),
    )  # fmt: skip
    clock, own = drawn.navigation_time_s, drawn.own_ship_m
    navigation = Navigation(
        time_s=clock, east_m=own[:, 0], north_m=own[:, 1],
        heading_deg=np.full(clock.size, np.nan),
    )  # fmt: skip
    return contacts, navigation
