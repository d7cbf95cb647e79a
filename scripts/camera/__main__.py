"""Studies of the camera that is held still: other platforms, ten controllers, wrong models, weak motors."""

from __future__ import annotations

import tyro

from camera import cases, contest, demand, product, sweep

STUDIES = {
    "cases": cases.main,
    "contest": contest.main,
    "sweep": sweep.main,
    "demand": demand.main,
    "product": product.main,
}

if __name__ == "__main__":
    tyro.extras.subcommand_cli_from_dict(STUDIES)
