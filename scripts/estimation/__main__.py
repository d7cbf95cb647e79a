"""One table per promise; each prints PASS or FAIL in its last line and leaves with 1 if it is missed."""

from __future__ import annotations

import tyro

from estimation.biased import biased
from estimation.coverage import coverage
from estimation.physical import physical
from estimation.recipe import recipe

if __name__ == "__main__":
    verbs = {"physical": physical, "biased": biased, "coverage": coverage, "recipe": recipe}
    tyro.extras.subcommand_cli_from_dict(verbs)
