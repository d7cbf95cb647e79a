"""Studies of the camera that is held still: cases of sensors and platforms, wrong models, what motors can do."""

from __future__ import annotations

import tyro

from camera import cases, demand, sweep

STUDIES = {"cases": cases.main, "sweep": sweep.main, "demand": demand.main}

if __name__ == "__main__":
    tyro.extras.subcommand_cli_from_dict(STUDIES)
