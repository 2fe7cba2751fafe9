"""What the control library calls each law: header, types, functions, and the memory that it learns into."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class LawInC:
    """`functions`: what init, reset and the others begin with. `memory`: its entries as a C expression with
    members of the config in braces, or None where the law keeps all in its state. `map`: the function that
    makes a stored map of it."""

    header: str
    config: str
    state: str
    functions: str
    step: str
    memory: str | None = None
    map: str | None = None

    def has_map(self, config: dict[str, Any]) -> bool:
        """Whether what it learns with this config, as decoded, can be stored: it is not by time."""
        by_time = config.get("memory", {}).get("kind") in ("CGL_MEMORY_TIME", "CGL_SPACE_DELAY")
        return self.map is not None and not by_time

    def entries(self, config: dict[str, Any]) -> str | None:
        """The expression for a config as decoded; whole numbers are unsigned."""
        if self.memory is None:
            return None
        return self.memory.format_map(_Unsigned(config))


class _Unsigned(dict[str, Any]):
    """Members for format(): "256U" for 256; those of a struct within are attributes of it."""

    def __init__(self, values: dict[str, Any]) -> None:
        super().__init__(values)

    def __getitem__(self, key: str) -> Any:
        value: Any = self
        for part in key.split("/"):
            value = dict.__getitem__(value, part)
        return f"{value}U" if isinstance(value, int) else value


def _learning(stem: str, memory: str | None) -> LawInC:
    """A law whose names all follow from its file's."""
    name = f"cgl_{stem}"
    return LawInC(f"{stem}.h", f"{name}_config", name, name, f"{name}_step", memory, f"cgl_map_of_{stem}")


MAP = "CGL_MEMORY_LENGTH({memory/cells}, {memory/q_half_width})"
CHANNELS = "{memory/kind}, {memory/channels}, {memory/cells}, {memory/q_half_width}"
SPACE = f"CGL_SPACE_MEMORY_LENGTH({CHANNELS})"

# by the law's name in the engine
LAWS = {
    "pi": LawInC("speed_pi.h", "cgl_pi_config", "cgl_pi", "cgl_pi", "cgl_speed_pi_step"),
    "pi-ilc": _learning("pi_ilc", MAP),
    "robust-ilc": _learning("robust_ilc", MAP),
    "anti-cogging": _learning("anti_cogging", "{cells}"),
    "space-position": _learning("space_position", SPACE),
    "space-speed": _learning("space_speed", SPACE),
    "trial": LawInC(
        "trial.h",
        "cgl_trial_config",
        "cgl_trial",
        "cgl_trial",
        "cgl_trial_drive_step",
        "CGL_TRIAL_LENGTH({samples}, {q_filter/order})",
        "cgl_map_of_trial",
    ),
}
