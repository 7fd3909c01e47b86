"""Colours and habits that all pictures share."""

from typing import TYPE_CHECKING

from uwtrack_cli.files.text_escaping import figure_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CONTACT_COLORS = (
    "#d62728", "#1f77b4", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf", "#e377c2",
)  # fmt: skip
NO_CONTACT = "#888888"


def contact_color(contact: int) -> str:
    """Return the colour of a contact, the same in every panel; grey for none."""
    if contact <= 0:
        return NO_CONTACT
    return CONTACT_COLORS[(contact - 1) % len(CONTACT_COLORS)]


def say_nothing_there(ax: "Axes", text: str) -> None:
    """Write into an empty panel why it is empty, and leave out its scales."""
    ax.set(xticks=[], yticks=[])
    ax.text(
        0.5, 0.5, figure_text(text), transform=ax.transAxes, ha="center", va="center", color="#666666"
    )  # fmt: skip
