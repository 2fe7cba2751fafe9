"""A first study of one's own motor: from a few answers and a catalogue of motors, encoders and drives."""

from cogless.starter.better_settings import Settings, holding_settings
from cogless.starter.draft import Draft, draft
from cogless.starter.guess_list import motor_guesses
from cogless.starter.ranking import AtSpeed, Effect, Outcome, Ranking, rank
from cogless.starter.request import NUMBERS, Request, RequestError, parse_number, parse_speeds

__all__ = [
    "NUMBERS",
    "AtSpeed",
    "Draft",
    "Effect",
    "Outcome",
    "Ranking",
    "Request",
    "RequestError",
    "Settings",
    "draft",
    "holding_settings",
    "motor_guesses",
    "parse_number",
    "parse_speeds",
    "rank",
]
