"""All data from which the files of an export are written, and the names of a controller in C."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cogless.c_layout import Layout
from cogless.control_library import MICROSTEPPING, CLaw, Headers
from cogless.results.results_json import as_json
from cogless.study import AnyStudy


@dataclass(frozen=True, eq=False)
class Subject:
    """A controller of a study with its configuration, as the engine runs it in a scenario."""

    study: AnyStudy
    scenario: str
    controller: str
    name: str  # the C identifier
    law: CLaw
    layout: Layout
    drive_config: dict[str, Any]  # cgl_drive_config, decoded
    law_config: dict[str, Any]
    dead_time_config: dict[str, Any] | None  # cgl_dead_time_config, decoded; None: not compensated
    current_reference_config: dict[str, Any] | None  # decoded; None: the law's output is i_q_ref
    encoder_table_config: dict[str, Any] | None  # decoded, for the example; None: no correction
    rate: int  # Hz, of the current loop
    memory_length: int  # entries of the law's memory
    map: tuple[int, int] | None  # channels and cells of the learned map; None: nothing to store
    learning_matrix: NDArray[np.floating[Any]] | None
    figures: list[tuple[str, str]]  # name and value, as `cogless design` shows them
    verdict: Sequence[str]  # statements of `cogless design` about learning
    command: str  # command line of this export

    @property
    def has_drive(self) -> bool:
        """Whether a drive is around the law."""
        return self.law is not MICROSTEPPING

    @property
    def output(self) -> str:
        """C type of a step's output."""
        return "cgl_drive_output" if self.has_drive else f"{self.law.state}_output"

    @property
    def parts(self) -> list[str]:
        """Headers of the control library that declare the controller's parts."""
        if not self.has_drive:
            return [self.law.header]
        more = {
            "current_reference.h": self.current_reference_config,
            "dead_time.h": self.dead_time_config,
        }
        used = [header for header, config in more.items() if config is not None]
        return ["drive.h", self.law.header, *used]

    @property
    def defines(self) -> list[str]:
        """Macros with which every file is compiled: for double precision, and for parts that are left out.

        COGLESS_NO_TEXTS leaves out the names of the configs' fields, since a study's values are checked.
        """
        return [*["COGLESS_DOUBLE"] * (self.precision == "d"), "COGLESS_NO_TEXTS", *self.left_out]

    @property
    def left_out(self) -> dict[str, set[str]]:
        """{macro that leaves out a part of the control library: files that aren't needed then}."""
        parts: dict[str, set[str]] = {}
        if self.has_drive and self.drive_config["unguarded"]:
            parts["COGLESS_NO_GUARD"] = {"guard.c"}
        if self._kind == "CGL_MEMORY_ANGLE":
            parts["COGLESS_NO_DELAY_LINE"] = {"delay_line.c", "delay_line.h"}
        return parts

    @property
    def unused(self) -> set[str]:
        """Files of the control library that the macros of `left_out` make unnecessary."""
        return set().union(*self.left_out.values())

    @property
    def _kind(self) -> str | None:
        """Kind of the law's memory; None if the law has none of the library's memories."""
        memory = self.law_config.get("memory")
        return memory["kind"] if isinstance(memory, dict) else None

    @property
    def headers(self) -> Headers:
        return self.layout.headers

    @property
    def precision(self) -> str:
        """Type of the library's real numbers: "f" for float, "d" for double."""
        return self.layout.real

    @property
    def divider(self) -> int:
        """Current-loop periods per period of the law."""
        return int(self.drive_config["divider"])

    @property
    def foreign(self) -> bool:
        """Whether the export has no current loop, so that the controller outputs current references."""
        return bool(self.drive_config["foreign"])


def study_hash(study: AnyStudy) -> str:
    """SHA-256 of the study's tables with datasheet and changes, as JSON with sorted keys and no spaces."""
    text = json.dumps(as_json(study.source.tables), sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


def identifier(controller: str) -> str:
    """The controller's name as a C name: pi_ilc for "pi-ilc"."""
    name = re.sub(r"[^0-9A-Za-z]+", "_", controller).strip("_")
    begins_well = name[:1].isalpha() and not name.lower().startswith("cgl_")  # the library has that prefix
    return name if begins_well else f"my_{name}".rstrip("_")


def stem(name: str) -> str:
    """Name of the controller's header and source without suffix.

    The ending _controller avoids clashes: the library has files named like laws, and some build tools put all
    objects into one folder.
    """
    return f"{name}_controller"
