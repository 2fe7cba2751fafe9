"""The texts of the export of `microstepping`, which has no drive around it."""

from __future__ import annotations

import math

import numpy as np

from cogless.control_library import real_number
from cogless.export.c.subject import Subject
from cogless.export.c.texts import law_texts, law_words
from cogless.export.prepared import Prepared, Recording
from cogless.study.laws.microstepping import Microstepping, wrong_current

TURN_STEPS = 256  # periods of the self-test per electrical turn


def microstepping_texts(subject: Subject, prepared: Prepared, recording: Recording) -> dict[str, str]:
    """Text of each file of an export, by name, except files of the control library."""
    law = prepared.study.controller[prepared.controller]
    assert isinstance(law, Microstepping)
    double = subject.precision == "d"
    words = law_words(subject) | {
        "bits": "uint64_t" if double else "uint32_t",
        "ticks": str(len(recording.outputs)),
        "turn_steps": str(TURN_STEPS),
        "rows": "\n".join(_test_periods(subject, prepared, recording)),
        "current": f"{law.current:.6g}",
        "amplitude": f"{law.amplitude:.6g}",
        "teeth": str(subject.law_config["teeth"]),
        "microsteps": str(law.microsteps),
        "correction": _correction(law),
    }
    return law_texts("microstepping", words)


def _correction(law: Microstepping) -> str:
    """Text on the current for which the correction is, and on the ripple left at another current."""
    if law.correction is None:
        return "none"
    own = law.correction.current
    if own is None:
        return "for one current only, which the study does not state"
    wrong = wrong_current(own, law.current)
    now = f"; {wrong}" if wrong else ""
    return (
        f"for {own:.6g} A rms: at a current I (rms) the correction leaves about abs(I / {own:.6g} A - 1) of "
        f"the ripple{now}"
    )


def _test_periods(subject: Subject, prepared: Prepared, recording: Recording) -> list[str]:
    """A line of bit patterns for each period of the self-test.

    The lines are of the recorded periods, an electrical turn each way, and implausible references. The
    engine's controller computes the coils' currents in all of these periods.
    """
    layout, state = subject.layout, prepared.drive.start()
    at_rest = dict.fromkeys(("theta_ref", "omega_ref", "alpha_ref", "i_d_ref", "i_q_ref"), 0.0)
    flags = {"learn": True, "torque": False}
    turn = math.tau / subject.law_config["teeth"] * np.arange(TURN_STEPS) / TURN_STEPS
    motions = [(angle, 1.0) for angle in turn] + [(angle, -1.0) for angle in turn[::-1]]
    motions += [(math.nan, 1.0), (0.0, math.inf), (real_number("CGL_ANGLE_MAX"), 1.0)]
    references = recording.references + [
        layout.pack("cgl_reference", at_rest | flags | {"theta_ref": theta, "omega_ref": omega})
        for theta, omega in motions
    ]
    still, outputs = bytes(layout.size("cgl_measurement")), []
    for reference in references:
        prepared.drive.step_controller(state, still, reference)
        outputs.append(prepared.drive.microstepping_output(state))
    outputs[: len(recording.outputs)] = recording.outputs
    digits = 2 * layout.size("cgl_real")

    def row_of(reference: bytes, output: bytes) -> str:
        theta_ref, omega_ref, *_ = layout.bits("cgl_reference", reference)
        i_a, i_b, status = layout.bits("cgl_microstepping_output", output)
        patterns = (f"0x{word:0{digits}x}U" for word in (theta_ref, omega_ref, i_a, i_b))
        return f"    {{{', '.join(patterns)}, {status}U}},"

    return [row_of(reference, output) for reference, output in zip(references, outputs, strict=True)]
