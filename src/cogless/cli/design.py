"""`design`: gains, and what follows from them."""

from __future__ import annotations

import json
from functools import partial
from typing import Annotated

import typer

from cogless.cli.options import SetOption, StudyArgument
from cogless.cli.study import load
from cogless.cli.terminal import new_console


def design(
    study: StudyArgument,
    changes: SetOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, in SI units.")] = False,
) -> None:
    """Show every controller's gains, and what follows from them before any run.

    For a study of speed: gains, given or by a tuning rule, the margins of the loop, whether learning settles.

    For a study of trials: gains, given or by LMIs, and the certificate that they work.
    """
    from cogless.study import TrialStudy

    loaded = load(study, changes)
    if isinstance(loaded, TrialStudy):
        from cogless.design.trial_summary import summary, table, to_dict

        designs = summary(loaded)
        found, shown = partial(to_dict, loaded, designs), partial(table, loaded, designs)
    else:
        from cogless.design.summary import to_dict as speed_dict
        from cogless.design.table import design_table

        found, shown = partial(speed_dict, loaded), partial(design_table, loaded)
    if as_json:
        print(json.dumps(found(), indent=2, ensure_ascii=False))
    else:
        new_console().print(shown())
