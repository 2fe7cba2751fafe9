"""Cogging orders that a page can add: each run's motor has spare ones without torque, which the page sets.

An order without torque adds zero to the motor's torque, which changes no bit of a run. The command that
repeats a page's run gives all orders as one list, since a key cannot name a row that the study lacks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from cogless import units
from cogless.live.candidates import Candidate
from cogless.live.description import SPARE_ORDERS, Packed, Place
from cogless.live.keys import Key, Landing
from cogless.run.simulate import Pair
from cogless.study import Study, for_scenario
from cogless.study.toml import toml

GROUP = "Cogging orders that you add"
ORDER_MOST = 400.0
TORQUE_UNIT = "mN*m"
TORQUE_SHARE = 0.1  # slider's end over the torque at the current limit


def spare_orders(study: Study, base: Mapping[Place, Packed]) -> tuple[list[Key], dict[str, Any]]:
    """The keys of the spare orders, and by scenario the study's own orders, with values as TOML."""
    if not base:
        return [], {}
    return _spare_keys(study, base), _cogging_rows(study, [(place[0], place[1]) for place in base])


def _spare_keys(study: Study, base: Mapping[Place, Packed]) -> list[Key]:
    """The order and the torque of each spare order, for all runs; the controllers don't know these."""
    factor = units.factor(TORQUE_UNIT, units.TORQUE)
    reach = TORQUE_SHARE * study.K_t * study.drive.current_loop.current_limit / factor
    reach = float(f"{reach:.2g}")
    keys = []
    for spare in range(SPARE_ORDERS):
        order = Candidate(
            key=f"cogging.{spare}.order",
            label="order",
            group=GROUP,
            unit="",
            factor=1.0,
            start=1.0,
            low=1.0,
            high=ORDER_MOST,
            least=1.0,
            most=ORDER_MOST,
            whole=True,
        )
        torque = Candidate(
            key=f"cogging.{spare}.torque",
            label="torque",
            group=GROUP,
            unit=TORQUE_UNIT,
            factor=factor,
            start=0.0,
            low=0.0,
            high=reach,
            least=0.0,
            most=10 * reach,
        )
        keys += [Key(one, _landings(base, spare, one.label)) for one in (order, torque)]
    return keys


def _landings(base: Mapping[Place, Packed], spare: int, word: str) -> dict[Place, tuple[Landing, ...]]:
    landings = {}
    for place, blob in base.items():
        numbers = [n for n in blob.numbers if _is_cogging(n.path, word)]
        landings[place] = tuple(Landing(n) for n in numbers[len(numbers) - SPARE_ORDERS :][spare : spare + 1])
    return landings


def _is_cogging(path: str, word: str) -> bool:
    room, _, last = path.rpartition(".")
    return last == word and room.rpartition(".")[0] == "motor.cogging"


def _cogging_rows(study: Study, pairs: Sequence[Pair]) -> dict[str, list[dict[str, str]]]:
    """For each scenario the study's own orders: each key with its value as TOML."""
    orders = {}
    for scenario in dict.fromkeys(scenario for scenario, _ in pairs):
        rows: Any = for_scenario(study, scenario).source.tables["motor"].get("cogging", [])
        orders[scenario] = [{key: toml(value) for key, value in row.items()} for row in rows]
    return orders
