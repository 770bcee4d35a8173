"""The routes by which pole axes and coefficients can be found, and what each is."""

from typing import Literal

Route = Literal["best", "first", "conditioned", "equations"]

ROUTES: dict[Route, str] = {
    "best": "two best great circles, velocity equations where these are doubtful",
    "first": "first two great circles of the plan",
    "conditioned": "two best great circles",
    "equations": "velocity equations of the whole mechanism",
}
"""Only ``best`` changes over to another source; the others give a status instead."""
