"""A first study of one's own motor: from a few answers and a catalogue of motors, encoders and drives."""

from cogless.starter.draft import Draft, draft
from cogless.starter.ranking import Effect, Outcome, Ranking, rank
from cogless.starter.request import NUMBERS, Request, RequestError, parse_number, parse_speeds

__all__ = [
    "NUMBERS",
    "Draft",
    "Effect",
    "Outcome",
    "Ranking",
    "Request",
    "RequestError",
    "draft",
    "parse_number",
    "parse_speeds",
    "rank",
]
